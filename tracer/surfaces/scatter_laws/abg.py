"""ABg: A / (B + rho^g)."""

from __future__ import annotations

from raymap.laws.radial import abg
from tracer.surfaces.scatter_laws.law import ScatterLaw

__all__ = ["ABG"]

ABG = ScatterLaw(word="abg", parameters=("A", "B", "g"), title="A / (B + rho^g) [1/sr]", bsdf=abg)

KINDS = (ABG,)
