"""Distributions of the local normal of rough faces, and their extraction from a measured BRDF.

p(theta_m) is the density of normals with p cos(theta_m) normalised over the hemisphere [1/sr].

References
----------
P. Beckmann, A. Spizzichino, The Scattering of Electromagnetic Waves from Rough Surfaces (1963).
K. E. Torrance, E. M. Sparrow, J. Opt. Soc. Am. 57, 1105 (1967).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.optics.fresnel import reflectance_column

__all__ = ["SMOOTH", "TiltDistribution", "gaussian_tilt", "tabulated_tilt", "tilt_from_brdf"]

_ENTRIES = 2049


@dataclass(frozen=True, kw_only=True)
class TiltDistribution:
    """Slopes of a face.

    Attributes
    ----------
    slopes : (n,) tangent of the tilt at evenly spaced cumulative probability; empty: smooth
    theta_deg, density : the distribution that they were drawn from, for plots; density [1/sr]
    """

    slopes: NDArray[np.float64]
    theta_deg: NDArray[np.float64]
    density: NDArray[np.float64]

    @property
    def rms_slope(self) -> float:
        """Root of the mean square slope, both directions together."""
        if self.slopes.size == 0:
            return 0.0
        middle = 0.5 * (self.slopes[1:] + self.slopes[:-1])
        return float(np.sqrt(np.mean(middle**2)))


SMOOTH = TiltDistribution(slopes=np.zeros(0), theta_deg=np.zeros(0), density=np.zeros(0))


def gaussian_tilt(rms_slope: float) -> TiltDistribution:
    """Gaussian slopes; ``rms_slope``² is the mean square slope of both directions together."""
    if not 0.0 <= rms_slope < 1.0:
        raise SceneError(f"rough face: rms_slope must lie in 0 <= slope < 1, got {rms_slope:g}")
    if rms_slope == 0.0:
        return SMOOTH
    u = np.linspace(0.0, 1.0, _ENTRIES)
    u[-1] = 1.0 - 1e-5
    theta = np.linspace(0.0, math.atan(3.5 * rms_slope), 91)
    tangent = np.tan(theta)
    density = np.exp(-((tangent / rms_slope) ** 2)) / (math.pi * rms_slope**2 * np.cos(theta) ** 4)
    return TiltDistribution(
        slopes=rms_slope * np.sqrt(-np.log1p(-u)), theta_deg=np.degrees(theta), density=density
    )


def tabulated_tilt(theta_deg: ArrayLike, density: ArrayLike) -> TiltDistribution:
    """A measured distribution.

    Parameters
    ----------
    theta_deg : (n,) tilts, rising from 0, below 90 [deg]
    density : (n,) p(theta_m) in any unit, not negative; normalised here
    """
    theta = np.asarray(theta_deg, np.float64)
    value = np.asarray(density, np.float64)
    good = theta.ndim == 1 and theta.size >= 2 and theta.shape == value.shape
    if not good or theta[0] != 0.0 or theta[-1] >= 90.0 or np.any(np.diff(theta) <= 0.0):
        raise SceneError("tilt distribution: tilts must rise from 0 to below 90 degrees")
    if not np.all(np.isfinite(value)) or np.any(value < 0.0) or not np.any(value > 0.0):
        raise SceneError("tilt distribution: densities must be finite, >= 0 and not all 0")
    # Integrate p cos over solid angle on a fine grid, then invert
    fine = np.radians(np.linspace(0.0, theta[-1], 20001))
    p = np.interp(np.degrees(fine), theta, value)
    parts = p * np.cos(fine) * np.sin(fine)
    cumulative = np.concatenate(([0.0], np.cumsum(0.5 * (parts[1:] + parts[:-1]))))
    mass = 2.0 * math.pi * cumulative[-1] * (fine[1] - fine[0])
    u = np.linspace(0.0, 1.0, _ENTRIES)
    rising = np.concatenate(([True], np.diff(cumulative) > 0.0))
    slopes = np.interp(u * cumulative[-1], cumulative[rising], np.tan(fine[rising]))
    return TiltDistribution(slopes=slopes, theta_deg=theta, density=value / mass)


def tilt_from_brdf(
    incidence_deg: float,
    theta_deg: ArrayLike,
    phi_deg: ArrayLike,
    surface_brdf: ArrayLike,
    *,
    index: float = 1.49,
    step_deg: float = 1.0,
) -> TiltDistribution:
    """Tilts of a face from the part of its BRDF that the volume does not explain.

    p(theta_m) = 4 cos(theta_i) cos(theta_o) f / F(theta_d), averaged over rings of the half
    vector, normalised.

    Parameters
    ----------
    incidence_deg : angle of incidence [deg]
    theta_deg, phi_deg : (n,) directions of the reflected light, phi 0 in the plane of incidence on
        the side of the specular reflection [deg]
    surface_brdf : (n,) measured BRDF less that of a smooth plate of the medium [1/sr]
    index : refractive index of the plate
    step_deg : width of the rings [deg]
    """
    theta, phi = np.radians(np.asarray(theta_deg)), np.radians(np.asarray(phi_deg))
    f = np.asarray(surface_brdf, np.float64)
    incidence = math.radians(incidence_deg)
    # Half vector between the direction to the light and the direction of the reflected light
    to_light = np.array([-math.sin(incidence), 0.0, math.cos(incidence)])
    to_eye = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    )
    half = to_light + to_eye
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    tilt = np.degrees(np.arccos(np.clip(half[..., 2], -1.0, 1.0)))
    fresnel = reflectance_column(1.0, index, np.clip(half @ to_light, 0.0, 1.0))
    p = 4.0 * math.cos(incidence) * np.cos(theta) * f / fresnel
    # Average over rings; what noise made negative is nothing
    last = max(step_deg, float(tilt.max()))
    edges = np.arange(0.0, last + 1.5 * step_deg, step_deg)
    ring = np.digitize(tilt, edges) - 1
    count = np.bincount(ring, minlength=edges.size)
    total = np.bincount(ring, weights=p, minlength=edges.size)
    filled = count > 0
    centres = (edges + 0.5 * step_deg)[filled]
    density = np.maximum(0.0, total[filled] / count[filled])
    if not np.any(density > 0.0):
        return SMOOTH
    keep = centres < 89.0
    centres, density = centres[keep], density[keep]
    return tabulated_tilt(np.concatenate(([0.0], centres)), np.concatenate((density[:1], density)))
