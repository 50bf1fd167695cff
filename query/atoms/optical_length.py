"""``optical_length <= 150 mm``: sum of refractive index times length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundNode, BoundValue
from query.engine.context import RayContext
from query.expression.atom import Comparison, Quantity

__all__ = ["KINDS", "OpticalLength", "optical_length"]


class OpticalLength(Quantity):
    """Sum of refractive index x length [scene units]."""

    word = "optical_length"
    title = "sum of refractive index times length"
    dimension = "length"
    place = 220

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        return BoundOpticalLength(text=text, **vars(comparison))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundOpticalLength(BoundValue):
    """Weighs each segment with the refractive index of its medium."""

    def own_streams(self) -> tuple[str, ...]:
        return ("position", "color")

    def values(self, context: RayContext) -> NDArray[Any]:
        channel_set = context.channel_set
        shape = (-1, channel_set.n_channels)
        return context.recorded.optical_lengths(
            context.medium,
            context.last_color,
            context.channels,
            np.array(channel_set.refractive_index, np.float64).reshape(shape),
        )


optical_length = OpticalLength()

KINDS = (OpticalLength,)
