"""Harvey-Shack: b [1 + (rho / width)²]^(s / 2)."""

from __future__ import annotations

from raymap.laws.radial import harvey_shack
from tracer.surfaces.scatter_laws.law import ScatterLaw

__all__ = ["HARVEY_SHACK"]

HARVEY_SHACK = ScatterLaw(
    word="harvey_shack",
    parameters=("b", "width", "s"),
    title="b (1 + (rho / width)²)^(s / 2) [1/sr]",
    bsdf=harvey_shack,
)

KINDS = (HARVEY_SHACK,)
