"""``all(hit("L1"), event(tir))``: several point conditions at one and the same point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from query.engine.bind import Binder
from query.engine.bound import BoundNode, BoundPoint, at_points
from query.engine.context import Context
from query.engine.kleene import Pair, combine, exactly
from query.expression.arguments import Points
from query.expression.atom import Condition
from query.expression.criterion import Criterion, check_point

__all__ = ["KINDS", "All"]


@dataclass(frozen=True)
class All(Condition):
    """Several point conditions at one and the same point; without any, every point and ray."""

    args: tuple[Criterion, ...] = ()

    word = "all"
    title = "several at one point; alone: every ray"
    arguments = (Points(help="point conditions or event words", optional=True),)
    place = 110
    alone = True

    def __post_init__(self) -> None:
        for arg in self.args:
            check_point(arg, "all")

    @property
    def is_point(self) -> bool:
        return True

    def bind(self, binder: Binder, text: str) -> BoundNode:
        return BoundAll(text=text, args=tuple(binder.node(arg) for arg in self.args))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundAll(BoundPoint):
    """Point conditions at one point; without any, every point."""

    args: tuple[BoundNode, ...]

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return self.args

    def on_points(self, context: Context) -> Pair:
        if not self.args:
            return exactly(np.ones(context.n_points, np.bool_))
        return combine("and", [at_points(context, arg) for arg in self.args])


KINDS = (All,)
