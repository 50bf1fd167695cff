"""Sources of kind collimated."""

from __future__ import annotations

from typing import Literal

from tracer.sources.model import SourceModel

__all__ = ["Collimated"]


class Collimated(SourceModel):
    """A parallel beam from a disc (``diameter``) or rectangle (``size``).

    It goes along ``direction``, or through the point ``aim`` with the given direction, starting
    ``distance`` before it.
    """

    kind: Literal["collimated"] = "collimated"
    keys = (
        "diameter",
        "inner_diameter",
        "size",
        "direction",
        "aim",
        "distance",
    )

    def check(self) -> None:
        if (self.diameter is None) == (self.size is None):
            raise ValueError("give either diameter (a disc) or size (a rectangle)")


KINDS = (Collimated,)
