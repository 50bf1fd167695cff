"""Sources of kind intensity."""

from __future__ import annotations

from typing import Literal

from tracer.sources.model import SourceModel

__all__ = ["IntensitySource"]


class IntensitySource(SourceModel):
    """A table of intensities, from a point or evenly from a disc or rectangle.

    The table is ``intensity``, a ``file`` or, in Python, ``light``.
    """

    kind: Literal["intensity"] = "intensity"
    keys = (
        "intensity",
        "file",
        "light",
        "diameter",
        "size",
    )

    def check(self) -> None:
        if sum(item is not None for item in (self.intensity, self.file, self.light)) != 1:
            raise ValueError("give one of intensity (a table), file, or light")
        if self.diameter is not None and self.size is not None:
            raise ValueError("give diameter (a disc), size (a rectangle), or neither")


KINDS = (IntensitySource,)
