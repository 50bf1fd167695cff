"""Pairs of boxes that meet, among very many: what faces and bodies must be compared at all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["overlapping_boxes"]

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]

_FEW = 96
"""So many boxes are compared each with each."""

_LARGEST_HALF = 0.7
"""A cut is worth its time where neither side keeps a larger share of the boxes."""

_BATCH = 1 << 20


class _Room(NamedTuple):
    """Boxes in a part of space: pairs belong to the part that holds the lowest corner they share.

    items : numbers of the boxes that reach into it
    low, high : its corners; the upper one is not part of it
    """

    items: Numbers
    low: Array
    high: Array


def overlapping_boxes(
    low: Array, high: Array, reach: float = 0.0
) -> Iterator[tuple[Numbers, Numbers]]:
    """All pairs of boxes that meet, each once, the smaller number first, a batch at a time.

    Space is cut in halves along the dimension that separates the boxes best, until few are left
    together. Boxes that all meet one another are compared each with each.

    Parameters
    ----------
    low, high : (n, d) corners in any number of dimensions
    reach : distance at which boxes still meet, in every dimension
    """
    n, d = low.shape
    everywhere = np.full(d, np.inf)
    rooms = [_Room(np.arange(n), -everywhere, everywhere)]
    while rooms:
        room = rooms.pop()
        halves = _halves(room, low, high, reach) if len(room.items) > _FEW else None
        if halves is None:
            yield from _pairs(room, low, high, reach)
        else:
            rooms += halves


def _halves(room: _Room, low: Array, high: Array, reach: float) -> list[_Room] | None:
    """The room cut where that separates most boxes; None where no cut does."""
    lows, highs = low[room.items], high[room.items] + reach
    cuts = np.median(0.5 * (lows + highs), axis=0)
    left, right = lows < cuts, highs >= cuts
    larger = np.maximum(left.sum(axis=0), right.sum(axis=0))
    k = int(np.argmin(larger))
    if larger[k] > _LARGEST_HALF * len(room.items):
        return None
    before, after = room.high.copy(), room.low.copy()
    before[k] = after[k] = cuts[k]
    return [
        _Room(room.items[left[:, k]], room.low, before),
        _Room(room.items[right[:, k]], after, room.high),
    ]


def _pairs(room: _Room, low: Array, high: Array, reach: float) -> Iterator[tuple[Numbers, Numbers]]:
    """Pairs of a room that meet in it, each box compared with each that follows."""
    items, rows = room.items, max(1, _BATCH // max(1, len(room.items)))
    lows, highs = low[items], high[items] + reach
    for start in range(0, len(items), rows):
        some = slice(start, start + rows)
        meets = np.triu(np.ones((len(items[some]), len(items) - start), bool), 1)
        for k in range(low.shape[1]):
            shared = np.maximum(lows[some, None, k], lows[None, start:, k])
            meets &= shared <= np.minimum(highs[some, None, k], highs[None, start:, k])
            meets &= (shared >= room.low[k]) & (shared < room.high[k])
        one, other = np.nonzero(meets)
        if len(one):
            yield items[some][one], items[start:][other]
