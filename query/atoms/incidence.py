"""``incidence(hit("L1")) < 30 deg``: angle between the arriving ray and the normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundCompare, BoundNode, at_points, compare
from query.engine.context import Context, RayContext
from query.engine.kleene import Pair, apply, exactly
from query.engine.measures import incidence_angles
from query.engine.scans import Runs
from query.expression.arguments import Point
from query.expression.atom import Comparison, Quantity
from query.expression.criterion import Criterion, check_point

__all__ = ["KINDS", "Incidence", "incidence", "surface_points"]

Ints = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Incidence(Quantity):
    """Angle between the arriving ray and the normal at a point that satisfies a condition [deg].

    The comparison holds if it holds at one such point.
    """

    point: Criterion

    word = "incidence"
    title = "angle of incidence"
    arguments = (Point(key="of", help="point condition, one such point is enough"),)
    dimension = "angle"
    measured = "an angle of incidence"
    place = 100

    def __post_init__(self) -> None:
        check_point(self.point, "incidence")

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        return BoundIncidence(text=text, **vars(comparison), point=binder.node(self.point))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundIncidence(BoundCompare):
    """``point`` : where."""

    point: BoundNode

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return (self.point,)

    def own_streams(self) -> tuple[str, ...]:
        return ("position", "normal")

    def on_rays(self, context: Context) -> Pair:
        if not isinstance(context, RayContext):
            points = at_points(context, self.point)
            met = apply(points, context.points.any)
            return Pair(np.zeros_like(met.possible), met.possible)
        ray, angles = self.samples(context)
        found = np.zeros(context.n_rays, np.bool_)
        found[ray[compare(self.operator, angles, self.value)]] = True
        return exactly(found)

    def samples(self, context: RayContext) -> tuple[NDArray[Any], NDArray[Any]]:
        ray, step, face = surface_points(context, self.point)
        records = context.starts[ray] + step
        normal = context.normals_at(records, face)
        return ray, incidence_angles(context.position, normal, records)


def surface_points(context: RayContext, node: BoundNode) -> tuple[Ints, Ints, Ints]:
    """Ray, step along it and face of the points on surfaces that satisfy a node, emission aside."""
    if node.streams:
        marked = at_points(context, node).certain & (context.object >= 0)
        chosen = np.flatnonzero(marked)
        ray = np.searchsorted(context.offsets, chosen, side="right") - 1
        step = chosen - context.offsets[ray]
        later = step > 0
        return ray[later], step[later], context.face[chosen[later]]
    # The paths say which points: list them per path, then per ray
    base = context.base
    marked = at_points(base, node).certain & (base.object >= 0)
    marked[base.offsets[:-1]] = False
    places = np.flatnonzero(marked)
    ends = np.searchsorted(places, base.offsets)
    runs = Runs.check(ends).take(context.path)
    rows = runs.rows(ends[:-1][context.path])
    ray = np.repeat(np.arange(context.n_rays), np.diff(runs.offsets))
    place = places[rows]
    return ray, place - base.offsets[:-1][context.path[ray]], base.face[place]


def incidence(point: Criterion) -> Incidence:
    """Angle of incidence [deg] at a point that satisfies the condition."""
    return Incidence(point)


KINDS = (Incidence,)
