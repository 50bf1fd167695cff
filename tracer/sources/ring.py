"""Sources of kind ring."""

from __future__ import annotations

from typing import Literal

from tracer.sources.model import SourceModel

__all__ = ["RingSource"]


class RingSource(SourceModel):
    """A Lambertian ring light of ``diameter``, and ``inner_diameter`` if it has a width.

    With ``tilt_deg`` its light leans towards the axis.
    """

    kind: Literal["ring"] = "ring"
    keys = (
        "diameter",
        "inner_diameter",
        "tilt_deg",
        "cone_deg",
    )

    def check(self) -> None:
        if self.diameter is None:
            raise ValueError("a ring source needs a diameter")


KINDS = (RingSource,)
