"""Parts of the product that an installation may be without: folders of our packages.

What other parts ask of them goes through entry points; a folder that is taken away takes its entry
points with it.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint
from importlib.util import find_spec

from raymap.model.errors import MissingExtra

__all__ = ["is_there", "missing_part", "part_of"]

OURS = "raymap"
"""The distribution of the product; its rooms register kinds by entry points, too."""

_ROOMS = ("raymap", "tracer", "query", "viewer", "service")


def part_of(module: str) -> str:
    """The folder of one of our packages in which a module lies; "" for modules of others."""
    names = module.split(".")
    return ".".join(names[:2]) if names[0] in _ROOMS else ""


def is_there(point: EntryPoint) -> bool:
    """Whether the part of an entry point of ours is installed; those of others always are."""
    if point.dist is not None and point.dist.name != OURS:
        return True
    try:
        return find_spec(part_of(point.module) or point.module) is not None
    except ModuleNotFoundError:
        return False


def missing_part(error: ImportError) -> MissingExtra | None:
    """The error that names the part of ours which is not installed; None for other modules."""
    missing = error.name or ""
    if not missing or part_of(missing) != missing:
        return None
    return MissingExtra(
        f"this needs {part_of(missing)}, which this installation is without: install raymap again"
    )
