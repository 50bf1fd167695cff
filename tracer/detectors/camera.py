"""Detectors of kind camera."""

from __future__ import annotations

from typing import Literal

from tracer.detectors.model import DetectorModel

__all__ = ["Camera"]


class Camera(DetectorModel):
    """A picture by an ideal thin lens of diameter ``aperture``, sharp at the distance ``focus``.

    Rays that pass the lens register at their place in the picture.
    """

    kind: Literal["camera"] = "camera"
    keys = (
        "position",
        "looks",
        "up",
        "cells",
        "field_deg",
        "aperture",
        "focus",
    )
    needed = (
        "position",
        "looks",
        "cells",
        "field_deg",
        "aperture",
    )


KINDS = (Camera,)
