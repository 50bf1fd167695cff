"""The registries of this room, by name; ``raymap kinds`` lists what is in them."""

from __future__ import annotations

from typing import Any

from raymap.foreign.formats import RECORDED_FORMATS
from raymap.model.registry import Registry
from raymap.pictures.chart_formats.format import CHART_FORMATS
from raymap.pictures.pixel_formats.format import PIXEL_FORMATS
from raymap.rayfiles.formats import RAY_FORMATS

__all__ = ["REGISTRIES"]

REGISTRIES: dict[str, Registry[Any]] = {
    "recorded_formats": RECORDED_FORMATS,
    "ray_formats": RAY_FORMATS,
    "pixel_formats": PIXEL_FORMATS,
    "chart_formats": CHART_FORMATS,
}
