"""The registries of this room, by name; ``raymap kinds`` lists what is in them."""

from __future__ import annotations

from typing import Any

from raymap.model.registry import Registry
from viewer.export.format import EXPORT_FORMATS
from viewer.panels.panel import PANELS

__all__ = ["REGISTRIES"]

REGISTRIES: dict[str, Registry[Any]] = {
    "panels": PANELS,
    "export_formats": EXPORT_FORMATS,
}
