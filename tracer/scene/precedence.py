"""Which faces cannot be met before another one: what lets a ray's search for its next hit stop.

A ray that starts on a face (or source) D and meets a face F travels in the convex hull of both. So
it cannot meet a third face G before F if a convex set holds D and F and no inner point of G: a
half-space, the inside of a cylinder, a ball. Nor can it if G lies beyond F: on the far side of
F's plane, or outside the cylinder or ball that holds D and F; or inside the ball of F when the ray
comes from outside and enters through F.

All statements are closed: touching edges count as apart, up to a rounding of 1e-9 of the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.kinds import ANNULUS, CONE, CYLINDER, POLYGON, RECTANGLE, SPHERE
from tracer.geometry.shapes import Polygon, Rectangle, Shape

__all__ = ["Precedence"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
_ROUNDING = 1e-9
_FLAT = (ANNULUS, RECTANGLE, POLYGON)


@dataclass(frozen=True, eq=False)
class _Outline:
    """Bounds of a face for convex functions.

    points : (n, 3), the face lies in their hull
    origin, axis : of a surface of revolution, None for others
    low, high, inner, outer : range of heights along the axis, of distances from it
    profile : (n, 2) distance from the axis and height where the distance from any point of the
        axis is extreme; empty where that is not known
    """

    points: Array
    origin: Array | None = None
    axis: Array | None = None
    low: float = 0.0
    high: float = 0.0
    inner: float = 0.0
    outer: float = 0.0
    profile: Array | None = None

    def on(self, point: Array, direction: Array, rounding: float) -> bool:
        """Whether the axis is that of a line."""
        if self.axis is None or self.origin is None:
            return False
        if abs(abs(float(self.axis @ direction)) - 1.0) > 1e-12:
            return False
        away = point - self.origin
        return bool(np.linalg.norm(away - (away @ self.axis) * self.axis) <= rounding)

    def heights(self, point: Array, direction: Array) -> tuple[float, float]:
        """Range of the coordinate along a direction, counted from a point."""
        along = (self.points - point) @ direction
        low, high = float(along.min()), float(along.max())
        if self.axis is not None and self.origin is not None:
            slope = float(self.axis @ direction)
            start = float((self.origin - point) @ direction)
            ends = (start + slope * self.low, start + slope * self.high)
            reach = self.outer * max(0.0, 1.0 - slope * slope) ** 0.5
            low, high = max(low, min(ends) - reach), min(high, max(ends) + reach)
        return low, high

    def reach(self, point: Array, direction: Array, coaxial: bool) -> tuple[float, float]:
        """Range of the distance from a line."""
        if coaxial:
            return self.inner, self.outer
        away = self.points - point
        across = away - np.outer(away @ direction, direction)
        return 0.0, float(np.linalg.norm(across, axis=1).max())

    def distances(self, center: Array, coaxial: bool) -> tuple[float, float]:
        """Range of the distance from a point."""
        if coaxial and not (self.profile is None or self.axis is None or self.origin is None):
            height = float((center - self.origin) @ self.axis)
            found = np.hypot(self.profile[:, 0], self.profile[:, 1] - height)
            return float(found.min()), float(found.max())
        gap = np.maximum(0.0, np.maximum(self.points.min(0) - center, center - self.points.max(0)))
        away = np.linalg.norm(self.points - center, axis=1)
        return float(np.linalg.norm(gap)), float(away.max())


class Precedence:
    """Tables over all pairs of faces and boxes.

    Parameters
    ----------
    shapes : faces; the first numbers
    boxes : lower and upper corners of what else rays start from; the numbers after them
    """

    def __init__(self, shapes: Sequence[Shape], boxes: Sequence[tuple[Array, Array]]) -> None:
        self.n = len(shapes)
        outlines = [_outline(shape) for shape in shapes]
        outlines += [_Outline(_corners(low, high)) for low, high in boxes]
        points = np.concatenate([item.points for item in outlines])
        self._rounding = _ROUNDING * float(1.0 + np.abs(points[np.isfinite(points)]).max())
        total = len(outlines)
        # Convex sets of each face: which outlines lie inside, and which faces have no inner point
        self._holding = np.zeros((total, 10, self.n), bool)
        self._inside = np.zeros((total, self.n), bool)
        self._beyond = np.zeros((self.n, self.n), bool)
        self._cleared = np.zeros((total, self.n), bool)
        self._flat = np.array([shape.kind in _FLAT for shape in shapes], bool)
        for g, shape in enumerate(shapes):
            for s, outline in enumerate(outlines):
                self._compare(shape, outlines[g], g, outline, s)

    def _compare(self, shape: Shape, own: _Outline, g: int, other: _Outline, s: int) -> None:
        """Note how outline ``s`` lies to the sets of face ``g``."""
        tiny = self._rounding
        holding = self._holding[s, :, g]
        low, high = own.points.min(0), own.points.max(0)
        holding[0:3] = other.points.max(0) <= low + tiny
        holding[3:6] = other.points.min(0) >= high - tiny
        row = shape.row()
        point, axis = row[0:3], row[3:6]
        if not np.any(axis):
            return
        coaxial = other.on(point, axis, tiny)
        own_low, own_high = own.heights(point, axis)
        its_low, its_high = other.heights(point, axis)
        holding[6] = its_high <= own_low + tiny
        holding[7] = its_low >= own_high - tiny
        nearest, farthest = other.reach(point, axis, coaxial)
        if shape.kind == ANNULUS:
            holding[8] = row[6] > 0.0 and farthest <= row[6] ** 0.5 + tiny
        elif shape.kind == CYLINDER:
            holding[8] = s == g or farthest <= row[6] + tiny
            self._inside[s, g] = holding[8]
            if s < self.n:
                self._beyond[g, s] = s != g and nearest >= row[6] - tiny
        elif shape.kind == SPHERE:
            center = point + row[6] * axis
            least, most = other.distances(center, coaxial)
            holding[9] = s == g or most <= row[6] + tiny
            self._inside[s, g] = holding[9]
            self._cleared[s, g] = s == g or least >= row[6] - tiny
            if s < self.n:
                self._beyond[g, s] = s != g and least >= row[6] - tiny

    def excluded(self, start: int, sphere_entered: bool) -> Flags:
        """(n, n): [F, G] is set where no ray from ``start`` meets G before it meets F.

        Parameters
        ----------
        start : number of the face or box from which rays start
        sphere_entered : speaks of rays that meet spheres F from outside if they start outside
        """
        holding = self._holding[start]
        found = np.zeros((self.n, self.n), bool)
        for k in range(holding.shape[0]):
            # A convex set of G holds the start and F
            found |= self._holding[: self.n, k, :] & holding[k][None, :]
        for k in (6, 7):
            # F is flat, the start on one side of its plane, G on the other
            found |= self._flat[:, None] & holding[k][:, None] & self._holding[: self.n, 13 - k].T
        found |= self._inside[start][:, None] & self._beyond
        if sphere_entered:
            round_ = self._cleared[start] & ~self._inside[start]
            found |= round_[:, None] & self._holding[: self.n, 9, :].T
        np.fill_diagonal(found, True)
        return found


def _corners(low: Array, high: Array) -> Array:
    grid = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    return np.where(grid == 0, low, high)


def _outline(shape: Shape) -> _Outline:
    """Bounds of one face."""
    if isinstance(shape, Rectangle):
        return _Outline(shape.corners())
    if isinstance(shape, Polygon):
        return _Outline(np.asarray(shape.vertices, float))
    points = _corners(*shape.bounds())
    row = shape.row()
    if shape.kind == ANNULUS:
        inner = max(0.0, row[6]) ** 0.5
        ends = [(inner, 0.0), (row[7] ** 0.5, 0.0)]
    elif shape.kind == SPHERE:
        sag = min(row[7], 2.0 * row[6])
        ends = [(0.0, 0.0), (max(0.0, 2.0 * row[6] * sag - sag * sag) ** 0.5, sag)]
    elif shape.kind == CYLINDER:
        ends = [(row[6], row[7]), (row[6], row[8])]
    elif shape.kind == CONE:
        ends = [(row[6] + row[7] * h, h) for h in (row[8], row[9])]
    else:
        return _Outline(points)
    radii, heights = zip(*ends, strict=True)
    outer = max(radii)
    if shape.kind == SPHERE and row[7] > row[6]:
        outer = row[6]
    # Nearest to a point of the axis may be any place between the ends of a cylinder or cone
    known = shape.kind in (ANNULUS, SPHERE)
    return _Outline(
        points,
        origin=row[0:3],
        axis=row[3:6],
        low=min(heights),
        high=max(heights),
        inner=min(radii),
        outer=outer,
        profile=np.array(ends) if known else None,
    )
