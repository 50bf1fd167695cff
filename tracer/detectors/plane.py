"""Detectors of kind plane."""

from __future__ import annotations

from typing import Literal

from tracer.detectors.model import DetectorModel

__all__ = ["Plane"]


class Plane(DetectorModel):
    """A rectangle that ``looks`` in a direction, from where light registers on it.

    ``up`` lies along its v axis (without it +y, or +z where it looks along y). A ``blocking`` one
    is also an object of its name, with ``surface`` (an absorber unless given).
    """

    kind: Literal["plane"] = "plane"
    keys = (
        "position",
        "looks",
        "up",
        "size",
        "cells",
        "blocking",
        "surface",
        "acceptance_deg",
        "both_sides",
    )
    needed = (
        "position",
        "looks",
        "size",
        "cells",
    )


KINDS = (Plane,)
