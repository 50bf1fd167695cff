"""``longest_leg > 10 mm``: the longest straight piece of a ray."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundNode, BoundValue
from query.engine.context import RayContext
from query.expression.atom import Comparison, Quantity
from raymap.jit.kernels import kernel

__all__ = ["KINDS", "LongestLeg"]


class LongestLeg(Quantity):
    """The longest straight piece of a ray, without the last one of a ray that left."""

    word = "longest_leg"
    title = "longest straight piece of the ray"
    dimension = "length"

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        return BoundLongestLeg(text=text, **vars(comparison))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundLongestLeg(BoundValue):
    """Needs positions."""

    def own_streams(self) -> tuple[str, ...]:
        return ("position",)

    def values(self, context: RayContext) -> NDArray[Any]:
        return longest_legs(context.position, context.starts, context.lengths, context.left)


@kernel
def longest_legs(
    position: NDArray[np.float32],
    starts: NDArray[np.integer],
    n_points: NDArray[np.integer],
    left: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Longest segment of each ray; 0 for rays without any."""
    out = np.zeros(len(starts))
    for ray in range(len(starts)):
        for row in range(starts[ray], starts[ray] + n_points[ray] - 1 - left[ray]):
            total = 0.0
            for axis in range(3):
                step = float(position[row + 1, axis]) - float(position[row, axis])
                total += step * step
            out[ray] = max(out[ray], math.sqrt(total))
    return out


KINDS = (LongestLeg,)
