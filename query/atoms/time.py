"""``time < 500 ps``: how long light was on its way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundNode, BoundValue
from query.engine.context import RayContext
from query.engine.group_indices import SPEED_OF_LIGHT, group_indices
from query.expression.atom import Comparison, Quantity
from raymap.model.errors import CriterionError
from raymap.model.units import METRES

__all__ = ["KINDS", "Time", "time"]


class Time(Quantity):
    """Σ n_g L / c along the ray [ps], n_g = n - λ dn/dλ; without the last segment if it left."""

    word = "time"
    title = "how long light was on its way"
    dimension = "time"
    measured = "a time"
    place = 225

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        unit = binder.directory.length_unit
        if unit not in METRES:
            raise CriterionError(
                f"the map's unit of length, {unit!r}, is not known: it has no times"
            )
        indices = {
            chosen: group_indices(binder.directory, channels)
            for chosen, channels in enumerate(binder.facts.channel_sets)
        }
        picoseconds = METRES[unit] / SPEED_OF_LIGHT * 1e12
        return BoundTime(text=text, **vars(comparison), indices=indices, picoseconds=picoseconds)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundTime(BoundValue):
    """``indices`` : (n_media, n_channels) by channel set; ``picoseconds`` : of a length of 1."""

    indices: dict[int, NDArray[np.float64]]
    picoseconds: float

    def own_streams(self) -> tuple[str, ...]:
        return ("position", "color")

    def values(self, context: RayContext) -> NDArray[Any]:
        lengths = context.recorded.optical_lengths(
            context.medium,
            context.last_color,
            context.channels,
            self.indices[context.portion.channel_set],
        )
        return lengths * self.picoseconds

    def undefined(self, map: Any) -> str:
        unknown = np.logical_or.reduce(
            [np.isnan(rows).any(axis=1) for rows in self.indices.values()]
        )
        media = [map.directory.media[number] for number in np.flatnonzero(unknown)]
        names = [medium.name for medium in media]
        shown = ", ".join(names[:5]) + (" …" if len(names) > 5 else "")
        if media and all(medium.kind == "crystal" for medium in media):
            return f"light has no single speed in a crystal ({shown})"
        if names:
            return f"the map does not say the group index of {shown}; record it again"
        return "channels of mixed light arrive at different times"

    def never(self, map: Any) -> str | None:
        if not all(np.isnan(rows).all() for rows in self.indices.values()):
            return None
        return f"{self.text}: the map does not say how fast pulses travel; record it again"


time = Time()

KINDS = (Time,)
