"""Reflectances of smooth interfaces from the wave vectors across them, as oracle.

Tangential E and H are continuous; with k_z across the interface and permittivities eps,
r_s = (k1 - k2) / (k1 + k2) and r_p = (eps2 k1 - eps1 k2) / (eps2 k1 + eps1 k2) (J. D. Jackson,
Classical Electrodynamics, 3rd ed., 7.3).
"""

from __future__ import annotations

import cmath

__all__ = ["fresnel_conductor", "fresnel_reflectance"]


def _reflectance(n1: float, n2: complex, cos_i: float) -> float:
    k1 = n1 * cos_i
    k2 = cmath.sqrt(n2 * n2 - n1 * n1 * (1.0 - cos_i * cos_i))
    eps1, eps2 = n1 * n1, n2 * n2
    r_s = (k1 - k2) / (k1 + k2)
    r_p = (eps2 * k1 - eps1 * k2) / (eps2 * k1 + eps1 * k2)
    return 0.5 * (abs(r_s) ** 2 + abs(r_p) ** 2)


def fresnel_reflectance(n1: float, n2: float, cos_i: float) -> float:
    """Of unpolarised light at two dielectrics."""
    return _reflectance(n1, complex(n2), cos_i)


def fresnel_conductor(n1: float, n2: float, kappa2: float, cos_i: float) -> float:
    """Of unpolarised light at a metal n2 + i kappa2."""
    return _reflectance(n1, complex(n2, kappa2), cos_i)
