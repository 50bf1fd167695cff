"""Detectors of kind pinhole."""

from __future__ import annotations

from typing import Literal

from tracer.detectors.model import DetectorModel

__all__ = ["Pinhole"]


class Pinhole(DetectorModel):
    """A picture through a point, to which every place where light scatters is connected.

    It is summed up while tracing and has no rays.
    """

    kind: Literal["pinhole"] = "pinhole"
    keys = (
        "position",
        "looks",
        "up",
        "cells",
        "field_deg",
    )
    needed = (
        "position",
        "looks",
        "cells",
        "field_deg",
    )


KINDS = (Pinhole,)
