"""Paths told apart as path tables tell them: by face or object, principal events, registrations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.context import PathColumns, PathContext
from query.engine.path_machine import PRINCIPAL
from query.engine.tally import Tally
from raymap.jit.kernels import kernel
from raymap.model.events import FAMILIES

__all__ = ["Keys", "Part", "group", "path_keys"]

Ints = NDArray[np.integer]

_REFLECTED = int(FAMILIES["reflected"])


@dataclass(frozen=True, eq=False)
class Keys:
    """What a path table needs to know of each path.

    Attributes
    ----------
    low, high : (n,) uint64, 128 bits of hash that equal rows share
    source : (n,) int16
    reflections : (n,) int32, points with a reflection of any kind
    first, last : (n,) int16, first and last object met, -1 none
    """

    low: NDArray[np.uint64]
    high: NDArray[np.uint64]
    source: Ints
    reflections: NDArray[np.int32]
    first: NDArray[np.int16]
    last: NDArray[np.int16]

    def take(self, rows: Ints) -> Keys:
        return Keys(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @classmethod
    def join(cls, parts: list[Keys]) -> Keys:
        return cls(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in cls.__dataclass_fields__
            )
        )


@dataclass(frozen=True, eq=False)
class Part:
    """Grouped paths; ``places`` tell where one of each group stands.

    Attributes
    ----------
    places : (n, 2) int64, where: a portion, -1 the merged paths, -2 - k those of shard k; and row
    """

    keys: Keys
    tally: Tally
    places: NDArray[np.int64]


@kernel
def _mix(state: Any, value: Any) -> Any:
    """One round of a 64-bit multiply-xorshift hash (the finaliser of MurmurHash3)."""
    h = np.uint64(state) ^ np.uint64(value)
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xFF51AFD7ED558CCD)
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xC4CEB9FE1A85EC53)
    h ^= h >> np.uint64(33)
    return h


@kernel
def _keys(
    paths: PathColumns,
    by_face: bool,
    low: NDArray[np.uint64],
    high: NDArray[np.uint64],
    reflections: NDArray[np.int32],
    first: NDArray[np.int16],
    last: NDArray[np.int16],
) -> None:
    salt = np.uint64(0x9E3779B97F4A7C15)
    offsets, event = paths.offsets, paths.event
    for path in range(len(paths.source)):
        a = _mix(1, np.uint64(paths.source[path]))
        b = _mix(2, np.uint64(paths.source[path]) ^ salt)
        n_reflections = 0
        first[path] = -1
        last[path] = -1
        for row in range(offsets[path], offsets[path + 1]):
            owner = paths.object[row]
            # Object, face and events of the point in one word.
            bits = np.uint64(owner + 1) << np.uint64(44)
            if by_face:
                bits ^= np.uint64(paths.face[row] + 1) << np.uint64(26) << np.uint64(2)
            word = bits ^ np.uint64(event[row] & PRINCIPAL)
            a = _mix(a, word)
            b = _mix(b, word ^ salt)
            if event[row] & _REFLECTED:
                n_reflections += 1
            if owner >= 0 and row > offsets[path]:
                if first[path] < 0:
                    first[path] = owner
                last[path] = owner
            for crossing in range(paths.crossing_offsets[row], paths.crossing_offsets[row + 1]):
                if paths.registered[crossing]:
                    word = (np.uint64(1) << np.uint64(63)) | np.uint64(paths.detector[crossing])
                    a = _mix(a, word)
                    b = _mix(b, word ^ salt)
        low[path] = a
        high[path] = b
        reflections[path] = n_reflections


def path_keys(base: PathContext, by: str) -> Keys:
    """Keys of every path; ``by`` is "face" or "object"."""
    known: dict[str, Keys] = base.__dict__.setdefault("keys", {})
    if by not in known:
        known[by] = _new_keys(base, by)
    return known[by]


def _new_keys(base: PathContext, by: str) -> Keys:
    n = base.n_rays
    low, high = np.empty(n, np.uint64), np.empty(n, np.uint64)
    reflections, first, last = np.empty(n, np.int32), np.empty(n, np.int16), np.empty(n, np.int16)
    by_face = by == "face"
    _keys(base.columns(face=by_face), by_face, low, high, reflections, first, last)
    return Keys(low, high, base.source, reflections, first, last)


def group(keys: Keys) -> tuple[Ints, Ints]:
    """Rows of equal keys: (one row of each group, group of each row)."""
    order = np.lexsort((keys.high, keys.low))
    if not len(order):
        return order, order
    low, high = keys.low[order], keys.high[order]
    fresh = np.concatenate(([True], (low[1:] != low[:-1]) | (high[1:] != high[:-1])))
    numbers = np.cumsum(fresh) - 1
    groups = np.empty(len(order), np.int64)
    groups[order] = numbers
    return order[fresh], groups
