"""Detectors of kind surface."""

from __future__ import annotations

from typing import Literal

from tracer.detectors.model import DetectorModel

__all__ = ["SurfaceMap"]


class SurfaceMap(DetectorModel):
    """What arrives on a ``face`` ("body.face") of a body."""

    kind: Literal["surface"] = "surface"
    keys = (
        "face",
        "cells",
        "side",
        "acceptance_deg",
    )
    needed = ("face",)


KINDS = (SurfaceMap,)
