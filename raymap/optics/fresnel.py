"""Reflection and refraction at a smooth interface of two isotropic media.

Conventions: time dependence exp(-i w t); an absorbing medium has n + i kappa, kappa >= 0. The unit
normal points against the incident ray, so ``cos_i = -d . n >= 0``. ``s`` = d x n / |d x n| for all
three rays and ``p = d x s`` for each of them (Born & Wolf, Principles of Optics, 7th ed., 1.5.2);
at normal incidence r_p = -r_s. ``eta`` = n1 / n2, incident over transmitted.

Reflectance and transmittance are shares of *flux*, so that R + T = 1 without absorption.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inline_kernel, kernel, lean_kernel

__all__ = [
    "cos2_refracted",
    "dielectric_amplitudes",
    "fresnel_amplitudes",
    "fresnel_conductor",
    "fresnel_reflectance",
    "fresnel_terms",
    "partial_reflectance",
    "reflect",
    "reflectance_column",
    "refract",
    "schlick_reflectance",
]


@inline_kernel
def fresnel_terms(n1: Any, n2: Any, cos_i: float, cos_t: Any) -> tuple[Any, Any, Any, Any]:
    """What Fresnel's amplitudes are made of: r_s = s / below_s, r_p = p / below_p.

    The one place where the equations stand. Indices and cosines are real or complex; the amplitudes
    of refraction are t_s = 2 n1 cos_i / below_s, t_p = 2 n1 cos_i / below_p.

    Returns
    -------
    s, below_s, p, below_p

    References
    ----------
    Born & Wolf, Principles of Optics, 7th ed., 1.5.2, eqs (20), (21).
    """
    a, b = n1 * cos_i, n2 * cos_t
    c, d = n2 * cos_i, n1 * cos_t
    return a - b, a + b, c - d, c + d


@inline_kernel
def cos2_refracted(eta: float, cos_i: float) -> float:
    """Squared cosine of refraction by Snell's law, not above 0 where reflection is total."""
    return 1.0 - eta * eta * (1.0 - cos_i * cos_i)


@inline_kernel
def partial_reflectance(n1: float, n2: float, cos_i: float, cos_t: float) -> float:
    """Reflectance for unpolarised light below the critical angle, with a single division."""
    terms: tuple[float, float, float, float] = fresnel_terms(n1, n2, cos_i, cos_t)
    s, below_s, p, below_p = terms
    s, p = s * below_p, p * below_s
    below = below_s * below_p
    return 0.5 * (s * s + p * p) / (below * below)


@kernel
def fresnel_reflectance(n1: float, n2: float, cos_i: float) -> float:
    """Reflectance for unpolarised light, 1 at total internal reflection.

    Parameters
    ----------
    n1, n2 : real refractive indices before and behind the interface
    cos_i : cosine of the angle of incidence, 0 .. 1

    References
    ----------
    Born & Wolf, Principles of Optics, 7th ed., 1.5.3, eqs (33) to (36).
    """
    cos2_t = cos2_refracted(n1 / n2, cos_i)
    if cos2_t <= 0.0:
        return 1.0
    return partial_reflectance(n1, n2, cos_i, math.sqrt(cos2_t))


def reflectance_column(n1: float, n2: float, cos_i: ArrayLike) -> NDArray[np.float64]:
    """(...) `fresnel_reflectance` over cosines of any shape."""
    cosines = np.asarray(cos_i, np.float64)
    found = np.empty(cosines.size)
    _fill_reflectance(n1, n2, cosines.ravel(), found)
    return found.reshape(cosines.shape)


@lean_kernel
def _fill_reflectance(
    n1: float, n2: float, cos_i: NDArray[np.float64], found: NDArray[np.float64]
) -> None:
    for i in range(len(cos_i)):
        found[i] = fresnel_reflectance(n1, n2, cos_i[i])


@kernel
def fresnel_amplitudes(
    n1: complex, n2: complex, cos_i: float
) -> tuple[complex, complex, complex, complex, complex]:
    """Amplitude coefficients (r_s, r_p, t_s, t_p) and the complex cosine of refraction.

    Beyond the critical angle the cosine is imaginary with a positive imaginary part, so that the
    evanescent wave decays and arg r is the phase jump under exp(-i w t).

    Parameters
    ----------
    n1, n2 : complex refractive indices
    cos_i : cosine of the angle of incidence, 0 .. 1
    """
    eta = n1 / n2
    cos_t = (1.0 + 0.0j - eta * eta * (1.0 - cos_i * cos_i)) ** 0.5
    if cos_t.imag < 0.0 or (cos_t.imag == 0.0 and cos_t.real < 0.0):
        cos_t = -cos_t
    s, below_s, p, below_p = fresnel_terms(n1, n2, cos_i, cos_t)
    twice = 2.0 * n1 * cos_i
    return s / below_s, p / below_p, twice / below_s, twice / below_p, cos_t


@kernel
def dielectric_amplitudes(
    n1: float, n2: float, cos_i: float
) -> tuple[complex, complex, float, float, float]:
    """Amplitudes r_s, r_p, t_s, t_p and the cosine of refraction; 0, 0, 0 at total reflection.

    `fresnel_amplitudes` of real indices, without a complex number below the critical angle.

    Parameters
    ----------
    n1, n2 : real refractive indices before and behind the interface
    cos_i : cosine of the angle of incidence, 0 .. 1
    """
    cos2_t = cos2_refracted(n1 / n2, cos_i)
    if cos2_t > 0.0:
        cos_t = math.sqrt(cos2_t)
        s, below_s, p, below_p = fresnel_terms(n1, n2, cos_i, cos_t)
        under_s, under_p = 1.0 / below_s, 1.0 / below_p
        twice = 2.0 * n1 * cos_i
        return complex(s * under_s), complex(p * under_p), twice * under_s, twice * under_p, cos_t
    # Beyond the critical angle cos t = i g, g >= 0: the evanescent wave decays
    total_s, under_s, total_p, under_p = fresnel_terms(n1, n2, cos_i, 1j * math.sqrt(-cos2_t))
    return total_s / under_s, total_p / under_p, 0.0, 0.0, 0.0


@kernel
def fresnel_conductor(n1: float, n2: float, kappa2: float, cos_i: float) -> float:
    """Reflectance of a metal of index n2 + i kappa2 for unpolarised light."""
    r_s, r_p, _, _, _ = fresnel_amplitudes(n1 + 0.0j, n2 + 1j * kappa2, cos_i)
    return 0.5 * (abs(r_s) ** 2 + abs(r_p) ** 2)


@kernel
def schlick_reflectance(n1: float, n2: float, cos_i: float) -> float:
    """Schlick's approximation, with the larger of both angles; 1 at total internal reflection.

    References
    ----------
    C. Schlick, Computer Graphics Forum 13(3), 233 (1994), eq. (15).
    """
    cos2_t = cos2_refracted(n1 / n2, cos_i)
    if cos2_t <= 0.0:
        return 1.0
    cosine = cos_i if n1 < n2 else math.sqrt(cos2_t)
    r0 = ((n1 - n2) / (n1 + n2)) ** 2
    return r0 + (1.0 - r0) * (1.0 - cosine) ** 5


@kernel
def reflect(
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float
) -> tuple[float, float, float]:
    """Direction of specular reflection; the sign of the normal does not matter."""
    projection = 2.0 * (dx * nx + dy * ny + dz * nz)
    return dx - projection * nx, dy - projection * ny, dz - projection * nz


@kernel
def refract(
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, eta: float
) -> tuple[float, float, float, float]:
    """Direction of refraction and its cosine; cosine < 0 says total internal reflection.

    The normal points against the ray (d . n < 0); ``eta`` = n1 / n2.
    """
    cos_i = -(dx * nx + dy * ny + dz * nz)
    cos2_t = cos2_refracted(eta, cos_i)
    if cos2_t < 0.0:
        return 0.0, 0.0, 0.0, -1.0
    cos_t = math.sqrt(cos2_t)
    along = eta * cos_i - cos_t
    return eta * dx + along * nx, eta * dy + along * ny, eta * dz + along * nz, cos_t
