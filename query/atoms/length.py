"""``length > 12 cm``: geometric length of a ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundNode, BoundValue
from query.engine.context import RayContext
from query.expression.atom import Comparison, Quantity

__all__ = ["KINDS", "Length", "length"]


class Length(Quantity):
    """Geometric length of the ray [scene units], without the last segment of one that left."""

    word = "length"
    title = "geometric length of the ray"
    dimension = "length"
    place = 210

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        return BoundLength(text=text, **vars(comparison))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundLength(BoundValue):
    """Sum of the segments."""

    def own_streams(self) -> tuple[str, ...]:
        return ("position",)

    def values(self, context: RayContext) -> NDArray[Any]:
        return context.recorded.lengths()


length = Length()

KINDS = (Length,)
