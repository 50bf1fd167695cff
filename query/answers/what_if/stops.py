"""Stops put into a recorded scene, as people write them: ``ring(z=30, inner=12, outer=32)``."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from query.engine.descriptions import (
    LARGEST,
    across,
    described,
    flat_place,
    number,
    pair,
    vector,
)
from raymap.model.directory import Directory
from raymap.model.errors import RayMapError
from raymap.passes.stops import FlatStop, MeshStop, Stop

__all__ = ["parse_stops"]

_KEYS = {
    "ring": ("x", "y", "z", "center", "axis", "inner", "outer", "name"),
    "rectangle": ("x", "y", "z", "center", "axis", "up", "size", "name"),
    "mesh": ("file", "scale", "position", "name"),
}
_EXAMPLES = {
    "ring": "ring(z=30, inner=12, outer=32)",
    "rectangle": "rectangle(z=30, size=[20, 10])",
    "mesh": "mesh(file='baffle.stl')",
}
_BARE = re.compile(r"(\s*mesh\s*\(\s*)([^=,'\"]+?)(\s*[,)].*)", re.DOTALL)


def parse_stops(texts: Sequence[str], directory: Directory) -> tuple[Stop, ...]:
    """Read the descriptions of stops; those without a name are called ``stop_1``, ``stop_2``, …

    Raises
    ------
    RayMapError
    """
    taken = {entry.name for entry in directory.objects}
    found: list[Stop] = []
    for text in texts:
        bare = _BARE.fullmatch(text)
        if bare:
            # mesh(file.stl): a name without quotes
            text = f"{bare[1]}file={bare[2]!r}{bare[3]}"
        word, values = described(text, "stop", _KEYS, _EXAMPLES)
        name = values.get("name", "")
        if not isinstance(name, str) or (name in taken and name):
            raise RayMapError(f"{text}: name is a text that no object is called by")
        count = 1
        while not name or name in taken:
            name, count = f"stop_{count}", count + 1
        taken.add(name)
        found.append(_MAKERS[word](text, name, values))
    return tuple(found)


def _ring(text: str, name: str, values: dict[str, Any]) -> Stop:
    center, axis, _ = flat_place(text, values, "axis")
    if "outer" not in values:
        raise RayMapError(f"{text}: outer is missing, the outer radius")
    inner = number(text, "inner", values.get("inner", 0.0), 0.0, LARGEST)
    outer = number(text, "outer", values["outer"], 1e-30, LARGEST)
    if not inner < outer:
        raise RayMapError(f"{text}: inner is the smaller radius")
    u, v = across(axis, None, text)
    return FlatStop(name=name, center=center, axis_u=u, axis_v=v, size=(inner, outer), is_ring=True)


def _rectangle(text: str, name: str, values: dict[str, Any]) -> Stop:
    center, axis, _ = flat_place(text, values, "axis")
    if "size" not in values:
        raise RayMapError(f"{text}: size is missing, as size=[20, 10]")
    width, height = pair(text, "size", values["size"], 1e-30, LARGEST)
    up = None if "up" not in values else vector(text, "up", values["up"], unit=True)
    u, v = across(axis, up, text)
    return FlatStop(
        name=name, center=center, axis_u=u, axis_v=v, size=(width / 2.0, height / 2.0),
        is_ring=False,
    )  # fmt: skip


def _mesh(text: str, name: str, values: dict[str, Any]) -> Stop:
    if not isinstance(values.get("file"), str):
        raise RayMapError(f"{text}: file is missing, as {_EXAMPLES['mesh']}")
    scale = number(text, "scale", values.get("scale", 1.0), 1e-15, LARGEST)
    position = vector(text, "position", values.get("position", [0, 0, 0]))
    vertices, triangles = _reader()(Path(values["file"]), scale)
    return MeshStop(name=name, vertices=np.asarray(vertices) + position, triangles=triangles)


def _reader() -> Callable[[Path, float], tuple[Any, Any]]:
    """What reads files of triangles: the tracer's, which registers it."""
    readers = [point.load() for point in entry_points(group="raymap.meshes")]
    if not readers:
        raise RayMapError("nothing is installed that reads mesh files; use ring or rectangle")
    reader: Callable[[Path, float], tuple[Any, Any]] = readers[0]
    return reader


_MAKERS: dict[str, Callable[[str, str, dict[str, Any]], Stop]] = {
    "ring": _ring,
    "rectangle": _rectangle,
    "mesh": _mesh,
}
