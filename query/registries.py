"""The registries of this room, by name; ``raymap kinds`` lists what is in them."""

from __future__ import annotations

from typing import Any

from query.answers.images.formats.format import IMAGE_FORMATS
from query.expression.registry import ATOMS
from raymap.model.registry import Registry

__all__ = ["REGISTRIES"]

REGISTRIES: dict[str, Registry[Any]] = {"atoms": ATOMS, "image_formats": IMAGE_FORMATS}
