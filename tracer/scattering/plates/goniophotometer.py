"""The virtual goniophotometer: BRDF, BTDF, R and T of a plate by Monte Carlo, with errors.

The detector is a grid of cells over both hemispheres. A cell's value is its flux over incident
flux and projected solid angle, so that the cells of a side sum to R or T; the specular reflection
and the direct beam fall into the cells where they leave, as in a real instrument of that aperture.
Standard errors come from the scatter between batches of rays.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.optics.fluxes import variances
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_kernel import TOTALS, PlateProblem, trace_plate
from tracer.scattering.plates.tilt import SMOOTH, TiltDistribution

__all__ = ["AngularGrid", "Goniogram", "measure_plate", "measure_spectrum"]

Array = NDArray[np.float64]
_BATCHES = 20


@dataclass(frozen=True, kw_only=True)
class AngularGrid:
    """Cells of the detector.

    Parameters
    ----------
    theta_edges_deg : (n_theta + 1,) edges of the polar angle, rising from 0 to 90 [deg]
    n_phi : equal cells in azimuth; the first is centred on phi = 0, forwards in the plane of
        incidence; 1 averages over azimuth and traces faster
    """

    theta_edges_deg: Array = field(default_factory=lambda: np.linspace(0.0, 90.0, 31))
    n_phi: int = 36

    def __post_init__(self) -> None:
        edges = np.asarray(self.theta_edges_deg, np.float64)
        rising = edges.ndim == 1 and edges.size >= 2 and bool(np.all(np.diff(edges) > 0.0))
        if not rising or edges[0] != 0.0 or edges[-1] != 90.0 or self.n_phi < 1:
            raise SceneError(
                "angular grid: polar edges must rise from 0 to 90 degrees, n_phi must be >= 1"
            )

    @property
    def theta_deg(self) -> Array:
        """(n_theta,) polar angles of the cell centres [deg]."""
        edges = np.asarray(self.theta_edges_deg, np.float64)
        return np.asarray(0.5 * (edges[1:] + edges[:-1]))

    @property
    def phi_deg(self) -> Array:
        """(n_phi,) azimuths of the cell centres [deg]."""
        return np.linspace(0.0, 360.0, self.n_phi, endpoint=False)

    @property
    def projected_solid_angle(self) -> Array:
        """(n_theta, 1) integral of cos(theta) over a cell [sr]."""
        squares = np.sin(np.radians(self.theta_edges_deg)) ** 2
        return np.asarray(0.5 * np.diff(squares)[:, None] * (2.0 * math.pi / self.n_phi))

    @property
    def cosine_edges(self) -> Array:
        """(n_theta + 1,) cosines of the edges, falling from 1 to 0."""
        cosines = np.cos(np.radians(np.asarray(self.theta_edges_deg, np.float64)))
        cosines[0], cosines[-1] = 1.0, 0.0
        return np.asarray(cosines)


@dataclass(frozen=True, kw_only=True)
class Goniogram:
    """One measurement: a sample, an angle of incidence, a wavelength.

    Attributes
    ----------
    brdf, btdf : (n_theta, n_phi) [1/sr], with standard errors ``*_se``
    reflectance, transmittance : shares of the incident flux, with standard errors ``*_se``
    absorbed : share of the incident flux
    scatterings : mean number of scatterings per ray
    """

    grid: AngularGrid
    incidence_deg: float
    wavelength_nm: float | None
    rays: int
    brdf: Array
    brdf_se: Array
    btdf: Array
    btdf_se: Array
    reflectance: float
    reflectance_se: float
    transmittance: float
    transmittance_se: float
    absorbed: float
    scatterings: float


def measure_plate(
    medium: ScatteringMedium,
    thickness_mm: float,
    incidence_deg: float,
    *,
    rays: int = 100_000,
    seed: int = 1,
    grid: AngularGrid | None = None,
    weighted: bool = False,
    front: TiltDistribution = SMOOTH,
    back: TiltDistribution = SMOOTH,
    wavelength_nm: float | None = None,
    threads: int | None = None,
) -> Goniogram:
    """Light a plate with a parallel beam and measure what leaves it.

    Parameters
    ----------
    medium : of the plate; its g and gamma are used
    thickness_mm : of the plate [mm]
    incidence_deg : angle of incidence in air, 0 <= angle < 90 [deg]
    rays, seed : same seed, same random numbers, whatever the medium
    grid : cells of the detector
    weighted : carry absorption and face losses as weights instead of ending rays by chance
    front, back : tilt distributions of the faces
    wavelength_nm : noted in the result
    threads : threads of the trace; the result does not depend on them
    """
    cells = grid or AngularGrid()
    if rays < 2 * _BATCHES:
        raise SceneError(f"goniophotometer: at least {2 * _BATCHES} rays are needed, got {rays}")
    problem = plate_problem(medium, thickness_mm, incidence_deg, grid=cells, front=front, back=back)
    edges = np.linspace(0, rays, _BATCHES + 1).astype(np.int64)
    n_theta = cells.cosine_edges.size - 1

    def batch(k: int) -> tuple[Array, Array]:
        bins, totals = np.zeros((2, n_theta, cells.n_phi)), np.zeros(TOTALS)
        first, count = int(edges[k]), int(edges[k + 1] - edges[k])
        trace_plate(problem, seed, first, count, weighted, bins, totals)
        return bins / count, totals

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        parts = list(pool.map(batch, range(_BATCHES)))
    shares = np.stack([part[0] for part in parts]) / cells.projected_solid_angle
    totals = np.sum([part[1] for part in parts], axis=0)
    mean = np.average(shares, axis=0, weights=np.diff(edges))
    error = shares.std(axis=0, ddof=1) / math.sqrt(_BATCHES)
    flux = totals / rays
    flux_se = np.sqrt(variances(1.0 / rays, rays, totals[:4:2], totals[1:4:2]))
    return Goniogram(
        grid=cells,
        incidence_deg=incidence_deg,
        wavelength_nm=wavelength_nm,
        rays=rays,
        brdf=mean[0],
        brdf_se=error[0],
        btdf=mean[1],
        btdf_se=error[1],
        reflectance=float(flux[0]),
        reflectance_se=float(flux_se[0]),
        transmittance=float(flux[2]),
        transmittance_se=float(flux_se[1]),
        absorbed=float(flux[4]),
        scatterings=float(flux[5]),
    )


def measure_spectrum(
    media: dict[float, ScatteringMedium],
    thickness_mm: float,
    incidence_deg: float,
    *,
    rays: int = 100_000,
    seed: int = 1,
    grid: AngularGrid | None = None,
    weighted: bool = False,
    front: TiltDistribution = SMOOTH,
    back: TiltDistribution = SMOOTH,
) -> list[Goniogram]:
    """`measure_plate` for each wavelength [nm] of a material, on common random numbers."""
    return [
        measure_plate(
            medium,
            thickness_mm,
            incidence_deg,
            rays=rays,
            seed=seed,
            grid=grid,
            weighted=weighted,
            front=front,
            back=back,
            wavelength_nm=wavelength,
        )
        for wavelength, medium in sorted(media.items())
    ]


def plate_problem(
    medium: ScatteringMedium,
    thickness_mm: float,
    incidence_deg: float,
    *,
    grid: AngularGrid,
    front: TiltDistribution = SMOOTH,
    back: TiltDistribution = SMOOTH,
) -> PlateProblem:
    """Kernel input for one plate and beam, checked."""
    if medium.moments is not None:
        raise SceneError(
            "the plate kernel samples g and gamma, not moments; use the general tracer for other "
            "phase functions"
        )
    if not 0.0 <= incidence_deg < 90.0:
        raise SceneError(f"angle of incidence must lie in 0 <= angle < 90, got {incidence_deg:g}")
    if not 0.0 < thickness_mm < math.inf:
        raise SceneError(f"plate thickness must be finite and > 0 mm, got {thickness_mm:g}")
    return PlateProblem(
        mean_free_path=medium.mean_free_path_mm,
        absorption=medium.absorption_per_mm,
        g=medium.g,
        gamma=medium.gamma,
        refractive_index=medium.index,
        thickness=thickness_mm,
        cos_incidence=math.cos(math.radians(incidence_deg)),
        front_tilt=front.slopes,
        back_tilt=back.slopes,
        cosine_edges=grid.cosine_edges,
        n_phi=grid.n_phi,
    )
