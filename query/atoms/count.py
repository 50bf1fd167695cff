"""``count(hit("*", reflected)) >= 2``: how many points satisfy a condition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundNode, at_points, compare
from query.engine.context import Context, RayContext
from query.engine.kleene import Pair, exactly, interval
from query.engine.whole_numbers import BoundWhole
from query.expression.arguments import Point
from query.expression.atom import Comparison, Quantity
from query.expression.criterion import Criterion, check_point

__all__ = ["KINDS", "Count", "count"]


@dataclass(frozen=True, eq=False)
class Count(Quantity):
    """How many points satisfy a point condition."""

    point: Criterion

    word = "count"
    title = "number of such points"
    arguments = (Point(key="of", help="point condition"),)
    place = 80

    def __post_init__(self) -> None:
        check_point(self.point, "count")

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        return BoundCount(text=text, **vars(comparison), point=binder.node(self.point))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundCount(BoundWhole):
    """``point`` : counted; on paths an interval from what is certain to what is possible."""

    point: BoundNode

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return (self.point,)

    def on_rays(self, context: Context) -> Pair:
        pair = at_points(context, self.point)
        least = context.points.count(pair.certain)
        if pair.exact:
            return exactly(compare(self.operator, least, self.value))
        most = context.points.count(pair.possible)
        return interval(self.operator, least, most, self.value)

    def samples(self, context: RayContext) -> tuple[NDArray[Any], NDArray[Any]]:
        return np.arange(context.n_rays), context.points.count(
            at_points(context, self.point).certain
        )


def count(point: Criterion) -> Count:
    """How many points satisfy a condition; compare it: ``count(hit("*", "reflected")) >= 2``."""
    return Count(point)


KINDS = (Count,)
