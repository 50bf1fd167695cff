"""Faces seen along an axis, as maps of faces show them: what area lies over a rectangle of the map.

The area over a region of the map is the integral of the stretch, 1 / cos of the slope, over the
part of the region that the face covers. Regions wholly on the face take three Gauss points each
way; those that its edge cuts are summed chord by chord, from edge to edge, with nodes that crowd
at both ends, where the stretch of a steep edge grows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["PolygonSeen", "RevolutionSeen", "SeenFace", "areas_over", "seen_face"]

Floats = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_CHORDS = np.polynomial.legendre.leggauss(48)
_ALONG = np.polynomial.legendre.leggauss(6)

_TOGETHER = 2**12
"""Rectangles that an edge cuts, looked at together: what is kept of each takes 5 kB."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A convex outline.

    Attributes
    ----------
    sign : 1, or -1 of a hole
    low, high : where it begins and ends along y
    chord : of lines of constant y the x at which they enter and leave it
    """

    sign: float
    low: float
    high: float
    chord: Callable[[Floats], tuple[Floats, Floats]]


class SeenFace(Protocol):
    """A face on the plane of its map, whose origin is the middle of the map."""

    def pieces(self) -> Sequence[Piece]:
        """Convex outlines that the face is made of."""
        ...

    def stretch(self, x: Floats, y: Floats) -> Floats | float:
        """Area of the face over area of the map."""
        ...

    def lies(self, x: Floats, y: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Of rectangles with (2, …) sides x and y: which lie on the face, and which beside it.

        The others may be cut by an edge.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class RevolutionSeen:
    """A disc, a ring, a sphere cap, a conic or an even asphere, seen along its axis.

    Attributes
    ----------
    inner, outer : radii [length unit]
    curvature [1/length unit], conic, aspheric : sag c r² / (1 + sqrt(1 - (1 + k) c² r²))
        + Σ A_i r^(2i + 4)
    """

    inner: float
    outer: float
    curvature: float = 0.0
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()

    def pieces(self) -> Sequence[Piece]:
        outer = _circle(self.outer, 1.0)
        return [outer, _circle(self.inner, -1.0)] if self.inner else [outer]

    def stretch(self, x: Floats, y: Floats) -> Floats | float:
        if not self.curvature and not any(self.aspheric):
            return 1.0
        r2 = np.minimum(x * x + y * y, self.outer**2)
        r, c, k = np.sqrt(r2), self.curvature, 1.0 + self.conic
        slope = c * r / np.sqrt(np.maximum(1.0 - k * c * c * r2, 1e-9))
        for power, coefficient in enumerate(self.aspheric):
            slope = slope + (4 + 2 * power) * coefficient * r ** (3 + 2 * power)
        return np.asarray(np.hypot(1.0, slope))

    def lies(self, x: Floats, y: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        near = np.hypot(*(np.clip(0.0, side[0], side[1]) for side in (x, y)))
        far = np.hypot(*(np.abs(side).max(axis=0) for side in (x, y)))
        on = (near >= self.inner) & (far <= self.outer)
        return on, (near >= self.outer) | (far <= self.inner)


@dataclass(frozen=True, kw_only=True, eq=False)
class PolygonSeen:
    """A flat convex polygon.

    Attributes
    ----------
    corners : (n, 2), counterclockwise [length unit]
    """

    corners: Floats

    def _edges(self) -> tuple[Floats, Floats]:
        return self.corners, np.roll(self.corners, -1, axis=0) - self.corners

    def pieces(self) -> Sequence[Piece]:
        low, high = self.corners[:, 1].min(), self.corners[:, 1].max()
        return [Piece(sign=1.0, low=float(low), high=float(high), chord=self._chord)]

    def _chord(self, y: Floats) -> tuple[Floats, Floats]:
        low, high = np.full(y.shape, -np.inf), np.full(y.shape, np.inf)
        for corner, edge in zip(*self._edges(), strict=True):
            if edge[1] == 0.0:
                high = np.where(edge[0] * (y - corner[1]) >= 0.0, high, -np.inf)
                continue
            at = corner[0] + edge[0] * (y - corner[1]) / edge[1]
            if edge[1] > 0.0:
                high = np.minimum(high, at)
            else:
                low = np.maximum(low, at)
        return low, high

    def stretch(self, x: Floats, y: Floats) -> Floats | float:
        return 1.0

    def lies(self, x: Floats, y: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        on, beside = np.ones(x.shape[1:], bool), np.zeros(x.shape[1:], bool)
        for corner, edge in zip(*self._edges(), strict=True):
            inside = [
                edge[0] * (y[b] - corner[1]) - edge[1] * (x[a] - corner[0]) >= 0.0
                for a in (0, 1)
                for b in (0, 1)
            ]
            on &= np.logical_and.reduce(inside)
            beside |= ~np.logical_or.reduce(inside)
        return on, beside


def _circle(radius: float, sign: float) -> Piece:
    def chord(y: Floats) -> tuple[Floats, Floats]:
        reach = np.sqrt(np.maximum(radius**2 - y * y, 0.0))
        return -reach, reach

    return Piece(sign=sign, low=-radius, high=radius, chord=chord)


def seen_face(parameters: Mapping[str, Any]) -> SeenFace | None:
    """The face that a detector's parameter ``area_law`` tells of; None where it has none."""
    law = parameters.get("area_law")
    if law is None:
        return None
    if law["kind"] == "polygon":
        return PolygonSeen(corners=np.array(law["corners"], np.float64))
    return RevolutionSeen(
        inner=float(law.get("inner", 0.0)),
        outer=float(law["outer"]),
        curvature=float(law.get("curvature", 0.0)),
        conic=float(law.get("conic", 0.0)),
        aspheric=tuple(float(value) for value in law.get("aspheric", ())),
    )


def areas_over(face: SeenFace, x: Floats, y: Floats) -> Floats:
    """(n,) area of a face over rectangles of its map.

    Parameters
    ----------
    x, y : (2, n) lower and upper sides
    """
    on, beside = face.lies(x, y)
    areas = np.zeros(x.shape[1])
    areas[on] = _whole(face, x[:, on], y[:, on])
    cut = np.flatnonzero(~on & ~beside)
    for first in range(0, len(cut), _TOGETHER):
        some = cut[first : first + _TOGETHER]
        areas[some] = _cut(face, x[:, some], y[:, some])
    return np.maximum(areas, 0.0)


def _whole(face: SeenFace, x: Floats, y: Floats) -> Floats:
    """Of rectangles that no edge cuts."""
    middle_x, middle_y = 0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])
    half_x, half_y = 0.5 * (x[1] - x[0]), 0.5 * (y[1] - y[0])
    stretch = np.zeros(len(middle_x))
    for along, weight in zip(_NODES, _WEIGHTS, strict=True):
        for across, other in zip(_NODES, _WEIGHTS, strict=True):
            values = face.stretch(middle_x + along * half_x, middle_y + across * half_y)
            stretch += weight * other * values
    return np.asarray(stretch * half_x * half_y)


def _cut(face: SeenFace, x: Floats, y: Floats) -> Floats:
    """Of rectangles that an edge may cut: Gauss points after x = sin t from end to end."""
    angle = 0.5 * np.pi * _CHORDS[0]
    along = 0.5 * np.pi * _ALONG[0]
    weights = np.cos(along) * (0.5 * np.pi * _ALONG[1])
    areas = np.zeros(x.shape[1])
    for piece in face.pieces():
        bottom, top = np.clip(y, piece.low, piece.high)
        half = 0.5 * (top - bottom)[:, None]
        at = 0.5 * (bottom + top)[:, None] + half * np.sin(angle)
        heights = piece.sign * half * np.cos(angle) * (0.5 * np.pi * _CHORDS[1])
        low, high = piece.chord(at)
        start, end = np.maximum(low, x[0][:, None]), np.minimum(high, x[1][:, None])
        reach = 0.5 * np.maximum(end - start, 0.0)
        # Lines that miss the face begin and end nowhere
        middle = np.where(reach > 0.0, 0.5 * (start + end), 0.0)
        places = middle[..., None] + reach[..., None] * np.sin(along)
        stretch = face.stretch(places, at[..., None])
        lengths = 2.0 * reach if isinstance(stretch, float) else reach * (stretch @ weights)
        areas += (heights * lengths).sum(axis=1)
    return np.maximum(areas, 0.0)
