"""``bounces == 0``: points between the first and the last."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundNode, compare
from query.engine.context import Context, RayContext
from query.engine.kleene import Pair, exactly
from query.engine.whole_numbers import BoundWhole
from query.expression.atom import Comparison, Quantity

__all__ = ["KINDS", "Bounces", "bounces"]


class Bounces(Quantity):
    """Points between the first and the last."""

    word = "bounces"
    title = "points between start and end"
    place = 230

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        return BoundBounces(text=text, **vars(comparison))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundBounces(BoundWhole):
    """The path knows them."""

    def on_rays(self, context: Context) -> Pair:
        between = np.maximum(context.lengths - 2, 0)
        return exactly(compare(self.operator, between, self.value))

    def samples(self, context: RayContext) -> tuple[NDArray[Any], NDArray[Any]]:
        return np.arange(context.n_rays), np.maximum(context.lengths - 2, 0)


bounces = Bounces()

KINDS = (Bounces,)
