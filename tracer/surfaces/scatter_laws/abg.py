"""ABg: A / (B + rho^g)."""

from __future__ import annotations

from raymap.laws.radial import abg
from tracer.surfaces.scatter_laws.law import ScatterLaw

__all__ = ["ABG"]

ABG = ScatterLaw(word="abg", parameters=("A", "B", "g"), bsdf=abg)

KINDS = (ABG,)
