"""Find the different paths of a portion, number its rays, and merge portions' dictionaries."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.paths import PathDictionary
from raymap.encoding.pathwords import (
    FaceColumns,
    PathWords,
    RayColumns,
    enter_hashes,
    name_faces,
    number_rays,
    words_needed,
    write_paths,
)
from raymap.jit.scratch import scratch
from raymap.model.errors import InvalidPortion
from raymap.model.portion import Portion
from raymap.model.rows import offsets_of

__all__ = [
    "FoundPaths",
    "Itineraries",
    "PathMerger",
    "find_paths",
    "itineraries_of",
]

MAX_SHARE = 0.5
"""A dictionary with more different paths than this share of the rays is not worth keeping."""

_EARLY = 8
"""After this part of the rays it is judged whether going on is worth it."""
_SURELY = 1.2
_FEWEST = 4096

_SPREAD = np.uint64(0x9FB21C651E98DF25)
_NO_FACES = FaceColumns(*(np.empty(0, np.int32) for _ in range(5)))


class Itineraries(NamedTuple):
    """The columns of which paths are made, path after path (or ray after ray).

    Attributes
    ----------
    source : (n,) int16
    offsets : (n + 1,) int64, points of path (or ray) i are rows offsets[i]:offsets[i + 1]
    object, face, event, medium, crossings : (n_points,)
    detector, registered : (n_crossings,)
    """

    source: NDArray[np.int16]
    offsets: NDArray[np.int64]
    object: NDArray[np.int16]
    face: NDArray[np.int32]
    event: NDArray[np.int32]
    medium: NDArray[np.int16]
    crossings: NDArray[np.uint16]
    detector: NDArray[np.int16]
    registered: NDArray[np.bool_]

    def with_sums(
        self,
        rays: NDArray[np.int64],
        sum_w: NDArray[np.float64],
        sum_w2: NDArray[np.float64],
        sum_wc: tuple[NDArray[np.float64], ...],
        sum_wy2: NDArray[np.float64] | None,
        *,
        grouped: bool,
    ) -> PathDictionary:
        """The paths with how much light took them."""
        return PathDictionary(
            source=self.source,
            offsets=self.offsets,
            object=self.object,
            face=self.face,
            event=self.event,
            medium=self.medium,
            detector_offsets=offsets_of(self.crossings),
            detector=self.detector,
            registered=self.registered,
            rays=rays,
            sum_w=sum_w,
            sum_w2=sum_w2,
            sum_wc=sum_wc,
            sum_wy2=sum_wy2,
            grouped=grouped,
        )


class FoundPaths(NamedTuple):
    """The different paths of a portion.

    Attributes
    ----------
    table : by descending number of rays
    numbers : (n_rays,) path of each ray
    rays : (n_paths,) rays of each
    explicit : primitives that the faces do not imply, in record order
    """

    table: Itineraries
    numbers: NDArray[np.uint32]
    rays: NDArray[np.int64]
    explicit: NDArray[np.int32]


def itineraries_of(
    portion: Portion, faces: FaceColumns, offsets: NDArray[np.int64]
) -> tuple[Itineraries, NDArray[np.int32]]:
    """The itineraries of a portion's rays, which begin at ``offsets``.

    Returns
    -------
    itineraries, explicit : the latter as in `FoundPaths`

    Raises
    ------
    InvalidPortion
        A record names an object or a primitive that the directory does not have.
    """
    face = scratch("faces", portion.n_records, np.int32)
    explicit = scratch("explicit", portion.n_records, np.int32)
    found = np.zeros(3, np.int64)
    name_faces(portion.object, portion.triangle, faces, face, explicit, found)
    if found[2] >= 0:
        raise _foreign(portion, int(found[2]))
    table = Itineraries(
        portion.source,
        offsets,
        portion.object,
        face,
        portion.event,
        portion.medium,
        portion.descriptor_count,
        portion.descriptors.detector,
        portion.descriptors.registered,
    )
    return table, explicit[: found[1]]


def _foreign(portion: Portion, record: int) -> InvalidPortion:
    return InvalidPortion(
        f"record {record} names object {portion.object[record]}, primitive "
        f"{portion.triangle[record]}, which the directory does not have"
    )


def find_paths(
    portion: Portion, faces: FaceColumns, spread: np.uint64 = _SPREAD
) -> FoundPaths | None:
    """The different paths of a portion, None where they repeat too little.

    Parameters
    ----------
    spread : factor of the hashes

    Raises
    ------
    InvalidPortion
        A record names an object or a primitive that the directory does not have.
    """
    n_rays, n_records = portion.n_rays, portion.n_records
    crossings = portion.descriptors
    limit = max(1, int(n_rays * MAX_SHARE))
    paths = PathWords(
        scratch("words", words_needed(n_rays, n_records, len(crossings.detector)), np.uint64),
        scratch("starts", limit + 2, np.int64),
        scratch("hashes", limit + 1, np.uint64),
        scratch("table", 1 << (2 * limit + 1).bit_length(), np.int32),
    )
    paths.starts[0] = 0
    paths.table.fill(-1)
    group = scratch("group", n_rays, np.uint32)
    explicit = scratch("explicit", n_records, np.int32)
    n_paths, n_explicit = _number_all(portion, faces, paths, limit, spread, group, explicit)
    if n_paths < 0:
        return None
    # Number the paths by descending number of rays
    rays = np.bincount(group, minlength=n_paths)
    order = np.argsort(-rays, kind="stable")
    rank = np.empty(n_paths, np.uint32)
    rank[order] = np.arange(n_paths, dtype=np.uint32)
    return FoundPaths(_unpacked(paths, order), rank[group], rays[order], explicit[:n_explicit])


def _number_all(
    portion: Portion,
    faces: FaceColumns,
    paths: PathWords,
    limit: int,
    spread: np.uint64,
    numbers: NDArray[np.uint32],
    explicit: NDArray[np.int32],
) -> tuple[int, int]:
    """Number the paths of a portion's rays: how many there are, and how many explicit primitives.

    -1 where there are more than the limit, or where what the first rays bring foretells it.
    """
    d = portion.descriptors
    n_rays = portion.n_rays
    part = n_rays // _EARLY
    stops = [n_rays] if part < _FEWEST // _EARLY else [part // 2, part, n_rays]
    found = np.zeros(3, np.int64)
    n_paths, n_before, n_explicit, start, record, crossing = 0, 0, 0, 0, 0, 0
    for stop in stops:
        number_rays(
            RayColumns(
                portion.source[start:stop],
                portion.records_per_ray[start:stop],
                portion.object[record:],
                portion.triangle[record:],
                portion.event[record:],
                portion.medium[record:],
                portion.descriptor_count[record:],
                d.detector[crossing:],
                d.registered.view(np.uint8)[crossing:],
            ),
            faces,
            paths,
            n_paths,
            limit,
            spread,
            numbers[start:stop],
            explicit[n_explicit:],
            found,
        )
        if found[2] >= 0:
            raise _foreign(portion, record + int(found[2]))
        n_before, n_paths = n_paths, int(found[0])
        # Paths that grow as a power of the rays go on to do so, or slower
        if n_paths < 0 or (
            stop == part and n_paths * (n_paths / n_before) ** np.log2(_EARLY) > _SURELY * limit
        ):
            return -1, 0
        n_explicit += int(found[1])
        if stop < n_rays:
            ahead = int(portion.records_per_ray[start:stop].sum())
            crossing += int(portion.descriptor_count[record : record + ahead].sum())
            start, record = stop, record + ahead
    return n_paths, n_explicit


def _unpacked(paths: PathWords, order: NDArray[np.int64]) -> Itineraries:
    """The itineraries of some paths."""
    starts = paths.starts[order]
    lengths = (paths.words[starts] >> np.uint64(16)).astype(np.int64)
    offsets = offsets_of(lengths)
    n, n_points = len(order), int(offsets[-1])
    n_crossings = int((paths.starts[order + 1] - starts).sum()) - words_needed(n, n_points, 0)
    columns = RayColumns(
        np.empty(n, np.int16),
        np.empty(n, np.int32),
        np.empty(n_points, np.int16),
        np.empty(n_points, np.int32),
        np.empty(n_points, np.int32),
        np.empty(n_points, np.int16),
        np.empty(n_points, np.uint16),
        np.empty(n_crossings, np.int16),
        np.empty(n_crossings, np.uint8),
    )
    write_paths(order, paths, offsets, columns)
    return Itineraries(
        columns.source,
        offsets,
        columns.object,
        columns.primitive,
        columns.event,
        columns.medium,
        columns.crossings,
        columns.detector,
        columns.registered.view(np.bool_),
    )


class PathMerger:
    """The growing dictionary of a whole map; paths are numbered in order of first appearance."""

    def __init__(self) -> None:
        self.n_paths = 0
        self.grouped = False
        self._paths = PathWords(
            np.empty(2**15, np.uint64),
            np.zeros(1025, np.int64),
            np.empty(1024, np.uint64),
            np.full(4096, -1, np.int32),
        )
        self._rays = np.zeros(1024, np.int64)
        self._sum_w = np.zeros(1024)
        self._sum_w2 = np.zeros(1024)
        self._sum_wy2: NDArray[np.float64] | None = np.zeros(1024)
        self._sum_wc: list[NDArray[np.float64]] = []

    def add(self, paths: PathDictionary) -> NDArray[np.int32]:
        """Merge a dictionary; returns the global number of each of its paths."""
        self._make_room(paths)
        places = np.empty(paths.n_paths, np.uint32)
        found = np.zeros(3, np.int64)
        number_rays(
            RayColumns(
                _plain(paths.source, np.int16),
                _plain(np.diff(paths.offsets), np.int32),
                _plain(paths.object, np.int16),
                _plain(paths.face, np.int32),
                _plain(paths.event, np.int32),
                _plain(paths.medium, np.int16),
                _plain(np.diff(paths.detector_offsets), np.uint16),
                _plain(paths.detector, np.int16),
                _plain(paths.registered, np.bool_).view(np.uint8),
            ),
            _NO_FACES,
            self._paths,
            self.n_paths,
            len(self._rays),
            _SPREAD,
            places,
            np.empty(0, np.int32),
            found,
        )
        self.n_paths = int(found[0])
        numbers = places.astype(np.int32)
        # Local paths differ from each other, so that no number occurs twice
        self._rays[numbers] += paths.rays
        self._sum_w[numbers] += paths.sum_w
        self._sum_w2[numbers] += paths.sum_w2
        if paths.sum_wy2 is None and paths.n_paths:
            # A sum over some of the rays would be of no use
            self._sum_wy2 = None
        elif self._sum_wy2 is not None and paths.sum_wy2 is not None:
            self._sum_wy2[numbers] += paths.sum_wy2
        for channel_set, sums in enumerate(paths.sum_wc):
            if sums.shape[1]:
                self._colors(channel_set, sums.shape[1])[numbers] += sums
        self.grouped |= paths.grouped
        return numbers

    def dictionary(self) -> PathDictionary:
        """The merged dictionary as it stands."""
        n = self.n_paths
        return _unpacked(self._paths, np.arange(n)).with_sums(
            self._rays[:n].copy(),
            self._sum_w[:n].copy(),
            self._sum_w2[:n].copy(),
            tuple(sums[:n].copy() for sums in self._sum_wc),
            self._sum_wy2[:n].copy() if n and self._sum_wy2 is not None else None,
            grouped=self.grouped,
        )

    def _colors(self, channel_set: int, n_channels: int) -> NDArray[np.float64]:
        capacity = len(self._rays)
        while len(self._sum_wc) <= channel_set:
            self._sum_wc.append(np.zeros((capacity, 0)))
        if self._sum_wc[channel_set].shape[1] == 0:
            self._sum_wc[channel_set] = np.zeros((capacity, n_channels))
        return self._sum_wc[channel_set]

    def _make_room(self, paths: PathDictionary) -> None:
        words, starts, hashes, table = self._paths
        n = self.n_paths + paths.n_paths
        needed = int(starts[self.n_paths])
        needed += words_needed(paths.n_paths, paths.n_points, paths.n_crossings)
        if n > len(self._rays):
            size = max(n, 2 * len(self._rays))
            starts, hashes = _grown(starts, size + 1), _grown(hashes, size)
            self._rays = _grown(self._rays, size)
            self._sum_w = _grown(self._sum_w, size)
            self._sum_w2 = _grown(self._sum_w2, size)
            if self._sum_wy2 is not None:
                self._sum_wy2 = _grown(self._sum_wy2, size)
            self._sum_wc = [_grown(sums, size) for sums in self._sum_wc]
        if needed > len(words):
            words = _grown(words, max(needed, 2 * len(words)))
        if 2 * n > len(table):
            table = np.full(1 << (4 * n).bit_length(), -1, np.int32)
            enter_hashes(table, hashes[: self.n_paths])
        self._paths = PathWords(words, starts, hashes, table)


def _plain(column: NDArray[Any], dtype: Any) -> NDArray[Any]:
    """The column as compiled code has it: of one type, contiguous, and writeable by its kind."""
    return np.require(column, dtype, ["C", "W"])


def _grown(array: NDArray[Any], size: int) -> NDArray[Any]:
    out = np.zeros((size, *array.shape[1:]), array.dtype)
    out[: len(array)] = array
    return out
