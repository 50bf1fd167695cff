"""Which faces a ray can meet next, found once per scene from boxes that surely hold the faces.

A ray that leaves a face starts inside that face's box. If it does not go back along some axis, it
cannot meet what lies behind the box on that axis; and it travels at least the distance of both
boxes to meet a face. Both statements hold for every ray, so a list may be left as soon as all rays
have met something nearer than the rest of it.

In scenes of few faces a list also says which hits are *decided* early: those on a face before which
nothing that is left in the list can be met (`tracer.scene.arrangement.precedence`). Faces that are
likely to decide many rays come first, so most rays of a lens are tried with one or two faces.

In scenes of very many faces neighbours share a list: each face having its own would take memory and
time in proportion to the square of their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.kinds import MESH, SPHERE
from tracer.geometry.shape_columns import ShapeColumns
from tracer.scene.arrangement.precedence import Precedence

__all__ = ["Candidates", "StartBins"]

Array = NDArray[np.float64]

_FEW_FACES = 128
"""Comparing all triples of faces is worth its time up to so many."""

_ENTRIES = 1 << 22
"""Faces share lists where these would have more entries in all."""


class Candidates(NamedTuple):
    """Candidate lists of all start bins.

    list_of (start_bins,) : number of the list of each start bin
    first (n + 1,) : list k is entries first[k] to first[k + 1]
    face : numbers of faces
    distance : lower bound of the distance of this entry and all that follow
    decided (n, 2 x faces) : place in the list after which a hit on a face is decided; in the second
        half hits on spheres that rays leave. (0, 0) in scenes of many faces
    decides : whether any hit becomes decided at an entry
    likely (n,) : place in the list of the face that most rays are likely to meet, -1 unknown
    """

    list_of: NDArray[np.int64]
    first: NDArray[np.int64]
    face: NDArray[np.int64]
    distance: Array
    decided: NDArray[np.int32]
    decides: NDArray[np.uint8]
    likely: NDArray[np.int32]

    def bound_for(self, wanted: NDArray[np.uint8]) -> NDArray[np.int32]:
        """``likely`` where the face is a wanted one, else -1."""
        known = np.flatnonzero(self.likely >= 0)
        known = known[wanted[self.face[self.first[known] + self.likely[known]]] != 0]
        found = np.full(len(self.likely), -1, np.int32)
        found[known] = self.likely[known]
        return found


class _List(NamedTuple):
    """What rays of a start bin can meet.

    start : number of the face or source, -1 anywhere or on one of many faces
    faces : in the order in which they are tried
    distance (n,) : lower bound of the distance of each face of the scene
    decided (2 n,) : as in `Candidates`; empty in scenes of many faces
    likely : as in `Candidates`
    """

    start: int
    faces: NDArray[np.intp]
    distance: Array
    decided: NDArray[np.int32]
    likely: int

    def bounds(self) -> Array:
        """Lower bound of the distance of each entry and all that follow."""
        return np.minimum.accumulate(self.distance[self.faces][::-1])[::-1]


class StartBins:
    """Where rays of a scene start from, and what they can meet from there.

    A *start bin* is 2 x face (+1 for directions along the face's main axis), then one per source,
    then one for rays that start in a medium.

    Parameters
    ----------
    shapes : all faces; those of meshes are start bins, but no candidates
    sources : per source the box that it emits from and the direction of its beam (zero: any)
    """

    def __init__(self, shapes: ShapeColumns, sources: Sequence[tuple[Array, Array, Array]]) -> None:
        n = len(shapes)
        self._low, self._high, self._kinds, self.axes = (
            shapes.low, shapes.high, shapes.kind, shapes.axis,
        )  # fmt: skip
        self._precedence = None
        if 0 < n <= _FEW_FACES and bool((self._kinds != MESH).any()):
            self._precedence = Precedence(
                shapes.shapes, [(start, stop) for start, stop, _ in sources]
            )
        self._lists: list[_List] = []
        list_of = self._face_lists() if 2 * n * n <= _ENTRIES else self._shared_lists()
        for number, (low, high, beam) in enumerate(sources):
            signs = np.sign(np.where(np.abs(beam) < 1e-12, 0.0, beam))
            self._lists.append(self._list(low, high, signs, n + number))
        everywhere = np.full(3, np.inf)
        self._lists.append(self._list(-everywhere, everywhere, np.zeros(3), -1))
        rest = np.arange(len(self._lists) - len(sources) - 1, len(self._lists))
        self._list_of = np.concatenate([list_of, rest]).astype(np.int64)

    def _face_lists(self) -> NDArray[np.int64]:
        """A list per face and sense; their numbers by start bin."""
        for face in range(len(self._kinds)):
            for sign in (-1, 1):
                signs = np.zeros(3)
                signs[self.axes[face]] = sign
                self._lists.append(self._list(self._low[face], self._high[face], signs, face))
        return np.arange(2 * len(self._kinds))

    def _shared_lists(self) -> NDArray[np.int64]:
        """A list per group of neighbours of one main axis, and sense; numbers by start bin."""
        n = len(self._kinds)
        rooms = max(1, _ENTRIES // (6 * n))
        group = 3 * _neighbours(0.5 * (self._low + self._high), rooms) + self.axes
        list_of = np.zeros((n, 2), np.int64)
        for number in np.unique(group):
            faces = np.flatnonzero(group == number)
            low, high = self._low[faces].min(axis=0), self._high[faces].max(axis=0)
            for k, sign in enumerate((-1, 1)):
                signs = np.zeros(3)
                signs[self.axes[faces[0]]] = sign
                list_of[faces, k] = len(self._lists)
                self._lists.append(self._list(low, high, signs, -1))
        return list_of.reshape(-1)

    @property
    def sortable(self) -> bool:
        """Whether the order of faces matters: there are few, and not only meshes."""
        return self._precedence is not None

    def candidates(self, met: NDArray[np.int64] | None = None) -> Candidates:
        """The lists as they stand in a compiled scene.

        Parameters
        ----------
        met : (start_bins, faces) rays of each start bin by the face that they met next, as far as
            that has been counted; it is guessed otherwise. The order of a list decides how soon a
            hit is found, not which.
        """
        lists = list(self._lists)
        if met is not None and self.sortable:
            for k in np.flatnonzero(met.any(axis=1)):
                lists[k] = self._in_likely_order(lists[k], met[k])
        known = self._precedence is not None
        n = len(self._kinds) if known else 0
        first = np.concatenate(([0], np.cumsum([len(item.faces) for item in lists])))
        decides = np.zeros(first[-1], np.uint8)
        for item, start in zip(lists, first[:-1], strict=True):
            decides[start + item.decided[item.decided < _NEVER]] = 1
        rows = [item.decided for item in lists] if known else []
        return Candidates(
            list_of=self._list_of,
            first=first.astype(np.int64),
            face=np.concatenate([item.faces for item in lists]).astype(np.int64),
            distance=np.concatenate([item.bounds() for item in lists]),
            decided=np.array(rows, np.int32).reshape(len(rows), 2 * n),
            decides=decides,
            likely=np.array([item.likely for item in lists], np.int32),
        )

    def _list(self, start_low: Array, start_high: Array, signs: Array, start: int) -> _List:
        """What rays can meet that start in a box and go along some axes."""
        n, low, high = len(self._kinds), self._low, self._high
        ahead = self._kinds != MESH
        for axis in range(3):
            if signs[axis] > 0:
                ahead &= high[:, axis] >= start_low[axis]
            elif signs[axis] < 0:
                ahead &= low[:, axis] <= start_high[axis]
        if 0 <= start < n and self._kinds[start] < SPHERE:
            ahead[start] = False
        gap = np.maximum(0.0, np.maximum(low - start_high, start_low - high))
        distance = np.linalg.norm(gap, axis=1) * (1.0 - 1e-12)
        order = np.argsort(distance, kind="stable")
        never = np.full(2 * n if self.sortable else 0, _NEVER, np.int32)
        found = _List(start, order[ahead[order]], distance, never, -1)
        if start < 0 or not self.sortable:
            # Nothing is known of rays that start anywhere
            return found
        away = 0.5 * (low + high - start_low - start_high)
        return self._in_likely_order(found, _apparent_size(high - low, away))

    def _in_likely_order(self, item: _List, weight: Array | NDArray[np.int64]) -> _List:
        """The list with those faces first that decide the most rays for the fewest tests.

        ``weight`` (n,) is in proportion to the rays that meet each face.
        """
        if self._precedence is None:
            return item
        n = len(self._kinds)
        entered = ~self._precedence.excluded(item.start, sphere_entered=True)
        left = ~self._precedence.excluded(item.start, sphere_entered=False)
        candidates = np.zeros(n, bool)
        candidates[item.faces] = True
        entered &= candidates
        left &= candidates
        waiting = candidates.copy()
        placed: list[int] = []
        guess = -1
        while waiting.any():
            tests = 1 + (entered & waiting[None, :]).sum(axis=1)
            gain = np.where(waiting, (weight + 1e-9) / tests, -1.0)
            best = int(np.argmax(gain))
            before = np.flatnonzero(entered[best] & waiting)
            for face in (*before[np.argsort(item.distance[before], kind="stable")], best):
                placed.append(int(face))
                waiting[face] = False
            if guess < 0:
                guess = len(placed) - 1
        index = np.full(n, -1, np.int32)
        index[placed] = np.arange(len(placed))
        decided = np.full(2 * n, _NEVER, np.int32)
        for half, rest in enumerate((entered, left)):
            last = np.where(rest, index[None, :], -1).max(axis=1)
            after = np.maximum(last, index)
            decided[half * n : half * n + n] = np.where(candidates, after, _NEVER)
        return item._replace(faces=np.array(placed, np.intp), decided=decided, likely=guess)


_NEVER = 2**31 - 1


def _apparent_size(extent: Array, away: Array) -> Array:
    """Rough solid angle of boxes in the direction ``away``, at most 1."""
    square = np.maximum((away**2).sum(axis=1), 1e-300)
    share = np.abs(away) / np.sqrt(square)[:, None]
    across = np.stack([extent[:, (k + 1) % 3] * extent[:, (k + 2) % 3] for k in range(3)], axis=1)
    return np.asarray(np.minimum(1.0, (share * across).sum(axis=1) / square))


def _neighbours(places: Array, rooms: int) -> NDArray[np.int64]:
    """(n,): places in up to so many groups of equal size, each in a box of its own."""
    groups = [np.arange(len(places))]
    while 2 * len(groups) <= rooms and len(groups[0]) > 1:
        halves = []
        for items in groups:
            extent = np.ptp(places[items], axis=0)
            order = items[np.argsort(places[items, int(np.argmax(extent))], kind="stable")]
            halves += [order[: len(order) // 2], order[len(order) // 2 :]]
        groups = halves
    number = np.zeros(len(places), np.int64)
    for k, items in enumerate(groups):
        number[items] = k
    return number
