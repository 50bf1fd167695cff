"""Maps of faces: how the cells of an on-surface detector lie on a face, and how large they are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

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
Density = Callable[[Array, Array], Array]
_FINE, _COARSE = 48, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class FaceMap:
    """Cells on a face.

    Attributes
    ----------
    kind : FLAT_MAP (cells are rectangles across the axis) or ROUND_MAP (around it)
    center, u, v, n : frame; n is the axis, or the normal of a flat face
    first, second : width and height of a flat map, lowest and highest place of a round one
    size : full size (u, v) [scene unit]
    areas : (cells_v, cells_u), or a number where all are equal [scene unit²]
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
    areas: Array | float
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
        return _polygon(shape, cells)
    if isinstance(shape, Annulus | SphereCap | Conic):
        return _disc(shape, cells)
    raise SceneError(f"faces of kind {type(shape).__name__} have no map")


def _flat(
    center: Array, u: Array, v: Array, n: Array, size: tuple[float, float], areas: Array | float
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
    areas = np.repeat((2.0 * math.pi * radii * slant / cells[0])[:, None], cells[0], axis=1)
    middle = shape.radius + shape.slope * 0.5 * (shape.low + shape.high)
    return _round(shape.origin, u, v, shape.axis, shape.low, shape.high, middle, areas)


def _disc(shape: Annulus | SphereCap | Conic, cells: tuple[int, int]) -> FaceMap:
    """A face of revolution seen along its axis, in the square around its edge."""
    inner = 0.0
    if isinstance(shape, Annulus):
        center, axis, inner, outer = shape.origin, shape.normal, shape.inner, shape.outer
    elif isinstance(shape, SphereCap):
        center, axis = shape.vertex, shape.axis
        outer = math.sqrt(max(0.0, shape.sag * (2.0 * shape.radius - shape.sag)))
    else:
        center, axis, outer = shape.vertex, shape.axis, shape.semi_diameter
        inner = shape.inner
    u, v, _ = frame_of(axis)

    def density(x: Array, y: Array) -> Array:
        r2 = x * x + y * y
        inside = (r2 <= outer * outer) & (r2 >= inner * inner)
        slope2 = _slope2(shape, np.minimum(r2, outer * outer))
        return np.where(inside, np.sqrt(1.0 + slope2), 0.0)

    size = (2.0 * outer, 2.0 * outer)
    return _flat(center, u, v, axis, size, _integrate(density, size, cells))


def _slope2(shape: Annulus | SphereCap | Conic, r2: Array) -> Array:
    """Squared slope of a face of revolution."""
    if isinstance(shape, Annulus):
        return np.zeros_like(r2)
    if isinstance(shape, SphereCap):
        return np.asarray(r2 / np.maximum(shape.radius**2 - r2, 1e-9 * shape.radius**2))
    r = np.sqrt(r2)
    c, k = shape.curvature, 1.0 + shape.conic
    slope = c * r / np.sqrt(np.maximum(1.0 - k * c * c * r2, 1e-9))
    for power, coefficient in enumerate(shape.aspheric):
        slope = slope + (4 + 2 * power) * coefficient * r ** (3 + 2 * power)
    return np.asarray(slope * slope)


def _polygon(shape: Polygon, cells: tuple[int, int]) -> FaceMap:
    points = shape.vertices
    u = unit(points[1] - points[0])
    n = shape.normal
    v = np.cross(n, u)
    flat = np.column_stack([points @ u, points @ v])
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle = 0.5 * (low + high)
    size = (float(high[0] - low[0]), float(high[1] - low[1]))
    corners = flat - middle
    edges = np.roll(corners, -1, axis=0) - corners

    def density(x: Array, y: Array) -> Array:
        inside = np.ones(x.shape, bool)
        for corner, edge in zip(corners, edges, strict=True):
            inside &= edge[0] * (y - corner[1]) - edge[1] * (x - corner[0]) >= 0.0
        return inside.astype(np.float64)

    center = middle[0] * u + middle[1] * v + (points[0] @ n) * n
    return _flat(center, u, v, n, size, _integrate(density, size, cells))


def _integrate(density: Density, size: tuple[float, float], cells: tuple[int, int]) -> Array:
    """Integral of a density over each cell; cells at an edge are looked at more closely."""
    shape = cells[1], cells[0]
    rows, columns = (index.ravel() for index in np.indices(shape))
    areas, beside = _sampled(density, size, cells, _COARSE, rows, columns)
    # A neighbour of a cell that is partly beside the face may be cut by less than a point
    partly = ((beside > 0) & (beside < _COARSE**2)).reshape(shape)
    near = partly.copy()
    near[1:] |= partly[:-1]
    near[:-1] |= partly[1:]
    near[:, 1:] |= partly[:, :-1]
    near[:, :-1] |= partly[:, 1:]
    again = np.flatnonzero(near)
    areas[again], _ = _sampled(density, size, cells, _FINE, rows[again], columns[again])
    return areas.reshape(shape)


def _sampled(
    density: Density,
    size: tuple[float, float],
    cells: tuple[int, int],
    n: int,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
) -> tuple[Array, NDArray[np.int64]]:
    """Midpoint sums with n x n points per cell; how many points lie beside the face."""
    total = np.zeros(len(rows))
    beside = np.zeros(len(rows), np.int64)
    inside = (np.arange(n) + 0.5) / n
    for a in inside:
        y = ((rows + a) / cells[1] - 0.5) * size[1]
        for b in inside:
            values = density(((columns + b) / cells[0] - 0.5) * size[0], y)
            total += values
            beside += values == 0.0
    return total * (size[0] * size[1] / (cells[0] * cells[1]) / (n * n)), beside
