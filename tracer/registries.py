"""The registries of this room, by name; ``raymap kinds`` lists what is in them."""

from __future__ import annotations

from typing import Any

from raymap.model.registry import Registry
from tracer.importers.cad_format import CAD_FORMATS
from tracer.importers.lens_format import LENS_FORMATS
from tracer.light import LIGHT_FORMATS

__all__ = ["REGISTRIES"]

REGISTRIES: dict[str, Registry[Any]] = {
    "lens_formats": LENS_FORMATS,
    "cad_formats": CAD_FORMATS,
    "light_formats": LIGHT_FORMATS,
}
