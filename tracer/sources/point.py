"""Sources of kind point."""

from __future__ import annotations

from typing import Literal

from tracer.sources.model import SourceModel

__all__ = ["PointSource"]


class PointSource(SourceModel):
    """One point: even into all directions, or within ``cone_deg`` of its axis."""

    kind: Literal["point"] = "point"
    keys = ("cone_deg",)
    widest_deg = 180.0


KINDS = (PointSource,)
