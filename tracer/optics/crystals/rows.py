"""A medium as one row of numbers, the form in which compiled functions take it.

Tensor entries are in world coordinates. ``kind`` decides which closed forms apply: 0 isotropic,
1 uniaxial, 2 biaxial.
"""

from __future__ import annotations

__all__ = [
    "AXIS",
    "BIAXIAL",
    "EPS",
    "EPS_ABSORPTION",
    "EPS_EXTRAORDINARY",
    "EPS_ORDINARY",
    "ISOTROPIC",
    "KIND",
    "ROW",
    "UNIAXIAL",
]

ISOTROPIC, UNIAXIAL, BIAXIAL = 0, 1, 2

KIND = 0
EPS = 1
"""First of e11, e22, e33, e12, e13, e23 of the real dielectric tensor."""
AXIS = 7
"""First of the three components of the unit optic axis (uniaxial)."""
EPS_ORDINARY = 10
"""n_o^2; n^2 of an isotropic medium."""
EPS_EXTRAORDINARY = 11
EPS_ABSORPTION = 12
"""First of the six entries of the imaginary part of the dielectric tensor, order as ``EPS``."""
ROW = 18
