"""Reflection and refraction at a smooth interface of two isotropic media.

Conventions: time dependence exp(-i w t); an absorbing medium has n + i kappa, kappa >= 0. The unit
normal points against the incident ray, so ``cos_i = -d . n >= 0``. ``s`` = d x n / |d x n| for all
three rays and ``p = d x s`` for each of them (Born & Wolf, Principles of Optics, 7th ed., 1.5.2);
at normal incidence r_p = -r_s. ``eta`` = n1 / n2, incident over transmitted.

Reflectance and transmittance are shares of *flux*, so that R + T = 1 without absorption.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import kernel

__all__ = [
    "fresnel_amplitudes",
    "fresnel_conductor",
    "fresnel_reflectance",
    "reflect",
    "refract",
    "schlick_reflectance",
]


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
    eta = n1 / n2
    sin2_t = eta * eta * (1.0 - cos_i * cos_i)
    if sin2_t >= 1.0:
        return 1.0
    cos_t = math.sqrt(1.0 - sin2_t)
    r_s = (n1 * cos_i - n2 * cos_t) / (n1 * cos_i + n2 * cos_t)
    r_p = (n2 * cos_i - n1 * cos_t) / (n2 * cos_i + n1 * cos_t)
    return 0.5 * (r_s * r_s + r_p * r_p)


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

    References
    ----------
    Born & Wolf, Principles of Optics, 7th ed., 1.5.2, eqs (20), (21).
    """
    eta = n1 / n2
    cos_t = (1.0 + 0.0j - eta * eta * (1.0 - cos_i * cos_i)) ** 0.5
    if cos_t.imag < 0.0 or (cos_t.imag == 0.0 and cos_t.real < 0.0):
        cos_t = -cos_t
    r_s = (n1 * cos_i - n2 * cos_t) / (n1 * cos_i + n2 * cos_t)
    r_p = (n2 * cos_i - n1 * cos_t) / (n2 * cos_i + n1 * cos_t)
    t_s = 2.0 * n1 * cos_i / (n1 * cos_i + n2 * cos_t)
    t_p = 2.0 * n1 * cos_i / (n2 * cos_i + n1 * cos_t)
    return r_s, r_p, t_s, t_p, cos_t


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
    sin2_t = (n1 / n2) ** 2 * (1.0 - cos_i * cos_i)
    if sin2_t >= 1.0:
        return 1.0
    cosine = cos_i if n1 < n2 else math.sqrt(1.0 - sin2_t)
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
    cos2_t = 1.0 - eta * eta * (1.0 - cos_i * cos_i)
    if cos2_t < 0.0:
        return 0.0, 0.0, 0.0, -1.0
    cos_t = math.sqrt(cos2_t)
    along = eta * cos_i - cos_t
    return eta * dx + along * nx, eta * dy + along * ny, eta * dz + along * nz, cos_t
