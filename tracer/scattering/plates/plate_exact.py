"""Reflection and transmission of scattering plates, exactly: doubling taken to its limit.

Adding–doubling builds the reflection and transmission operators R, T of a layer from thinner and
thinner halves. For a homogeneous layer the limit of that process has a closed form. Light that
falls on both faces alike (even) or with opposite signs (odd) sees the operators R + T and R - T,
and with the eigenvalues k and modes U of the transfer matrix (one symmetric eigenproblem for a
medium, whatever the thickness b) the plate between two Fresnel faces is one symmetric positive
system each::

    (U' Q U + diag(k tanh(k b/2))) c = U' 2 g / (1 + F)      even;  k coth(k b/2)  odd

F is the internal Fresnel reflectance at the nodes, Q = (1 - F) / (1 + F), g the light that the
face lets in. There is no thin starting layer and no chain of matrix products, so three plates at
six angles take about a millisecond, and any thickness costs the same.

R and T at an angle of incidence follow by reciprocity: a plate lit by uniform radiance sends back
into each direction the radiance share that it reflects (transmits) of a beam from there.

References
----------
H. C. van de Hulst, Multiple Light Scattering, Academic Press (1980), ch. 4 (doubling).
K. Stamnes et al., Applied Optics 27, 2502 (1988): discrete ordinates.
T. Nakajima, M. Tanaka, J. Quant. Spectrosc. Radiat. Transfer 35, 13 (1986): symmetric eigenproblem.
W. J. Wiscombe, J. Atmos. Sci. 34, 1408 (1977): delta-M.
S. A. Prahl, M. J. C. van Gemert, A. J. Welch, Applied Optics 32, 559 (1993): Fresnel boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.optics.fresnel import reflectance_column
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.quadrature import (
    PlateDirections,
    legendre_functions,
    plate_directions,
)

__all__ = ["ExactPlates", "PlateResponse", "reflectance_transmittance", "unscattered"]

Column = NDArray[np.float64]

NODES = (16, 24, 32, 48, 64, 96)
"""Numbers of nodes on each side of the critical angle, for phase functions more and more peaked."""


@dataclass(frozen=True, kw_only=True)
class PlateResponse:
    """Shares of the incident flux.

    Attributes
    ----------
    reflectance, transmittance : (n_plates, n_angles); the first reflection and the unscattered
        light are included
    btdf : (n_plates, n_section) of a beam at normal incidence [1/sr], without the direct beam
    """

    reflectance: Column
    transmittance: Column
    btdf: Column = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True, kw_only=True)
class LayerModes:
    """Eigenmodes of a medium for one azimuthal order.

    Attributes
    ----------
    extinction : extinction coefficient after delta-M [1/mm]
    rates : (n,) decay of the modes k >= 0, per unit optical depth
    modes : (n, n) U
    boundary : (n, n) U' Q U
    """

    extinction: float
    rates: Column
    modes: Column
    boundary: Column

    def amplitudes(self, thickness_mm: float, drive: Column, *, odd: bool) -> Column:
        """Amplitudes c of the modes for even or odd light; ``drive`` = U' 2 g / (1 + F)."""
        depth = self.extinction * thickness_mm
        k = np.maximum(self.rates, 1e-5 / depth)
        slope = np.tanh(0.5 * depth * k)
        system = self.boundary + np.diag(k / slope if odd else k * slope)
        return np.asarray(np.linalg.solve(system, drive), np.float64)


def layer_modes(
    directions: PlateDirections, functions: Column, mode: int, medium: ScatteringMedium
) -> LayerModes:
    """Eigenmodes of a medium on the nodes; ``functions`` = `legendre_functions` x sqrt(weight)."""
    # Take the part of the forward peak that the nodes cannot resolve as unscattered (delta-M)
    moments = medium.legendre_moments(directions.order)
    forward = moments[-1]
    extinction, albedo = medium.extinction_per_mm, medium.albedo
    l = np.arange(mode, directions.order)  # noqa: E741
    strength = albedo / (1.0 - albedo * forward) * (2 * l + 1) * (moments[mode:-1] - forward)
    extinction *= 1.0 - albedo * forward
    # Set up the symmetric operators of the sum and the difference of both hemispheres
    used = functions[: l.size]
    identity = np.eye(directions.cosines.size)
    even = identity - (used[0::2].T * strength[0::2]) @ used[0::2]
    odd = identity - (used[1::2].T * strength[1::2]) @ used[1::2]
    # Take singular values of their roots: eigenvalues of the product would lose the slow modes
    scale = 1.0 / np.sqrt(directions.cosines)[:, None]
    root = scale * _square_root(odd)
    _, rates, vectors = np.linalg.svd((scale * _square_root(even)).T @ root)
    modes = root @ vectors.T
    q = (1.0 - directions.fresnel) / (1.0 + directions.fresnel)
    return LayerModes(
        extinction=extinction,
        rates=rates,
        modes=modes,
        boundary=(modes.T * q) @ modes,
    )


def _square_root(matrix: Column) -> Column:
    """Some A with A A' = matrix; rounding may leave a medium without absorption below zero."""
    try:
        return np.asarray(np.linalg.cholesky(matrix), np.float64)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), np.float64)


def enough_nodes(medium: ScatteringMedium) -> int:
    """Nodes that resolve the phase function: the first moment left out is below 0.01."""
    if medium.moments is not None:
        return min(NODES[-1], max(8, (medium.moments.size - 1) // 2))
    moments = np.abs(medium.legendre_moments(2 * NODES[-1]))
    for nodes in NODES:
        if moments[2 * nodes] < 0.01:
            return nodes
    return NODES[-1]


class ExactPlates:
    """Exact R and T of plates at fixed angles; reuse one for many media.

    Parameters
    ----------
    index : refractive index of the plates
    incidence_deg : (k,) angles of incidence in air, 0 <= angle < 90 [deg]
    section_deg : (j,) polar angles at which the BTDF for normal incidence is wanted too [deg]
    nodes : Gauss nodes on each side of the critical angle; 16 give R and T within 3e-5 unless the
        phase function is sharply peaked, see `enough_nodes`
    """

    def __init__(
        self,
        *,
        index: float,
        incidence_deg: ArrayLike,
        section_deg: ArrayLike = (),
        nodes: int = NODES[0],
    ) -> None:
        self.incidence_deg = np.atleast_1d(np.asarray(incidence_deg, np.float64))
        self.section_deg = np.atleast_1d(np.asarray(section_deg, np.float64))
        angles = np.concatenate((self.incidence_deg, self.section_deg))
        if not np.all((angles >= 0.0) & (angles < 90.0)):
            raise SceneError(
                f"angles of incidence must lie in 0 <= angle < 90 degrees, got {angles}"
            )
        outside = np.cos(np.radians(angles))
        self._beam = self.section_deg.size > 0
        watched = np.concatenate((outside, [1.0])) if self._beam else outside
        weight = 1e-8 if self._beam else 1e-12
        self.directions = plate_directions(index, watched, nodes, watch_weight=weight)
        self._functions = legendre_functions(
            0, self.directions.order, self.directions.cosines
        ) * np.sqrt(self.directions.weights)
        self._first_reflection = reflectance_column(1.0, index, outside[: self.incidence_deg.size])

    def solve(self, medium: ScatteringMedium, thickness_mm: ArrayLike) -> PlateResponse:
        """R and T of plates of a medium.

        Parameters
        ----------
        medium : its index must be the one of this solver
        thickness_mm : (n,) plate thicknesses [mm]
        """
        plates = check_plates(medium, thickness_mm, self.directions.index)
        at = self.directions
        modes = layer_modes(at, self._functions, 0, medium)
        # Light both faces with radiance 1 from outside; with a beam of irradiance 1
        measure = np.sqrt(at.weights * at.cosines)
        entering = (measure * (1.0 - at.fresnel) * at.index**2)[:, None]
        if self._beam:
            beam = np.zeros_like(entering)
            beam[-1] = (1.0 - at.fresnel[-1]) / (2.0 * np.pi * measure[-1])
            entering = np.hstack((entering, beam))
        drive = modes.modes.T @ (2.0 * entering / (1.0 + at.fresnel)[:, None])
        watched = slice(at.cosines.size - at.watched, None)
        leave = (1.0 - at.fresnel[watched])[:, None] / at.index**2
        out = np.empty((2, plates.size, at.watched, entering.shape[1]))
        for i, thickness in enumerate(plates):
            for odd in (0, 1):
                amplitudes = modes.amplitudes(thickness, drive, odd=bool(odd))
                out[odd, i] = leaving_radiance(at, modes, amplitudes, entering)[watched] * leave
        reflected, transmitted = 0.5 * (out[0] + out[1]), 0.5 * (out[0] - out[1])
        angles = self.incidence_deg.size
        section = slice(angles, angles + self.section_deg.size)
        return PlateResponse(
            reflectance=reflected[:, :angles, 0] + self._first_reflection,
            transmittance=transmitted[:, :angles, 0],
            btdf=transmitted[:, section, -1],
        )


def leaving_radiance(
    at: PlateDirections, modes: LayerModes, amplitudes: Column, entering: Column
) -> Column:
    """Radiance (n, ...) that arrives from inside at the lit face, at every node."""
    shape = (-1,) + (1,) * (entering.ndim - 1)
    fresnel = at.fresnel.reshape(shape)
    both = modes.modes @ amplitudes
    difference = (2.0 * entering - (1.0 - fresnel) * both) / (1.0 + fresnel)
    scale = np.sqrt(at.weights * at.cosines).reshape(shape)
    return np.asarray(0.5 * (both - difference) / scale)


def check_plates(medium: ScatteringMedium, thickness_mm: ArrayLike, index: float) -> Column:
    """Thicknesses as a column; refuse what the model cannot mean."""
    plates = np.atleast_1d(np.asarray(thickness_mm, np.float64))
    if not np.all((plates > 0.0) & np.isfinite(plates)):
        raise SceneError(f"plate thicknesses must be finite and > 0 mm, got {plates}")
    if medium.index != index:
        raise SceneError(f"this solver is for index {index:g}, the medium has {medium.index:g}")
    return plates


def reflectance_transmittance(
    medium: ScatteringMedium,
    thickness_mm: ArrayLike,
    incidence_deg: ArrayLike,
    *,
    nodes: int | None = None,
) -> PlateResponse:
    """Exact R and T of plates of one medium at the given angles of incidence [deg].

    ``nodes`` defaults to what its phase function needs.
    """
    solver = ExactPlates(
        index=medium.index, incidence_deg=incidence_deg, nodes=nodes or enough_nodes(medium)
    )
    return solver.solve(medium, thickness_mm)


def unscattered(
    medium: ScatteringMedium, thickness_mm: ArrayLike, incidence_deg: ArrayLike
) -> PlateResponse:
    """Part of R and T that never scatters: specular reflection and the direct beam."""
    plates = check_plates(medium, thickness_mm, medium.index)[:, None]
    outside = np.cos(np.radians(np.atleast_1d(np.asarray(incidence_deg, np.float64))))
    face = reflectance_column(1.0, medium.index, outside)
    inside = np.sqrt(1.0 - (1.0 - outside**2) / medium.index**2)
    pass_once = np.exp(-medium.extinction_per_mm * plates / inside)
    between = 1.0 - (face * pass_once) ** 2
    return PlateResponse(
        reflectance=face + (1.0 - face) ** 2 * face * pass_once**2 / between,
        transmittance=(1.0 - face) ** 2 * pass_once / between,
    )
