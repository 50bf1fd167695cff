"""Detectors of kind far_field."""

from __future__ import annotations

from typing import Literal

from tracer.detectors.model import DetectorModel

__all__ = ["FarField"]


class FarField(DetectorModel):
    """Directions of light that leaves the scene, by C and gamma about ``axis``."""

    kind: Literal["far_field"] = "far_field"
    keys = (
        "axis",
        "c0",
        "cells",
        "gamma_deg",
        "angles",
    )
    needed = ("cells",)


KINDS = (FarField,)
