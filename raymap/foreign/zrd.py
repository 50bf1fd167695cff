"""Zemax ray databases (.zrd), saved uncompressed: their bytes, checked.

The layout is that of the OpticStudio manual, "The ZRD Uncompressed Full Data Format (UFD)":
version i4 (type × 10000 + number), most segments i4; then for each ray the number of its segments
i4 and the segments: ten i4 and doubles. Version 2003 (OpticStudio 2024) adds the optical path in
waves and in lens units and two diffraction orders to the 208 bytes of version 2002.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import RayMapError
from raymap.model.givenfile import check_given, not_readable

__all__ = ["FATAL", "SEGMENT", "Trees", "ZrdError", "ZrdFile"]

_INTEGERS = (
    "status", "level", "hit_object", "hit_face", "unused", "in_object", "parent", "storage",
    "xybin", "lmbin",
)  # fmt: skip
_DOUBLES = (
    "index", "starting_phase", "x", "y", "z", "l", "m", "n", "nx", "ny", "nz", "path_to",
    "intensity", "phase_of", "phase_at", "exr", "exi", "eyr", "eyi", "ezr", "ezi",
)  # fmt: skip
_BASE = [*((name, "<i4") for name in _INTEGERS), *((name, "<f8") for name in _DOUBLES)]

SEGMENT = {
    2002: np.dtype(_BASE),
    2003: np.dtype(
        [
            *_BASE,
            ("optical_path_w", "<f8"),
            ("optical_path_lu", "<f8"),
            ("order_x", "<i4"),
            ("order_y", "<i4"),
        ]
    ),
}
"""A segment by version of the format: 208 and 232 bytes."""

FATAL = 256
"""Bit of ``status``: the segment had a fatal error."""

_KINDS = {1: "compressed basic data", 2: "compressed full data"}
_USED = ("x", "y", "z", "l", "m", "n", "nx", "ny", "nz", "index", "intensity")


class ZrdError(RayMapError, ValueError):
    """A ray database cannot be read as it stands."""


@dataclass(frozen=True, eq=False)
class Trees:
    """Segments of some rays, tree after tree.

    Attributes
    ----------
    segments : (n,) of a dtype of `SEGMENT`; the first of each tree is where the ray starts
    parent : (n,) row of the segment that each one continues; -1 at the first of a tree
    tree : (n,) number of the tree in the file
    """

    segments: NDArray[np.void]
    parent: NDArray[np.int64]
    tree: NDArray[np.int64]


class ZrdFile:
    """An uncompressed ray database; its structure is checked when it is opened.

    Attributes
    ----------
    version : 2002 or 2003
    counts : (n_trees,) segments of each ray
    """

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, path.name
        check_given(path, "ray database", ZrdError)
        try:
            data = np.memmap(path, np.uint8, mode="r")
        except OSError as error:
            raise ZrdError(not_readable(path, "ray database", error)) from None
        if len(data) < 8:
            raise ZrdError(f"{self.name}: is too short for a Zemax ray database")
        first, most = struct.unpack("<ii", bytes(data[:8]))
        kind, self.version = divmod(first, 10_000)
        if kind in _KINDS and self.version in SEGMENT:
            raise ZrdError(
                f"{self.name}: holds {_KINDS[kind]}; save the ray database as uncompressed full "
                "data, which is the format that can be read"
            )
        if kind or self.version not in SEGMENT:
            raise ZrdError(
                f"{self.name}: is not a Zemax ray database of a known version (begins with "
                f"{first}; known are {', '.join(map(str, SEGMENT))})"
            )
        self.dtype = SEGMENT[self.version]
        self._data = data
        self.counts, self._starts = self._walk(most)

    @property
    def n_trees(self) -> int:
        return len(self.counts)

    def _walk(self, most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Segments of each ray and where they begin."""
        counts: list[int] = []
        starts: list[int] = []
        offset, size, width = 8, len(self._data), self.dtype.itemsize
        read = struct.Struct("<i").unpack_from
        view: Any = self._data
        while offset < size:
            count = read(view, offset)[0] if offset + 4 <= size else -1
            end = offset + 4 + count * width
            if count < 1 or count > max(most, 1) or end > size:
                raise ZrdError(
                    f"{self.name}: ray {len(counts) + 1}, at byte {offset}, has {count} segments; "
                    f"its header allows 1 to {most} and the file has {size} bytes: it is cut off "
                    "or of another version"
                )
            counts.append(count)
            starts.append(offset + 4)
            offset = end
        if not counts:
            raise ZrdError(f"{self.name}: holds no ray")
        return np.array(counts, np.int64), np.array(starts, np.int64)

    def pieces(self, segments: int = 2**16) -> Iterator[Trees]:
        """Rays in order, about so many segments at a time.

        Raises
        ------
        ZrdError
            A number is not finite, an intensity negative, or a segment continues none before it.
        """
        running = np.cumsum(self.counts)
        first = 0
        while first < self.n_trees:
            done = int(running[first - 1]) if first else 0
            end = int(np.searchsorted(running, done + segments, side="right"))
            end = max(end, first + 1)
            yield self._trees(first, end)
            first = end

    def _trees(self, first: int, end: int) -> Trees:
        counts, width = self.counts[first:end], self.dtype.itemsize
        low = int(self._starts[first])
        high = int(self._starts[end - 1] + counts[-1] * width)
        raw = np.array(self._data[low:high])
        # Cut out the counts that stand between rays
        kept = np.ones(len(raw), np.bool_)
        between = (self._starts[first + 1 : end] - 4 - low)[:, None] + np.arange(4)
        kept[between.ravel()] = False
        segments = raw[kept].view(self.dtype)
        tree = np.repeat(np.arange(first, end), counts)
        roots = np.concatenate(([0], np.cumsum(counts)[:-1]))
        is_root = np.zeros(len(segments), np.bool_)
        is_root[roots] = True
        parent = segments["parent"] + np.repeat(roots, counts)
        self._check(segments, tree, is_root, parent)
        parent[is_root] = -1
        return Trees(segments, parent, tree)

    def _check(
        self,
        segments: NDArray[np.void],
        tree: NDArray[np.int64],
        is_root: NDArray[np.bool_],
        parent: NDArray[np.int64],
    ) -> None:
        for name in _USED:
            bad = ~np.isfinite(segments[name])
            if bad.any():
                raise ZrdError(
                    f"{self.name}: ray {int(tree[np.argmax(bad)]) + 1}: {name} is not a number"
                )
        bad = segments["intensity"] < 0
        bad |= ~is_root & ((segments["parent"] < 0) | (parent >= np.arange(len(segments))))
        bad |= (
            (segments["hit_object"] < 0) | (segments["hit_face"] < 0) | (segments["in_object"] < 0)
        )
        if bad.any():
            raise ZrdError(
                f"{self.name}: ray {int(tree[np.argmax(bad)]) + 1} has a segment with a negative "
                "intensity or number, or one that continues no segment before it"
            )
