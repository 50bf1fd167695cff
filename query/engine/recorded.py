"""Quantities from columns that polarised traces store: state of polarisation, optical path."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundCompare, BoundNode, at_points, compare, unknown
from query.engine.context import Context, RayContext
from query.engine.kleene import Pair, exactly
from query.expression.arguments import Point
from query.expression.atom import Comparison, Quantity
from query.expression.criterion import Criterion, check_point

__all__ = ["LINEAR_LIMIT", "Recorded", "angles_of", "degrees_of", "ellipse_of", "stokes_values"]

LINEAR_LIMIT = 1e-6
"""Linear part of the light below which it has no azimuth; float32 keeps about 1e-7."""

Floats = NDArray[np.float64]
Ints = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class Recorded(Quantity):
    """A quantity that polarised traces record, at the ray's end or at certain points.

    Without ``point`` it speaks of the light of the ray's last segment; with one, of the light that
    goes on from points that satisfy it, and the comparison holds if it holds at one of them.
    Undefined in maps without the column. Calling it adds the point:
    ``degree_of_polarisation(hit("L1")) > 0.5``.

    Attributes
    ----------
    column : optional column of the map that it is read from
    """

    point: Criterion | None = None

    arguments = (Point(key="of", optional=True, help="where; without, at the end of the ray"),)
    alone = True
    column: ClassVar[str] = ""

    def __post_init__(self) -> None:
        if self.point is not None:
            check_point(self.point, self.word)

    def __call__(self, point: Criterion) -> Recorded:
        return type(self)(point)

    @classmethod
    @abstractmethod
    def values(cls, context: RayContext, points: Ints | None) -> Floats:
        """The quantity of points of the context, or at the end of every ray; NaN: undefined."""

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        return BoundRecorded(
            text=text,
            **vars(comparison),
            kind=type(self),
            stored=binder.facts.has_column(self.column),
            point=None if self.point is None else binder.node(self.point),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundRecorded(BoundCompare):
    """A quantity from an optional column of the map.

    Attributes
    ----------
    kind : which quantity; ``point`` : where, None for the end of the ray
    stored : some portion has the column
    """

    kind: type[Recorded]
    stored: bool
    point: BoundNode | None = None

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return () if self.point is None else (self.point,)

    def own_streams(self) -> tuple[str, ...]:
        return (self.kind.column,) if self.stored else ()

    def on_rays(self, context: Context) -> Pair:
        if not self.stored:
            return exactly(np.zeros(context.n_rays, np.bool_))
        points = None if self.point is None else at_points(context, self.point)
        if not isinstance(context, RayContext):
            if points is None:
                return unknown(context)
            met = context.points.any(points.possible)
            return Pair(np.zeros_like(met), met)
        if points is None:
            values = self.kind.values(context, None)
            return exactly(compare(self.operator, values, self.value))
        chosen = np.flatnonzero(points.certain)
        marks = np.zeros(context.n_points, np.bool_)
        marks[chosen] = compare(self.operator, self.kind.values(context, chosen), self.value)
        return exactly(context.points.any(marks))

    def samples(self, context: RayContext) -> tuple[NDArray[Any], NDArray[Any]]:
        if self.point is None:
            return np.arange(context.n_rays), self.kind.values(context, None)
        chosen = np.flatnonzero(at_points(context, self.point).certain)
        rays = np.searchsorted(context.offsets, chosen, side="right") - 1
        return rays, self.kind.values(context, chosen)

    def never(self, map: Any) -> str | None:
        if self.stored:
            return None
        return (
            f"{self.text}: this map has no column {self.kind.column!r}; "
            "a scene with [trace] light = 'polarised' writes it"
        )


def stokes_values(context: RayContext, points: Ints | None) -> Floats | None:
    """(n, 3) polarised part of the light that goes on from points, or of every last segment.

    NaN where no segment goes on; None where the portion has no such column.
    """
    column = context.optional("stokes", 3)
    if column is None:
        return None
    has_segment = context.lengths > 1 if points is None else _goes_on(context, points)
    rows = context.ends - 1 if points is None else context.records[points]
    stokes = column[np.where(has_segment, rows, 0)].astype(np.float64)
    stokes[~has_segment] = np.nan
    return stokes


def _goes_on(context: RayContext, points: Ints) -> NDArray[np.bool_]:
    """Whether a segment starts at a point, which it does at all but the last of a ray."""
    is_last = np.zeros(context.n_points, np.bool_)
    is_last[context.last_rows] = True
    return ~is_last[points]


def degrees_of(stokes: Floats) -> Floats:
    """Polarised share of the light."""
    degree: Floats = np.sqrt((stokes**2).sum(axis=-1))
    return degree


def angles_of(stokes: Floats) -> Floats:
    """Azimuth in (-90, 90] degrees, NaN for light without a linear part."""
    angle = np.degrees(0.5 * np.arctan2(stokes[..., 1], stokes[..., 0]))
    angle = np.where(angle <= -90.0, 90.0, angle)
    return np.where(np.hypot(stokes[..., 0], stokes[..., 1]) > LINEAR_LIMIT, angle, np.nan)


def ellipse_of(stokes: NDArray[np.floating[Any]]) -> dict[str, float | str | None]:
    """Degree and angle of polarisation, axis ratio and handedness of the polarised part.

    Parameters
    ----------
    stokes : (3,), s1, s2, s3 over s0

    Returns
    -------
    dict
        ``degree``; ``angle_deg``, None for light without a linear part; ``axis_ratio``, minor over
        major axis of the ellipse, and ``handedness``, both None for natural light

    References
    ----------
    Born & Wolf, 7th ed., 1.4.2: sin 2χ = s3 / s0 of the polarised part, axis ratio |tan χ|.
    """
    s = np.asarray(stokes, np.float64)
    degree, angle = float(degrees_of(s)), float(angles_of(s))
    found: dict[str, float | str | None] = {
        "degree": degree,
        "angle_deg": None if np.isnan(angle) else angle,
        "axis_ratio": None,
        "handedness": None,
    }
    if degree > LINEAR_LIMIT:
        chi = 0.5 * np.arctan2(s[2], np.hypot(s[0], s[1]))
        ratio = float(abs(np.tan(chi)))
        found["axis_ratio"] = ratio
        found["handedness"] = (
            "linear" if ratio < LINEAR_LIMIT else ("right" if s[2] > 0 else "left")
        )
    return found
