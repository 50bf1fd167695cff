"""Maps of faces: how the cells of an on-surface detector lie on a face, and how large they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.optics.frames import frame_of
from tracer.compiled import FLAT_MAP, ROUND_MAP
from tracer.geometry.shapes import (
    Annulus,
    Conic,
    Cylinder,
    Frustum,
    Polygon,
    Rectangle,
    Shape,
    SphereCap,
    unit,
)

__all__ = ["FaceMap", "map_face"]

Array = NDArray[np.float64]
Law = dict[str, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class FaceMap:
    """Cells on a face.

    Attributes
    ----------
    kind : FLAT_MAP (cells are rectangles across the axis) or ROUND_MAP (around it)
    center, u, v, n : frame; n is the axis, or the normal of a flat face
    first, second : width and height of a flat map, lowest and highest place of a round one
    size : full size (u, v) [scene unit]
    areas : of cells, a number where all are equal, else one for each row [scene unit²]; or the law
        of the face, as `raymap.optics.seenfaces` reads it
    mapping : in words, for the map
    """

    kind: int
    center: Array
    u: Array
    v: Array
    n: Array
    first: float
    second: float
    size: tuple[float, float]
    areas: Array | float | Law
    mapping: str


def map_face(shape: Shape, cells: tuple[int, int]) -> FaceMap:
    """The map of an analytic face."""
    if isinstance(shape, Rectangle):
        n = np.cross(shape.u, shape.v)
        area = shape.size[0] * shape.size[1] / (cells[0] * cells[1])
        return _flat(shape.origin, shape.u, shape.v, n, shape.size, area)
    if isinstance(shape, Cylinder):
        u, v, _ = frame_of(shape.axis)
        height = shape.high - shape.low
        area = 2.0 * math.pi * shape.radius * height / (cells[0] * cells[1])
        return _round(shape.origin, u, v, shape.axis, shape.low, shape.high, shape.radius, area)
    if isinstance(shape, Frustum):
        return _cone(shape, cells)
    if isinstance(shape, SphereCap) and shape.sag > shape.radius:
        u, v, _ = frame_of(shape.axis)
        top = min(shape.sag, 2.0 * shape.radius)
        area = 2.0 * math.pi * shape.radius * top / (cells[0] * cells[1])
        return _round(shape.vertex, u, v, shape.axis, 0.0, top, shape.radius, area)
    if isinstance(shape, Polygon):
        return _polygon(shape)
    if isinstance(shape, Annulus | SphereCap | Conic):
        return _disc(shape)
    raise SceneError(f"faces of kind {type(shape).__name__} have no map")


def _flat(
    center: Array, u: Array, v: Array, n: Array, size: tuple[float, float], areas: float | Law
) -> FaceMap:
    return FaceMap(
        kind=FLAT_MAP,
        center=center,
        u=u,
        v=v,
        n=n,
        first=size[0],
        second=size[1],
        size=size,
        areas=areas,
        mapping="across",
    )


def _round(
    center: Array,
    u: Array,
    v: Array,
    axis: Array,
    low: float,
    high: float,
    radius: float,
    areas: Array | float,
) -> FaceMap:
    return FaceMap(
        kind=ROUND_MAP,
        center=center,
        u=u,
        v=v,
        n=axis,
        first=low,
        second=high,
        size=(2.0 * math.pi * radius, high - low),
        areas=areas,
        mapping="around",
    )


def _cone(shape: Frustum, cells: tuple[int, int]) -> FaceMap:
    u, v, _ = frame_of(shape.axis)
    edges = np.linspace(shape.low, shape.high, cells[1] + 1)
    radii = shape.radius + shape.slope * 0.5 * (edges[1:] + edges[:-1])
    slant = math.sqrt(1.0 + shape.slope**2) * (edges[1] - edges[0])
    areas = 2.0 * math.pi * radii * slant / cells[0]
    middle = shape.radius + shape.slope * 0.5 * (shape.low + shape.high)
    return _round(shape.origin, u, v, shape.axis, shape.low, shape.high, middle, areas)


def _disc(shape: Annulus | SphereCap | Conic) -> FaceMap:
    """A face of revolution seen along its axis, in the square around its edge."""
    law: Law = {"kind": "revolution"}
    if isinstance(shape, Annulus):
        center, axis, outer = shape.origin, shape.normal, shape.outer
        law["inner"] = shape.inner
    elif isinstance(shape, SphereCap):
        center, axis = shape.vertex, shape.axis
        outer = math.sqrt(max(0.0, shape.sag * (2.0 * shape.radius - shape.sag)))
        law["curvature"] = 1.0 / shape.radius
    else:
        center, axis, outer = shape.vertex, shape.axis, shape.semi_diameter
        law |= {"inner": shape.inner, "curvature": shape.curvature, "conic": shape.conic}
        law["aspheric"] = list(shape.aspheric)
    u, v, _ = frame_of(axis)
    return _flat(center, u, v, axis, (2.0 * outer, 2.0 * outer), law | {"outer": outer})


def _polygon(shape: Polygon) -> FaceMap:
    points = shape.vertices
    u = unit(points[1] - points[0])
    n = shape.normal
    v = np.cross(n, u)
    flat = np.column_stack([points @ u, points @ v])
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle = 0.5 * (low + high)
    size = (float(high[0] - low[0]), float(high[1] - low[1]))
    law = {"kind": "polygon", "corners": (flat - middle).tolist()}
    center = middle[0] * u + middle[1] * v + (points[0] @ n) * n
    return _flat(center, u, v, n, size, law)
