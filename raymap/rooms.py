"""Where the packages of the product lie: beside each other, and nowhere else.

Python looks for modules in folders of which a stranger may have written one (``python -m raymap``
puts the current folder first). What lies there under our names is not executed, but named.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from raymap.model.errors import RayMapError
from raymap.model.registry import Registry

__all__ = ["ROOMS", "check_room", "home", "registries", "trusted_path"]

ROOMS = ("raymap", "tracer", "query", "viewer", "service")
"""The packages of the product."""

_HOME = Path(__file__).resolve().parent.parent


def home() -> Path:
    """The folder in which our packages lie."""
    return _HOME


def check_room(name: str) -> None:
    """Refuse a module of the name of one of our packages that is not ours; nothing is executed.

    Raises
    ------
    RayMapError
        Its place, and what to do.
    """
    if name not in ROOMS or not (_HOME / name / "__init__.py").exists():
        return
    known = sys.modules.get(name)
    spec = PathFinder.find_spec(name) if known is None else known.__spec__
    origin = None if spec is None else spec.origin
    if origin is not None and Path(origin).resolve() != _HOME / name / "__init__.py":
        raise RayMapError(
            f"{origin} hides the package {name!r} of Raymap: rename it, or start Raymap without "
            f"{str(Path(origin).parent)!r} on Python's path (the command raymap, or python -P)"
        )


def trusted_path() -> list[str]:
    """Python's path for a process that we start: ours first, nothing relative to a folder."""
    return [str(_HOME), *(folder for folder in sys.path if os.path.isabs(folder))]


def registries() -> dict[str, Registry[Any]]:
    """The registries of all installed rooms by name; each room lists its own in ``registries``."""
    found: dict[str, Registry[Any]] = {}
    for room in ROOMS:
        check_room(room)
        try:
            module = import_module(f"{room}.registries")
        except ModuleNotFoundError as error:
            if error.name not in (room, f"{room}.registries"):
                raise
            continue
        found |= module.REGISTRIES
    return found
