"""States of polarised light: the complex field of a ray and what can be read from it.

Conventions. Time dependence exp(-i w t), so travelling a length L in index n multiplies the field
by exp(+i k0 n L) with k0 = 2 pi / vacuum wavelength. A ray carries a complex vector in global
coordinates that is perpendicular to its direction; its squared length is the *flux* of the ray's
tube, not an irradiance, so that fluxes of reflected and refracted rays add up to the incident one.
Phases of interfaces are in the field, the phase of the path is 2 pi / wavelength times the optical
path that travels beside it.

Transverse axes (x, y) of a ray of direction d form a right-handed triad: y = d x x. Stokes vectors
follow Born & Wolf: s3 > 0 is right-handed light (clockwise for an observer who looks against the
ray), which under exp(-i w t) is s3 = -2 Im(conj(E_x) E_y).

All functions take arrays of shape (..., 3) and broadcast.

References
----------
M. Born, E. Wolf, Principles of Optics, 7th ed., 1.4.2 (eqs 43 to 45), 10.9.3 (eqs 62 to 65).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "azimuth",
    "coherency",
    "degree_of_polarization",
    "ellipticity",
    "field_from_jones",
    "jones",
    "linear_field",
    "stokes",
    "stokes_from_coherency",
]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


def jones(field: ArrayLike, x: ArrayLike, y: ArrayLike) -> Complex:
    """Jones vector (..., 2): the components of a field (..., 3) along x and y."""
    e = np.asarray(field, np.complex128)
    return np.stack(
        [np.sum(e * np.asarray(x), axis=-1), np.sum(e * np.asarray(y), axis=-1)], axis=-1
    )


def field_from_jones(vector: ArrayLike, x: ArrayLike, y: ArrayLike) -> Complex:
    """Field (..., 3) of a Jones vector (..., 2) whose axes are x and y."""
    v = np.asarray(vector, np.complex128)
    result: Complex = v[..., 0:1] * np.asarray(x) + v[..., 1:2] * np.asarray(y)
    return result


def linear_field(flux: ArrayLike, vibration: ArrayLike, phase: ArrayLike = 0.0) -> Complex:
    """Field (..., 3) of linearly polarised light: sqrt(flux) v exp(i phase), v a unit vector."""
    amplitude = np.sqrt(np.asarray(flux, np.float64)) * np.exp(1j * np.asarray(phase, np.float64))
    result: Complex = amplitude[..., np.newaxis] * np.asarray(vibration, np.float64)
    return result


def coherency(field: ArrayLike) -> Complex:
    """Coherency matrix E E^H, (..., 3, 3): the state without its meaningless common phase."""
    e = np.asarray(field, np.complex128)
    result: Complex = e[..., :, np.newaxis] * np.conj(e[..., np.newaxis, :])
    return result


def stokes(field: ArrayLike, x: ArrayLike, y: ArrayLike) -> Real:
    """Stokes vector (..., 4) of a field, relative to its axes x and y."""
    v = jones(field, x, y)
    first, second = v[..., 0], v[..., 1]
    product = np.conj(first) * second
    power_x, power_y = np.abs(first) ** 2, np.abs(second) ** 2
    return np.stack(
        [power_x + power_y, power_x - power_y, 2.0 * product.real, -2.0 * product.imag], axis=-1
    )


def stokes_from_coherency(matrix: ArrayLike, x: ArrayLike, y: ArrayLike) -> Real:
    """Stokes vector (..., 4) of a coherency matrix (..., 3, 3); sums of matrices are allowed."""
    m = np.asarray(matrix, np.complex128)
    ax, ay = np.asarray(x, np.float64), np.asarray(y, np.float64)
    jxx = np.einsum("...i,...ij,...j->...", ax, m, ax).real
    jyy = np.einsum("...i,...ij,...j->...", ay, m, ay).real
    jyx = np.einsum("...i,...ij,...j->...", ay, m, ax)
    return np.stack([jxx + jyy, jxx - jyy, 2.0 * jyx.real, -2.0 * jyx.imag], axis=-1)


def degree_of_polarization(vector: ArrayLike) -> Real:
    """Degree of polarisation of Stokes vectors (..., 4), 0 .. 1; 0 where there is no light."""
    s = np.asarray(vector, np.float64)
    polarised = np.sqrt(np.sum(s[..., 1:] ** 2, axis=-1))
    total = s[..., 0]
    return np.where(total > 0.0, polarised / np.where(total > 0.0, total, 1.0), 0.0)


def azimuth(vector: ArrayLike) -> Real:
    """Angle from x to the major axis of the ellipse, towards y [rad], in (-pi/2, pi/2]."""
    s = np.asarray(vector, np.float64)
    result: Real = 0.5 * np.arctan2(s[..., 2], s[..., 1])
    return result


def ellipticity(vector: ArrayLike) -> Real:
    """Angle whose tangent is the ratio of the axes [rad], -pi/4 .. pi/4, positive right-handed."""
    s = np.asarray(vector, np.float64)
    result: Real = 0.5 * np.arctan2(s[..., 3], np.hypot(s[..., 1], s[..., 2]))
    return result
