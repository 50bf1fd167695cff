"""BRDF and BTDF of a smooth scattering plate from the exact model, one azimuthal order at a time.

The beam enters through a watched direction and leaves through others. Each order m of the Fourier
series in azimuth is a plate problem of its own with the functions P_l^m; normal incidence needs
m = 0 alone. Unscattered light (specular reflection, direct beam) is a delta peak and not included.

References
----------
S. Chandrasekhar, Radiative Transfer, Dover (1960), ch. VI: azimuthal decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_exact import (
    check_plates,
    enough_nodes,
    layer_modes,
    leaving_radiance,
)
from tracer.scattering.plates.quadrature import legendre_functions, plate_directions

__all__ = ["ScatteredLight", "plate_bsdf"]

_WATCH_WEIGHT = 1e-8
_NEGLIGIBLE = 1e-6


@dataclass(frozen=True, kw_only=True)
class ScatteredLight:
    """Scattering distribution functions [1/sr]: radiance over irradiance.

    Attributes
    ----------
    theta_deg : (n,) polar angles in air from the normal of the side that the light leaves [deg]
    phi_deg : (k,) azimuths; 0: the light goes on forwards in the plane of incidence [deg]
    brdf, btdf : (n, k)
    """

    theta_deg: NDArray[np.float64]
    phi_deg: NDArray[np.float64]
    brdf: NDArray[np.float64]
    btdf: NDArray[np.float64]


def plate_bsdf(
    medium: ScatteringMedium,
    thickness_mm: float,
    incidence_deg: float,
    theta_deg: ArrayLike,
    phi_deg: ArrayLike = 0.0,
    *,
    nodes: int | None = None,
) -> ScatteredLight:
    """Exact BRDF and BTDF of one plate for one angle of incidence.

    Parameters
    ----------
    medium : of the plate, with smooth faces in air
    thickness_mm : of the plate [mm]
    incidence_deg : angle of incidence in air, 0 <= angle < 90 [deg]
    theta_deg : (n,) polar angles of the leaving light, 0 <= angle < 90 [deg]
    phi_deg : (k,) azimuths of the leaving light; 0 is the side of the specular reflection [deg]
    nodes : Gauss nodes on each side of the critical angle; defaults to what the medium needs
    """
    check_plates(medium, thickness_mm, medium.index)
    theta = np.atleast_1d(np.asarray(theta_deg, np.float64))
    phi = np.atleast_1d(np.asarray(phi_deg, np.float64))
    angles = np.concatenate(([incidence_deg], theta))
    if not np.all((angles >= 0.0) & (angles < 90.0)):
        raise SceneError("angles from the normal must lie in 0 <= angle < 90 degrees")
    at = plate_directions(
        medium.index,
        np.cos(np.radians(angles)),
        nodes or max(24, enough_nodes(medium)),
        watch_weight=_WATCH_WEIGHT,
    )
    source = at.cosines.size - at.watched
    brdf = np.zeros((theta.size, phi.size))
    btdf = np.zeros_like(brdf)
    highest = at.order - 1 if incidence_deg > 0.0 else 0
    for mode in range(highest + 1):
        functions = legendre_functions(mode, at.order, at.cosines) * np.sqrt(at.weights)
        modes = layer_modes(at, functions, mode, medium)
        # Send in this order of a beam of unit irradiance
        entering = np.zeros(at.cosines.size)
        share = (2.0 if mode else 1.0) / (2.0 * np.pi)
        entering[source] = (
            share * (1.0 - at.fresnel[source]) / np.sqrt(at.weights[source] * at.cosines[source])
        )
        drive = modes.modes.T @ (2.0 * entering / (1.0 + at.fresnel))
        sides = [
            leaving_radiance(at, modes, modes.amplitudes(thickness_mm, drive, odd=odd), entering)[
                source + 1 :
            ]
            * (1.0 - at.fresnel[source + 1 :])
            / at.index**2
            for odd in (False, True)
        ]
        # Add it to the series until it no longer counts
        wave = np.cos(mode * np.radians(phi))
        brdf += np.outer(0.5 * (sides[0] + sides[1]), wave)
        btdf += np.outer(0.5 * (sides[0] - sides[1]), wave)
        largest = max(np.abs(sides[0]).max(), np.abs(sides[1]).max())
        if mode and largest < _NEGLIGIBLE * max(np.abs(brdf).max(), np.abs(btdf).max()):
            break
    return ScatteredLight(theta_deg=theta, phi_deg=phi, brdf=brdf, btdf=btdf)
