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
from dataclasses import dataclass, field

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
    origin, axis : of a surface of revolution, zero for others
    low, high, inner, outer : range of heights along the axis, of distances from it
    profile : (2, 2) distance from the axis and height where the distance from any point of the
        axis is extreme; nan where that is not known
    """

    points: Array
    origin: Array = field(default_factory=lambda: np.zeros(3))
    axis: Array = field(default_factory=lambda: np.zeros(3))
    low: float = 0.0
    high: float = 0.0
    inner: float = 0.0
    outer: float = 0.0
    profile: Array = field(default_factory=lambda: np.full((2, 2), np.nan))


class _Outlines:
    """Bounds of all faces and boxes, compared together: columns of what `_Outline` says."""

    def __init__(self, outlines: Sequence[_Outline]) -> None:
        most = max(len(item.points) for item in outlines)
        # Repeated points change no hull
        grid = [item.points[np.arange(most) % len(item.points)] for item in outlines]
        self.points = np.array(grid)
        self.lowest, self.highest = self.points.min(axis=1), self.points.max(axis=1)
        self.origin = np.array([item.origin for item in outlines])
        self.axis = np.array([item.axis for item in outlines])
        self.turned = self.axis.any(axis=1)
        limits = [(item.low, item.high, item.inner, item.outer) for item in outlines]
        self.low, self.high, self.inner, self.outer = np.array(limits).T
        self.profile = np.array([item.profile for item in outlines])
        self.known = ~np.isnan(self.profile).any(axis=(1, 2))

    def on(self, point: Array, direction: Array, rounding: float) -> Flags:
        """Whose axis is that of a line."""
        along = np.abs(np.abs(self.axis @ direction) - 1.0) <= 1e-12
        away = point - self.origin
        across = away - (away * self.axis).sum(axis=1)[:, None] * self.axis
        near = np.linalg.norm(across, axis=1) <= rounding
        return np.asarray(self.turned & along & near)

    def heights(self, point: Array, direction: Array) -> tuple[Array, Array]:
        """Range of the coordinate along a direction, counted from a point."""
        along = (self.points - point) @ direction
        slope = self.axis @ direction
        start = (self.origin - point) @ direction
        first, last = start + slope * self.low, start + slope * self.high
        # The sine, from what is left of the axis: 1 - slope² has lost it where both are parallel
        reach = self.outer * np.linalg.norm(self.axis - slope[:, None] * direction, axis=1)
        low, high = along.min(axis=1), along.max(axis=1)
        least = np.maximum(low, np.minimum(first, last) - reach)
        most = np.minimum(high, np.maximum(first, last) + reach)
        return np.where(self.turned, least, low), np.where(self.turned, most, high)

    def reach(self, point: Array, direction: Array, coaxial: Flags) -> tuple[Array, Array]:
        """Range of the distance from a line."""
        away = self.points - point
        across = away - (away @ direction)[..., None] * direction
        farthest = np.linalg.norm(across, axis=2).max(axis=1)
        return np.where(coaxial, self.inner, 0.0), np.where(coaxial, self.outer, farthest)

    def distances(self, center: Array, coaxial: Flags) -> tuple[Array, Array]:
        """Range of the distance from a point."""
        gap = np.maximum(0.0, np.maximum(self.lowest - center, center - self.highest))
        least = np.linalg.norm(gap, axis=1)
        most = np.linalg.norm(self.points - center, axis=2).max(axis=1)
        known = coaxial & self.known
        height = ((center - self.origin) * self.axis).sum(axis=1)
        found = np.hypot(self.profile[:, :, 0], self.profile[:, :, 1] - height[:, None])
        return np.where(known, found.min(axis=1), least), np.where(known, found.max(axis=1), most)


class Precedence:
    """Tables over all pairs of faces and boxes.

    Parameters
    ----------
    shapes : faces; the first numbers
    boxes : lower and upper corners of what else rays start from; the numbers after them
    """

    def __init__(self, shapes: Sequence[Shape], boxes: Sequence[tuple[Array, Array]]) -> None:
        self.n = len(shapes)
        items = [_outline(shape) for shape in shapes]
        items += [_Outline(_corners(low, high)) for low, high in boxes]
        points = np.concatenate([item.points for item in items])
        self._rounding = _ROUNDING * float(1.0 + np.abs(points[np.isfinite(points)]).max())
        total = len(items)
        # Convex sets of each face: which outlines lie inside, and which faces have no inner point
        self._holding = np.zeros((total, 10, self.n), bool)
        self._inside = np.zeros((total, self.n), bool)
        self._beyond = np.zeros((self.n, self.n), bool)
        self._cleared = np.zeros((total, self.n), bool)
        self._flat = np.array([shape.kind in _FLAT for shape in shapes], bool)
        outlines = _Outlines(items)
        for g, shape in enumerate(shapes):
            self._compare(shape, g, outlines)

    def _compare(self, shape: Shape, g: int, outlines: _Outlines) -> None:
        """Note how all outlines lie to the sets of face ``g``."""
        tiny = self._rounding
        holding = self._holding[:, :, g]
        holding[:, 0:3] = outlines.highest <= outlines.lowest[g] + tiny
        holding[:, 3:6] = outlines.lowest >= outlines.highest[g] - tiny
        row = shape.row()
        point, axis = row[0:3], row[3:6]
        if not np.any(axis):
            return
        coaxial = outlines.on(point, axis, tiny)
        low, high = outlines.heights(point, axis)
        holding[:, 6] = high <= low[g] + tiny
        holding[:, 7] = low >= high[g] - tiny
        own = np.arange(len(holding)) == g
        others = ~own[: self.n]
        if shape.kind == ANNULUS:
            _, farthest = outlines.reach(point, axis, coaxial)
            holding[:, 8] = (row[6] > 0.0) & (farthest <= max(row[6], 0.0) ** 0.5 + tiny)
        elif shape.kind == CYLINDER:
            nearest, farthest = outlines.reach(point, axis, coaxial)
            self._inside[:, g] = holding[:, 8] = own | (farthest <= row[6] + tiny)
            self._beyond[g] = others & (nearest[: self.n] >= row[6] - tiny)
        elif shape.kind == SPHERE:
            least, most = outlines.distances(point + row[6] * axis, coaxial)
            self._inside[:, g] = holding[:, 9] = own | (most <= row[6] + tiny)
            self._cleared[:, g] = own | (least >= row[6] - tiny)
            self._beyond[g] = others & (least[: self.n] >= row[6] - tiny)

    def excluded(self, start: int, sphere_entered: bool) -> Flags:
        """(n, n): [F, G] is set where no ray from ``start`` meets G before it meets F.

        Parameters
        ----------
        start : number of the face or box from which rays start
        sphere_entered : speaks of rays that meet spheres F from outside if they start outside
        """
        holding = self._holding[start]
        # A convex set of G holds the start and F
        found: Flags = (self._holding[: self.n] & holding).any(axis=1)
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
        profile=np.array(ends) if known else np.full((2, 2), np.nan),
    )
