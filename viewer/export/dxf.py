"""Rays and scene as DXF: rays as 3D polylines, bodies as 3D faces, names as layers."""

from __future__ import annotations

import io
import logging
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from raymap.model.errors import MissingExtra
from viewer.export.content import Content
from viewer.export.format import ExportFormat

__all__ = ["DXF", "to_dxf"]

_UNITS = {"in": 1, "mm": 4, "cm": 5, "m": 6, "um": 13}
_FORBIDDEN = re.compile(r"[<>/\\\":;?*|=`,\x00-\x1f]")


def to_dxf(content: Content) -> bytes:
    """A DXF file (R2010): a layer per body, per group of rays, and one for detectors.

    Coordinates are in scene units; the file states the unit.

    Raises
    ------
    MissingExtra
        ezdxf is not installed.
    """
    try:
        logging.getLogger("ezdxf").setLevel(logging.WARNING)
        ezdxf: Any = import_module("ezdxf")
    except ImportError:
        raise MissingExtra(
            "DXF files need ezdxf, which is not installed: pip install 'raymap[cad]'"
        ) from None
    document = ezdxf.new("R2010", setup=False)
    document.header["$INSUNITS"] = _UNITS.get(content.length_unit, 0)
    document.header["$MEASUREMENT"] = 0 if content.length_unit == "in" else 1
    space = document.modelspace()
    layers = _Layers(document)
    for body in content.bodies:
        red, green, blue = (int(value) for value in np.rint(body.color * 255))
        layer = layers.add(body.name, (red, green, blue), 1.0 - body.opacity)
        for a, b, c in body.corners.astype(np.float64).tolist():
            space.add_3dface((a, b, c, c), dxfattribs={"layer": layer})
    for name, corners in content.frames:
        layer = layers.add(f"detector {name}", (0, 140, 60))
        space.add_polyline3d(corners.tolist(), close=True, dxfattribs={"layer": layer})
    for number, name in enumerate(content.groups):
        layer = layers.add(name, (90, 90, 90))
        for points, rgb in content.polylines(number):
            line = space.add_polyline3d(points.tolist(), dxfattribs={"layer": layer})
            line.rgb = rgb
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue().encode("utf-8")


class _Layers:
    """Layers of different names that DXF allows."""

    def __init__(self, document: Any) -> None:
        self._layers = document.layers

    def add(self, name: str, rgb: tuple[int, int, int], transparency: float = 0.0) -> str:
        plain = _FORBIDDEN.sub("_", name).strip()[:240] or "unnamed"
        unique, count = plain, 2
        while unique in self._layers:
            unique, count = f"{plain} {count}", count + 1
        layer = self._layers.add(unique)
        layer.rgb = rgb
        layer.transparency = transparency
        return unique


def _write(content: Content, path: Path) -> None:
    path.write_bytes(to_dxf(content))


DXF = ExportFormat(
    suffixes=(".dxf",),
    title="a layer for each body and group of rays, in scene units",
    place=3.0,
    write=_write,
)

KINDS = (DXF,)
