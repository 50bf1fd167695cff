"""Find the different paths of a portion, number its rays, and merge portions' dictionaries."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.directory import FaceTable
from raymap.errors import InvalidPortion
from raymap.itineraries import (
    Itineraries,
    assign_faces,
    fill_table,
    gather_meetings,
    gather_points,
    group_rays,
    hash_rays,
    merge_paths,
    sum_colors,
    sum_weighted_colors,
)
from raymap.paths import PathDictionary
from raymap.portion import Portion
from raymap.schema import COLOR_SCALE
from raymap.scratch import scratch

__all__ = ["PathMerger", "color_sums", "find_paths", "itineraries_of", "offsets_of"]

MAX_SHARE = 0.5
"""A dictionary with more different paths than this share of the rays is not worth keeping."""


def hashes_of(rays: Itineraries) -> NDArray[np.uint64]:
    """(n,) hash of each itinerary."""
    hashes = np.empty(rays.source.size, np.uint64)
    hash_rays(rays, hashes)
    return hashes


def take(rays: Itineraries, wanted: NDArray[np.int32]) -> Itineraries:
    """The itineraries of the wanted rays, one after the other."""
    offsets = offsets_of(np.diff(rays.offsets)[wanted])
    n_points = int(offsets[-1])

    def gathered(column: NDArray[Any]) -> NDArray[Any]:
        out = np.empty(n_points, column.dtype)
        gather_points(wanted, rays.offsets, offsets, column, out)
        return out

    meeting_offsets = offsets_of(gathered(np.diff(rays.meeting_offsets)))
    detector = np.empty(int(meeting_offsets[-1]), np.int16)
    registered = np.empty(int(meeting_offsets[-1]), np.bool_)
    gather_meetings(
        wanted,
        rays.offsets,
        rays.meeting_offsets,
        meeting_offsets,
        offsets,
        rays.detector,
        rays.registered,
        detector,
        registered,
    )
    return Itineraries(
        rays.source[wanted],
        offsets,
        gathered(rays.object),
        gathered(rays.face),
        gathered(rays.event),
        gathered(rays.medium),
        meeting_offsets,
        detector,
        registered,
    )


def offsets_of(counts: NDArray[Any]) -> NDArray[np.int64]:
    """Running sum with a leading zero."""
    offsets = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    return offsets


def itineraries_of(portion: Portion, faces: FaceTable) -> Itineraries:
    """The itineraries of a portion's rays.

    Raises
    ------
    InvalidPortion
        A record names an object or a primitive that the directory does not have.
    """
    face = scratch("faces", portion.n_records, np.int32)
    bad = assign_faces(
        portion.object,
        portion.triangle,
        faces.first_face,
        faces.first_primitive,
        faces.primitive_count,
        face,
    )
    if bad >= 0:
        raise InvalidPortion(
            f"record {bad} names object {portion.object[bad]}, primitive {portion.triangle[bad]}, "
            "which the directory does not have"
        )
    return Itineraries(
        portion.source,
        offsets_of(portion.records_per_ray),
        portion.object,
        face,
        portion.event,
        portion.medium,
        offsets_of(portion.descriptor_count),
        portion.descriptors.detector,
        portion.descriptors.registered,
    )


def find_paths(rays: Itineraries) -> tuple[Itineraries, NDArray[np.uint32]] | None:
    """The different paths by descending number of rays, and each ray's path.

    Returns
    -------
    (paths, path_numbers), or None where paths repeat too little
    """
    n_rays = rays.source.size
    limit = max(1, int(n_rays * MAX_SHARE))
    table = np.full(1 << (2 * limit + 1).bit_length(), -1, np.int32)
    group = np.empty(n_rays, np.int32)
    representative = np.empty(limit, np.int32)
    counts = np.empty(limit, np.int64)
    found = group_rays(rays, hashes_of(rays), table, group, representative, counts)
    if found < 0:
        return None
    order = np.argsort(-counts[:found], kind="stable")
    rank = np.empty(found, np.uint32)
    rank[order] = np.arange(found, dtype=np.uint32)
    return take(rays, representative[:found][order]), rank[group]


class PathMerger:
    """The growing dictionary of a whole map; paths are numbered in order of first appearance."""

    def __init__(self) -> None:
        self.n_paths = 0
        self.grouped = False
        self._offsets = np.zeros(1025, np.int64)
        self._meeting_offsets = np.zeros(8193, np.int64)
        self._paths: dict[str, NDArray[Any]] = {
            "source": np.empty(1024, np.int16),
            "hash": np.empty(1024, np.uint64),
        }
        self._points: dict[str, NDArray[Any]] = {
            "object": np.empty(8192, np.int16),
            "face": np.empty(8192, np.int32),
            "event": np.empty(8192, np.int32),
            "medium": np.empty(8192, np.int16),
        }
        self._meetings: dict[str, NDArray[Any]] = {
            "detector": np.empty(1024, np.int16),
            "registered": np.empty(1024, np.bool_),
        }
        self._table = np.full(4096, -1, np.int32)
        self._rays = np.zeros(1024, np.int64)
        self._sum_w = np.zeros(1024)
        self._sum_w2 = np.zeros(1024)
        self._sum_wc: list[NDArray[np.float64]] = []

    def add(self, paths: PathDictionary) -> NDArray[np.int32]:
        """Merge a dictionary; returns the global number of each of its paths."""
        self._make_room(paths)
        local = Itineraries(
            paths.source,
            paths.offsets,
            paths.object,
            paths.face,
            paths.event,
            paths.medium,
            paths.detector_offsets,
            paths.detector,
            paths.registered,
        )
        merged = Itineraries(
            self._paths["source"],
            self._offsets,
            self._points["object"],
            self._points["face"],
            self._points["event"],
            self._points["medium"],
            self._meeting_offsets,
            self._meetings["detector"],
            self._meetings["registered"],
        )
        numbers = np.empty(paths.n_paths, np.int32)
        self.n_paths = merge_paths(
            local,
            hashes_of(local),
            merged,
            self._paths["hash"],
            self._table,
            self.n_paths,
            numbers,
        )
        # Local paths differ from each other, so that no number occurs twice
        self._rays[numbers] += paths.rays
        self._sum_w[numbers] += paths.sum_w
        self._sum_w2[numbers] += paths.sum_w2
        for channel_set, sums in enumerate(paths.sum_wc):
            if sums.shape[1]:
                self._colors(channel_set, sums.shape[1])[numbers] += sums
        self.grouped |= paths.grouped
        return numbers

    def dictionary(self) -> PathDictionary:
        """The merged dictionary as it stands."""
        n = self.n_paths
        points = int(self._offsets[n])
        meetings = int(self._meeting_offsets[points])
        return PathDictionary(
            source=self._paths["source"][:n].copy(),
            offsets=self._offsets[: n + 1].copy(),
            **{name: column[:points].copy() for name, column in self._points.items()},
            detector_offsets=self._meeting_offsets[: points + 1].copy(),
            **{name: column[:meetings].copy() for name, column in self._meetings.items()},
            rays=self._rays[:n].copy(),
            sum_w=self._sum_w[:n].copy(),
            sum_w2=self._sum_w2[:n].copy(),
            sum_wc=tuple(sums[:n].copy() for sums in self._sum_wc),
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
        n = self.n_paths + paths.n_paths
        points = int(self._offsets[self.n_paths]) + paths.n_points
        meetings = int(self._meeting_offsets[self._offsets[self.n_paths]]) + paths.n_meetings
        if n > len(self._rays):
            size = max(n, 2 * len(self._rays))
            self._offsets = _grown(self._offsets, size + 1)
            self._paths = {name: _grown(column, size) for name, column in self._paths.items()}
            self._rays = _grown(self._rays, size)
            self._sum_w = _grown(self._sum_w, size)
            self._sum_w2 = _grown(self._sum_w2, size)
            self._sum_wc = [_grown(sums, size) for sums in self._sum_wc]
        if points > len(self._points["object"]):
            size = max(points, 2 * len(self._points["object"]))
            self._meeting_offsets = _grown(self._meeting_offsets, size + 1)
            self._points = {name: _grown(column, size) for name, column in self._points.items()}
        if meetings > len(self._meetings["detector"]):
            size = max(meetings, 2 * len(self._meetings["detector"]))
            self._meetings = {name: _grown(column, size) for name, column in self._meetings.items()}
        if 2 * n > len(self._table):
            self._table = np.full(1 << (4 * n).bit_length(), -1, np.int32)
            fill_table(self._table, self._paths["hash"][: self.n_paths])


def _grown(array: NDArray[Any], size: int) -> NDArray[Any]:
    out = np.zeros((size, *array.shape[1:]), array.dtype)
    out[: len(array)] = array
    return out


def color_sums(
    codes: NDArray[np.int32],
    color_table: NDArray[np.uint16],
    numbers: NDArray[np.uint32],
    weight: NDArray[np.float32] | None,
    n_paths: int,
) -> NDArray[np.float64] | NDArray[np.uint64]:
    """Sum of colour (x weight) at the rays' ends per path.

    Parameters
    ----------
    codes : (n_rays,) colour code of each ray's last record

    Returns
    -------
    sums : (n_paths, n_channels), in units of 1 / COLOR_SCALE and uint64 where no ray has a weight
    """
    n_channels = color_table.shape[1]
    if weight is None:
        exact = np.zeros((n_paths, n_channels), np.uint64)
        sum_colors(codes, color_table, numbers, exact)
        return exact
    sums = np.zeros((n_paths, n_channels))
    sum_weighted_colors(codes, color_table, numbers, weight, 1.0 / COLOR_SCALE, sums)
    return sums
