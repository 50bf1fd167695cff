"""Which faces a ray can meet next, found once per scene from boxes that surely hold the faces.

A ray that leaves a face starts inside that face's box. If it does not go back along some axis, it
cannot meet what lies behind the box on that axis; and it travels at least the distance of both
boxes to meet a face. Both statements hold for every ray, so a list may be left as soon as all rays
have met something nearer than the rest of it.

In scenes of few faces a list also says which hits are *settled* early: those on a face before which
nothing that is left in the list can be met (`tracer.scene.precedence`). Faces that are likely to
settle many rays come first, so most rays of a lens are tried with one or two faces.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.kinds import MESH, SPHERE
from tracer.geometry.shapes import Shape
from tracer.scene.precedence import Precedence

__all__ = ["Candidates", "find_candidates", "main_axis"]

Array = NDArray[np.float64]

_FEW_FACES = 128
"""Comparing all triples of faces is worth its time up to so many."""


class Candidates(NamedTuple):
    """Candidate lists of all departures.

    first (n + 1,) : list of departure k is entries first[k] to first[k + 1]
    face : numbers of faces
    distance : lower bound of the distance of this entry and all that follow
    settle (n, 2 x faces) : place in the list after which a hit on a face is settled; in the second
        half hits on spheres that rays leave. (0, 0) in scenes of many faces
    settles : whether any hit becomes settled at an entry
    likely (n,) : place in the list of the face that most rays are likely to meet, -1 unknown
    """

    first: NDArray[np.int64]
    face: NDArray[np.int64]
    distance: Array
    settle: NDArray[np.int32]
    settles: NDArray[np.uint8]
    likely: NDArray[np.int32]

    def bound_for(self, wanted: NDArray[np.uint8]) -> NDArray[np.int32]:
        """``likely`` where the face is a wanted one, else -1."""
        known = np.flatnonzero(self.likely >= 0)
        known = known[wanted[self.face[self.first[known] + self.likely[known]]] != 0]
        found = np.full(len(self.likely), -1, np.int32)
        found[known] = self.likely[known]
        return found


def find_candidates(
    shapes: Sequence[Shape], sources: Sequence[tuple[Array, Array, Array]]
) -> Candidates:
    """Candidate lists of all departures.

    A *departure* is 2 x face (+1 for directions along the face's main axis), then one per source,
    then one for rays that start in a medium.

    Parameters
    ----------
    shapes : all faces; those of meshes are departures, but no candidates
    sources : per source the box that it emits from and the direction of its beam (zero: any)
    """
    n = len(shapes)
    boxes = [shape.bounds() for shape in shapes]
    low = np.array([box[0] for box in boxes]).reshape(n, 3)
    high = np.array([box[1] for box in boxes]).reshape(n, 3)
    analytic = np.array([shape.kind != MESH for shape in shapes], bool)
    axes = np.array([main_axis(shape) for shape in shapes], np.int32)
    precedence = None
    if 0 < n <= _FEW_FACES and bool(analytic.any()):
        precedence = Precedence(shapes, [(start, stop) for start, stop, _ in sources])
    lists = []
    rows = []
    likely = []

    def add(start_low: Array, start_high: Array, signs: Array, start: int = -1) -> None:
        ahead = np.ones(n, bool)
        for axis in range(3):
            if signs[axis] > 0:
                ahead &= high[:, axis] >= start_low[axis]
            elif signs[axis] < 0:
                ahead &= low[:, axis] <= start_high[axis]
        ahead &= analytic
        if 0 <= start < n and shapes[start].kind < SPHERE:
            ahead[start] = False
        gap = np.maximum(0.0, np.maximum(low - start_high, start_low - high))
        distance = np.linalg.norm(gap, axis=1) * (1.0 - 1e-12)
        order = np.argsort(distance, kind="stable")
        order = order[ahead[order]]
        if precedence is not None:
            away = np.zeros((n, 3))
            if start >= 0:
                away = 0.5 * (low + high - start_low - start_high)
            order, row, place = _in_likely_order(
                order, distance, _apparent_size(high - low, away), precedence, start
            )
            rows.append(row)
            likely.append(place)
        lists.append((order, np.minimum.accumulate(distance[order][::-1])[::-1]))

    for face in range(n):
        for sign in (-1, 1):
            signs = np.zeros(3)
            signs[axes[face]] = sign
            add(low[face], high[face], signs, face)
    for number, (start_low, start_high, beam) in enumerate(sources):
        signs = np.sign(np.where(np.abs(beam) < 1e-12, 0.0, beam))
        add(start_low, start_high, signs, n + number)
    everywhere = np.full(3, np.inf)
    add(-everywhere, everywhere, np.zeros(3))
    first = np.concatenate(([0], np.cumsum([len(order) for order, _ in lists]))).astype(np.int64)
    faces = np.concatenate([order for order, _ in lists]).astype(np.int64)
    settles = np.zeros(len(faces), np.uint8)
    for row, start in zip(rows, first[:-1], strict=False):
        places = row[row < _NEVER]
        settles[start + places] = 1
    return Candidates(
        first=first,
        face=faces,
        distance=np.concatenate([distance for _, distance in lists]),
        settle=np.array(rows, np.int32).reshape(len(rows), 2 * n if rows else 0),
        settles=settles,
        likely=np.array(likely or [-1] * len(lists), np.int32),
    )


_NEVER = 2**31 - 1


def _apparent_size(extent: Array, away: Array) -> Array:
    """Rough solid angle of boxes in the direction ``away``, at most 1."""
    square = np.maximum((away**2).sum(axis=1), 1e-300)
    share = np.abs(away) / np.sqrt(square)[:, None]
    across = np.stack([extent[:, (k + 1) % 3] * extent[:, (k + 2) % 3] for k in range(3)], axis=1)
    return np.asarray(np.minimum(1.0, (share * across).sum(axis=1) / square))


def _in_likely_order(
    order: NDArray[np.intp], distance: Array, size: Array, precedence: Precedence, start: int
) -> tuple[NDArray[np.intp], NDArray[np.int32], int]:
    """Faces in an order that settles rays soon, the place where each one's hits are settled, and
    the place of the face that is the best guess.
    """
    n = precedence.n
    row = np.full(2 * n, _NEVER, np.int32)
    if start < 0:
        # Nothing is known of rays that start anywhere
        return order, row, -1
    entered = ~precedence.excluded(start, sphere_entered=True)
    left = ~precedence.excluded(start, sphere_entered=False)
    candidates = np.zeros(n, bool)
    candidates[order] = True
    entered &= candidates
    left &= candidates
    # Take next what settles the most for the fewest tests, what comes before it first
    waiting = candidates.copy()
    placed: list[int] = []
    guess = -1
    while waiting.any():
        tests = 1 + (entered & waiting[None, :]).sum(axis=1)
        gain = np.where(waiting, (size + 1e-9) / tests, -1.0)
        best = int(np.argmax(gain))
        before = np.flatnonzero(entered[best] & waiting)
        for face in (*before[np.argsort(distance[before], kind="stable")], best):
            placed.append(int(face))
            waiting[face] = False
        if guess < 0:
            guess = len(placed) - 1
    place = np.full(n, -1, np.int32)
    place[placed] = np.arange(len(placed))
    for half, rest in enumerate((entered, left)):
        last = np.where(rest, place[None, :], -1).max(axis=1)
        settled = np.maximum(last, place)
        row[half * n : half * n + n] = np.where(candidates, settled, _NEVER)
    return np.array(placed, np.intp), row, guess


def main_axis(shape: Shape) -> int:
    """Coordinate axis nearest to the axis or normal of a face."""
    return int(np.argmax(np.abs(shape.row()[3:6])))
