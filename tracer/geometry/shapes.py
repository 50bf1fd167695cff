"""Analytic faces as values: parameter row, bounds, implicit form and a mesh to draw.

Positions and lengths in scene units. Each class builds the row that `tracer.geometry.kinds`
describes; compiled code sees only kinds and rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Quadric
from raymap.optics.frames import frame_of
from tracer.geometry.kinds import (
    ANNULUS,
    ASPHERE,
    CONE,
    CONIC,
    CYLINDER,
    POLYGON,
    RECTANGLE,
    ROW,
    SPHERE,
)

__all__ = [
    "SEGMENTS",
    "Annulus",
    "Bounds",
    "Conic",
    "Cylinder",
    "Frustum",
    "Polygon",
    "Rectangle",
    "Shape",
    "SphereCap",
    "padded",
    "sag_at",
    "sags_at",
]

Array = NDArray[np.float64]
Bounds = tuple[Array, Array]
Mesh = tuple[Array, NDArray[np.int32]]

SEGMENTS = 48
"""Corners that a circle is drawn with."""

_RINGS = 8
_TWO_TRIANGLES = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
_TURN_DEG = 5.0


class Shape(Protocol):
    """What a compiler asks of a face."""

    @property
    def kind(self) -> int: ...

    def row(self) -> Array:
        """Parameter row; polygons leave the pool entries to the compiler."""

    def bounds(self) -> Bounds:
        """Box that surely holds the face: lower and upper corner."""

    def quadric(self) -> Quadric | None:
        """Implicit form with outward gradient, None where there is none of second order."""

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        """Vertices (n, 3) and triangles (m, 3) to draw, circles with so many corners."""


def unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def _cross(a: Array, b: Array) -> Array:
    """Vector product of two vectors; the general one of NumPy takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def padded(low: Array, high: Array) -> Bounds:
    """Boxes (..., 3) a little larger, so that rounding leaves nothing outside."""
    margin = 1e-9 * (1.0 + np.maximum(high.max(axis=-1), -low.min(axis=-1)))[..., None]
    return low - margin, high + margin


def _ring_bounds(centers: list[Array], radii: list[float], axis: Array) -> Bounds:
    """Box around circles across ``axis``."""
    reach = np.sqrt(np.maximum(0.0, 1.0 - axis * axis))
    middle, extent = np.array(centers), np.array(radii)[:, None] * reach
    return padded((middle - extent).min(axis=0), (middle + extent).max(axis=0))


def _revolve(
    origin: Array,
    axis: Array,
    profile: Sequence[tuple[float, float]],
    segments: int,
    side: float = 1.0,
) -> Mesh:
    """Mesh of a profile of (radius, height) turned about an axis.

    Its triangles are wound about normals that point away from the axis where the profile rises, and
    the other way for ``side`` -1, so that cavities are bounded from within.
    """
    u, v, w = frame_of(axis)
    circle = _circle(segments) @ np.array([u, v])
    radii, heights = np.array(profile).T
    rings = origin + heights[:, None, None] * w + radii[:, None, None] * circle
    corners = _strips(len(profile) - 1, segments)
    return rings.reshape(-1, 3), corners if side > 0.0 else corners[:, ::-1]


@lru_cache(maxsize=16)
def _circle(segments: int) -> Array:
    """Cosines and sines of the corners of a circle, (segments, 2)."""
    angles = np.linspace(0.0, 2.0 * math.pi, segments, endpoint=False)
    return np.column_stack([np.cos(angles), np.sin(angles)])


@lru_cache(maxsize=1024)
def _cap_profile(radius: float, sag: float, rings: int) -> tuple[tuple[float, float], ...]:
    """Radii and heights of the rings of a spherical cap; equal caps share them."""
    stop = math.acos(max(-1.0, 1.0 - sag / radius))
    angles = [stop * k / rings for k in range(rings + 1)]
    return tuple((radius * math.sin(a), radius * (1.0 - math.cos(a))) for a in angles)


@lru_cache(maxsize=128)
def _strips(strips: int, segments: int) -> NDArray[np.int32]:
    """Triangles between rings of equally many corners."""
    k = np.arange(segments)
    a, b = k, (k + 1) % segments
    pairs = np.stack([a, b, b + segments, a, b + segments, a + segments], axis=1).reshape(-1, 3)
    shifts = segments * np.arange(strips)
    return np.asarray((pairs + shifts[:, None, None]).reshape(-1, 3), np.int32)


def _rings(segments: int) -> int:
    """Rings that go with so many corners of a circle."""
    return max(2, _RINGS * segments // SEGMENTS)


def _solve_axis(direction: Array) -> int:
    x, y, z = map(abs, direction.tolist())
    return 0 if x >= max(y, z) else 1 if y >= z else 2


def _quadric_about(
    origin: Array,
    axis: Array,
    *,
    square: float,
    along: float,
    slope: float,
    constant: float,
    solve: int | None,
) -> Quadric:
    """Quadric square |q|² + along (q·w)² + slope (q·w) + constant about an axis w, q = p - origin.

    In plain numbers: a scene has one for every face, and arrays of three cost twenty times as much.
    """
    w, o = axis.tolist(), origin.tolist()
    height = o[0] * w[0] + o[1] * w[1] + o[2] * w[2]
    linear = [slope * w[k] - 2.0 * (square * o[k] + along * height * w[k]) for k in range(3)]
    distance = o[0] * o[0] + o[1] * o[1] + o[2] * o[2]
    offset = square * distance + along * height * height - slope * height + constant
    return Quadric(
        coefficients=(
            square + along * w[0] * w[0], square + along * w[1] * w[1],
            square + along * w[2] * w[2],
            2.0 * along * w[0] * w[1], 2.0 * along * w[0] * w[2], 2.0 * along * w[1] * w[2],
            *linear, offset,
        ),
        solve_axis=solve,  # type: ignore[arg-type]
    )  # fmt: skip


def _plane_quadric(origin: Array, normal: Array) -> Quadric:
    return Quadric(
        coefficients=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *normal.tolist(), -float(normal @ origin)),
        solve_axis=_solve_axis(normal),  # type: ignore[arg-type]
    )


@dataclass(frozen=True, eq=False)
class Annulus:
    """Flat ring (a disc where ``inner`` is zero)."""

    origin: Array
    normal: Array
    inner: float
    outer: float
    kind: int = ANNULUS

    def row(self) -> Array:
        s = np.zeros(ROW)
        s[0:3], s[3:6] = self.origin, self.normal
        s[6] = self.inner**2 if self.inner > 0.0 else -1.0
        s[7] = self.outer**2
        return s

    def bounds(self) -> Bounds:
        return _ring_bounds([self.origin], [self.outer], self.normal)

    def quadric(self) -> Quadric | None:
        return _plane_quadric(self.origin, self.normal)

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        return _revolve(self.origin, self.normal, [(self.inner, 0.0), (self.outer, 0.0)], segments)


@dataclass(frozen=True, eq=False)
class Rectangle:
    """Rectangle with full ``size`` along the unit vectors u and v; its normal is u x v."""

    origin: Array
    u: Array
    v: Array
    size: tuple[float, float]
    kind: int = RECTANGLE

    @cached_property
    def normal(self) -> Array:
        return _cross(self.u, self.v)

    def row(self) -> Array:
        s = np.zeros(ROW)
        s[0:3], s[3:6], s[6:9], s[9:12] = self.origin, self.normal, self.u, self.v
        s[12], s[13] = self.size[0] / 2.0, self.size[1] / 2.0
        return s

    def corners(self) -> Array:
        return self._corners

    @cached_property
    def _corners(self) -> Array:
        # In plain numbers: a scene of boxes has six for each, and small arrays cost much more
        halves = [
            (o, u * self.size[0] / 2.0, v * self.size[1] / 2.0)
            for o, u, v in zip(self.origin.tolist(), self.u.tolist(), self.v.tolist(), strict=True)
        ]
        return np.array(
            [
                [o + (-u - v) for o, u, v in halves],
                [o + (u - v) for o, u, v in halves],
                [o + (u + v) for o, u, v in halves],
                [o + (v - u) for o, u, v in halves],
            ]
        )

    def bounds(self) -> Bounds:
        corners = self.corners()
        return padded(corners.min(axis=0), corners.max(axis=0))

    def quadric(self) -> Quadric | None:
        return _plane_quadric(self.origin, self.normal)

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        return self.corners(), _TWO_TRIANGLES


@dataclass(frozen=True, eq=False)
class Polygon:
    """Convex flat polygon, ``vertices`` (n, 3) counter-clockwise seen against its normal."""

    vertices: Array
    kind: int = POLYGON

    @cached_property
    def normal(self) -> Array:
        v = self.vertices
        return unit(np.sum(np.cross(v - v[0], np.roll(v, -1, axis=0) - v[0]), axis=0))

    def half_planes(self) -> Array:
        """(n, 4) rows (m, c): the polygon is where m . p <= c for all of them."""
        edges = np.roll(self.vertices, -1, axis=0) - self.vertices
        outward = np.cross(edges, self.normal)
        outward /= np.linalg.norm(outward, axis=1)[:, None]
        offsets = np.sum(outward * self.vertices, axis=1)
        return np.column_stack([outward, offsets + 1e-13 * (1.0 + np.abs(offsets))])

    def row(self) -> Array:
        s = np.zeros(ROW)
        s[0:3], s[3:6] = self.vertices[0], self.normal
        return s

    def bounds(self) -> Bounds:
        return padded(self.vertices.min(axis=0), self.vertices.max(axis=0))

    def quadric(self) -> Quadric | None:
        return _plane_quadric(self.vertices[0], self.normal)

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        fan = [(0, k, k + 1) for k in range(1, len(self.vertices) - 1)]
        return self.vertices, np.array(fan, np.int32)


@dataclass(frozen=True, eq=False)
class SphereCap:
    """Part of a sphere about its vertex; ``axis`` points from the vertex to the centre.

    ``sag`` is the height of its edge above the vertex (2 radius: the whole sphere); ``side`` +1
    where the outward normal points away from the centre.
    """

    vertex: Array
    axis: Array
    radius: float
    sag: float
    side: float = 1.0
    kind: int = SPHERE

    def row(self) -> Array:
        s = np.zeros(ROW)
        s[0:3], s[3:6] = self.vertex, self.axis
        s[6], s[7], s[8] = self.radius, self.sag, self.side / self.radius
        return s

    def bounds(self) -> Bounds:
        center = self.vertex + self.radius * self.axis
        if self.sag >= self.radius:
            return padded(center - self.radius, center + self.radius)
        edge = math.sqrt(self.sag * (2.0 * self.radius - self.sag))
        low, high = _ring_bounds(
            [self.vertex, self.vertex + self.sag * self.axis], [0.0, edge], self.axis
        )
        # A cap may bulge beyond vertex and edge where a coordinate axis leaves it
        for k in range(3):
            for sign in (-1.0, 1.0):
                if (1.0 + sign * self.axis[k]) * self.radius <= self.sag:
                    reach = center[k] + sign * self.radius
                    low[k], high[k] = min(low[k], reach), max(high[k], reach)
        return padded(low, high)

    def quadric(self) -> Quadric | None:
        return _quadric_about(
            self.vertex,
            self.axis,
            square=self.side / (2.0 * self.radius),
            along=0.0,
            slope=-self.side,
            constant=0.0,
            solve=_solve_axis(self.axis),
        )

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        # More than a sixth of a circle: rings as close as the corners of its largest circle
        stop = math.acos(max(-1.0, 1.0 - self.sag / self.radius))
        rings = max(_rings(segments), math.ceil(segments * stop / (2.0 * math.pi) - 1e-9))
        profile = _cap_profile(self.radius, self.sag, rings)
        return _revolve(self.vertex, self.axis, profile, segments, self.side)


@dataclass(frozen=True, eq=False)
class Cylinder:
    """Side of a cylinder from ``low`` to ``high`` along ``axis``; ``side`` +1: normal outward."""

    origin: Array
    axis: Array
    radius: float
    low: float
    high: float
    side: float = 1.0
    kind: int = CYLINDER

    def row(self) -> Array:
        s = np.zeros(ROW)
        s[0:3], s[3:6] = self.origin, self.axis
        s[6], s[7], s[8], s[9] = self.radius, self.low, self.high, self.side
        return s

    def bounds(self) -> Bounds:
        ends = [self.origin + self.low * self.axis, self.origin + self.high * self.axis]
        return _ring_bounds(ends, [self.radius, self.radius], self.axis)

    def quadric(self) -> Quadric | None:
        square = self.side / (2.0 * self.radius)
        return _quadric_about(
            self.origin,
            self.axis,
            square=square,
            along=-square,
            slope=0.0,
            constant=-self.side * self.radius / 2.0,
            solve=None,
        )

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        profile = [(self.radius, self.low), (self.radius, self.high)]
        return _revolve(self.origin, self.axis, profile, segments, self.side)


@dataclass(frozen=True, eq=False)
class Frustum:
    """Side of a cone whose radius grows by ``slope`` along ``axis`` from ``low`` to ``high``."""

    origin: Array
    axis: Array
    radius: float
    slope: float
    low: float
    high: float
    side: float = 1.0
    kind: int = CONE

    def row(self) -> Array:
        s = np.zeros(ROW)
        s[0:3], s[3:6] = self.origin, self.axis
        s[6:11] = self.radius, self.slope, self.low, self.high, self.side
        return s

    def bounds(self) -> Bounds:
        ends = [self.origin + self.low * self.axis, self.origin + self.high * self.axis]
        radii = [self.radius + self.slope * self.low, self.radius + self.slope * self.high]
        return _ring_bounds(ends, radii, self.axis)

    def quadric(self) -> Quadric | None:
        scale = self.side / 2.0
        return _quadric_about(
            self.origin,
            self.axis,
            square=scale,
            along=-scale * (1.0 + self.slope**2),
            slope=-2.0 * scale * self.radius * self.slope,
            constant=-scale * self.radius**2,
            solve=None,
        )

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        profile = [
            (self.radius + self.slope * self.low, self.low),
            (self.radius + self.slope * self.high, self.high),
        ]
        return _revolve(self.origin, self.axis, profile, segments, self.side)


def sag_at(r: float, curvature: float, conic: float, aspheric: Sequence[float] = ()) -> float:
    """Height of a surface of revolution at radius ``r``, as of `Conic`; nan outside it."""
    inner = 1.0 - (1.0 + conic) * (curvature * r) ** 2
    if inner < 0.0:
        return math.nan
    powers = sum(a * r ** (4 + 2 * k) for k, a in enumerate(aspheric)) if aspheric else 0.0
    return curvature * r * r / (1.0 + math.sqrt(inner)) + powers


def sags_at(r: Array, curvature: float, conic: float, aspheric: Sequence[float] = ()) -> Array:
    """As `sag_at`, at many radii."""
    inner = 1.0 - (1.0 + conic) * (curvature * r) ** 2
    root = np.sqrt(np.where(inner < 0.0, np.nan, inner))
    found = curvature * r * r / (1.0 + root)
    for k, a in enumerate(aspheric):
        found = found + a * r ** (4 + 2 * k)
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Conic:
    """Conic of revolution, or even asphere where ``aspheric`` has coefficients of r^4, r^6 ….

    Sag c r² / (1 + sqrt(1 - (1 + k) c² r²)) + Σ A_i r^(2i) along ``axis``; ``side`` +1 where the
    outward normal points against the axis. ``inner`` is the radius of a hole; an asphere has none.
    """

    vertex: Array
    axis: Array
    curvature: float
    conic: float
    semi_diameter: float
    side: float = 1.0
    aspheric: tuple[float, ...] = ()
    inner: float = 0.0

    @property
    def kind(self) -> int:
        return ASPHERE if any(self.aspheric) else CONIC

    def row(self) -> Array:
        s = np.zeros(ROW)
        s[0:3], s[3:6] = self.vertex, self.axis
        s[6], s[7] = self.curvature, 1.0 + self.conic
        s[8], s[9] = self.semi_diameter**2, self.side
        if self.kind == CONIC:
            s[10] = self.inner**2 if self.inner > 0.0 else -1.0
        s[10 : 10 + len(self.aspheric)] = self.aspheric
        return s

    def sag(self, r: float) -> float:
        """Height of the surface above its vertex at radius ``r``; nan outside it."""
        return sag_at(r, self.curvature, self.conic, self.aspheric)

    def bounds(self) -> Bounds:
        radii: Array = self.semi_diameter * np.arange(65, dtype=float) / 64.0
        sags = sags_at(radii, self.curvature, self.conic, self.aspheric)
        low, high = float(sags.min()), float(sags.max())
        margin = 1e-2 * (high - low) if any(self.aspheric) else 0.0
        ends = [self.vertex + (low - margin) * self.axis, self.vertex + (high + margin) * self.axis]
        return _ring_bounds(ends, [self.semi_diameter, self.semi_diameter], self.axis)

    def quadric(self) -> Quadric | None:
        if any(self.aspheric):
            return None
        square = 0.5 * self.side * self.curvature
        return _quadric_about(
            self.vertex,
            self.axis,
            square=square,
            along=square * self.conic,
            slope=-self.side,
            constant=0.0,
            solve=_solve_axis(self.axis),
        )

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        profile = [(float(r), self.sag(float(r))) for r in self._radii(_rings(segments))]
        return _revolve(self.vertex, self.axis, profile, segments, self.side)

    def _radii(self, least: int) -> Array:
        """Radii of the rings to draw: closer where the profile turns, more if it turns a lot."""
        r = np.linspace(self.inner, self.semi_diameter, 513)
        steps = np.diff(r), np.diff([self.sag(float(x)) for x in r])
        length = np.hypot(*steps)
        turns = np.abs(np.diff(np.arctan2(steps[1], steps[0]), append=np.nan))
        turns[-1] = turns[-2]
        place = np.cumsum(length / length.sum() + turns / max(float(turns.sum()), 1e-9))
        place = np.concatenate(([0.0], place))
        count = min(max(least, math.ceil(math.degrees(float(turns.sum())) / _TURN_DEG)), 64)
        return np.asarray(np.interp(np.linspace(0.0, place[-1], count + 1), place, r))
