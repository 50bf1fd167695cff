"""Sources of kind lambertian."""

from __future__ import annotations

from typing import Literal

from tracer.sources.model import SourceModel

__all__ = ["LambertianSource"]


class LambertianSource(SourceModel):
    """A disc or rectangle that emits into the half space along its axis, or ``cone_deg`` of it."""

    kind: Literal["lambertian"] = "lambertian"
    keys = (
        "diameter",
        "inner_diameter",
        "size",
        "cone_deg",
    )

    def check(self) -> None:
        if (self.diameter is None) == (self.size is None):
            raise ValueError("give either diameter (a disc) or size (a rectangle)")


KINDS = (LambertianSource,)
