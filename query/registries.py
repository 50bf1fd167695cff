"""The registries of this room, by name; ``raymap kinds`` lists what is in them."""

from __future__ import annotations

from typing import Any

from query.expression.registry import ATOMS
from raymap.model.registry import Registry

__all__ = ["REGISTRIES"]

REGISTRIES: dict[str, Registry[Any]] = {"atoms": ATOMS}
