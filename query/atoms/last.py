"""``last(absorbed)``: a point condition holds where the ray ended."""

from __future__ import annotations

from dataclasses import dataclass

from query.engine.bind import Binder
from query.engine.bound import BoundNode, at_points
from query.engine.context import Context
from query.engine.kleene import Pair, apply
from query.expression.arguments import Point
from query.expression.atom import Condition
from query.expression.criterion import Criterion, check_point

__all__ = ["KINDS", "Last", "last"]


@dataclass(frozen=True)
class Last(Condition):
    """The point condition holds where the ray ended."""

    point: Criterion

    word = "last"
    title = "holds where the ray ended"
    arguments = (Point(or_event=True, help="point condition or event word"),)
    place = 70

    def __post_init__(self) -> None:
        check_point(self.point, "last")

    def bind(self, binder: Binder, text: str) -> BoundNode:
        return BoundLast(text=text, point=binder.node(self.point))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundLast(BoundNode):
    """``point`` : asked of the last point."""

    point: BoundNode

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return (self.point,)

    def on_rays(self, context: Context) -> Pair:
        return apply(at_points(context, self.point), lambda mask: mask[context.last_rows])


def last(point: Criterion) -> Last:
    """The point condition holds where the ray ended."""
    return Last(point)


KINDS = (Last,)
