"""A portion as it lies in the file: header, streams, path dictionary, and what the paths imply."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.bytes.layout import PORTION, ChunkHeader, StreamEntry
from raymap.bytes.streams import decode_column
from raymap.encoding.paths import PathDictionary
from raymap.encoding.pathstreams import (
    CheckedPaths,
    check_amounts,
    check_itineraries,
    offsets_from_counts,
)
from raymap.encoding.portionmeta import PortionMeta
from raymap.file.agreement import FALSE_RAYS, unlike_merged
from raymap.file.footer import IndexEntry
from raymap.file.plainpaths import PlainPaths
from raymap.model.errors import DamagedPortion, FormatError
from raymap.model.schema import COLOR_SCALE, NONE

if TYPE_CHECKING:
    from raymap.encoding.itineraries import PathRuns
    from raymap.file.owner import Owner, ReadPortion

__all__ = ["POINT_TYPES", "PortionStreams"]

POINT_TYPES: dict[str, Any] = {
    "object": np.int16,
    "face": np.int32,
    "event": np.int32,
    "medium": np.int16,
}
"""Columns that the paths imply."""


class PortionStreams:
    """What `StoredPortion` reads without looking at positions, colours or weights."""

    def __init__(self, map: Owner, index: IndexEntry) -> None:
        self._map = self.map = map
        self._index = self.index = index
        meta = index.meta
        self.number = meta.number
        self.first_ray = meta.first_ray
        self.last_ray = meta.last_ray
        self.n_rays = meta.n_rays
        self.emitted = meta.emitted
        self.channel_set = meta.channel_set
        self.has_paths = meta.has_paths
        self.has_weights = meta.has_weights
        self.grouped = meta.grouped
        self.stored_bytes = index.size
        self.offset = index.offset
        self.false_rays = False
        self._compared = False
        self._rows_fit = False

    def __repr__(self) -> str:
        return f"StoredPortion(number={self.number}, n_rays={self.n_rays})"

    @property
    def n_records(self) -> int:
        """Segment records of all rays."""
        return self._index.meta.n_records

    @property
    def n_descriptors(self) -> int:
        """Crossings of detectors of all rays."""
        return self._index.meta.n_descriptors

    @decodes
    def paths(self) -> PathDictionary:
        """The dictionary; of a plain portion a view with one path per ray, decoded when touched."""
        if self.has_paths:
            return self._dictionary
        return PlainPaths(cast("ReadPortion", self))

    @decodes
    def path_numbers(self) -> NDArray[np.uint32]:
        """(n_rays,) row of `paths` that each ray took."""
        if not self.has_paths:
            return np.arange(self.n_rays, dtype=np.uint32)
        numbers = self._stream("path_number", self.n_rays, np.uint32)
        if self.n_rays and int(numbers.max()) >= self._index.meta.n_paths:
            raise self._damaged("a ray's path is not in the dictionary")
        return numbers

    @decodes
    def record_offsets(self) -> NDArray[np.int64]:
        """(n_rays + 1,) records of ray i are offsets[i]:offsets[i + 1]."""
        return self._record_offsets(self.path_numbers() if self.has_paths else None)

    def _record_offsets(self, numbers: NDArray[np.uint32] | None) -> NDArray[np.int64]:
        """Record offsets of rays whose path numbers are there already."""
        if numbers is not None:
            return self._runs(self._itineraries.offsets, numbers).offsets
        counts = self._stream("path.length", self.n_rays, np.uint32)
        if self.n_rays and not counts.all():
            raise self._damaged("a ray has no records")
        with self._damage():
            return offsets_from_counts(counts, self.n_records, "records of rays")

    def _runs(self, offsets: NDArray[np.int64], numbers: NDArray[np.uint32]) -> PathRuns:
        """The rays with the records that the points of their paths are.

        Parameters
        ----------
        offsets : points of each path; numbers : (n_rays,) path of each ray
        """
        from raymap.encoding.itineraries import PathRuns

        with self._damage():
            return PathRuns.check(offsets, numbers, self.n_records, "records of rays")

    def stream_table(self) -> tuple[StreamEntry, ...]:
        """The streams as they lie in the chunk."""
        return self._header.streams

    def chunk_bytes(self) -> bytes:
        """The chunk as it lies in the file."""
        return self._map.file.read(self._index.offset, self._index.size)

    def fetch(self, entry: StreamEntry) -> bytes:
        """The stored bytes of one stream."""
        return self._map.file.read(self._index.offset + entry.offset, entry.stored_size)

    @cached_property
    def _header(self) -> ChunkHeader:
        file = self._map.file
        with self._damage():
            index = self._index
            chunk = file.chunk_at(index.offset, index.offset + index.size, index.head_size)
            if chunk.tag != PORTION or chunk.header.size != self._index.size:
                raise FormatError("another chunk lies in its place")
            meta = PortionMeta.parse(chunk.header.meta, len(self.emitted))
            if meta.pack() != self._index.meta.pack():
                raise FormatError("its header contradicts the footer")
        return chunk.header

    @cached_property
    def _streams(self) -> dict[str, list[StreamEntry]]:
        table: dict[str, list[StreamEntry]] = {}
        for entry in self._header.streams:
            table.setdefault(entry.name, []).append(entry)
        return table

    def _stream(
        self, name: str, rows: int | None, dtype: Any, *, matrix: bool = False
    ) -> NDArray[Any]:
        wanted = np.dtype(dtype)
        with self._damage():
            if name not in self._streams and not rows:
                # A column of no rows has no streams; how many it must have is checked by who asks
                return np.empty(0, wanted)
            if name not in self._streams:
                raise FormatError(f"stream {name!r} is missing")
            column = decode_column(self._streams[name], self.fetch, rows)
            if column.ndim > 1 and not matrix:
                raise FormatError(f"stream {name!r} has {column.shape[1]} elements per row")
            if column.dtype == wanted:
                return column
            if column.dtype.kind in "iu" and wanted.kind in "iu":
                return column.astype(wanted)
            raise FormatError(f"stream {name!r} holds {column.dtype}, expected {wanted}")

    @contextmanager
    def _damage(self) -> Iterator[None]:
        """What does not fit in here is damage of the portion."""
        try:
            yield
        except DamagedPortion:
            raise
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def _damaged(self, reason: str) -> DamagedPortion:
        return self._map.report_damage(self._index, reason)

    @cached_property
    def _itineraries(self) -> CheckedPaths:
        """The paths alone, checked against the directory and the header."""
        meta = self._index.meta
        with self._damage():
            columns = check_itineraries(
                lambda name, rows, dtype: self._stream(f"path.{name}", rows, dtype),
                meta.n_paths,
                self._map.bounds,
            )
            if columns.n_points != meta.n_points or columns.n_crossings != meta.n_crossings:
                raise FormatError("path dictionary has another size than the header says")
        return columns

    @cached_property
    def _dictionary(self) -> PathDictionary:
        meta = self._index.meta
        columns = self._itineraries
        rays = self._counted_rays()
        weighted = "path.sum_w" in self._streams
        n = meta.n_paths
        sum_w2 = self._amounts("path.sum_w2", n) if weighted else rays.astype(float)
        return PathDictionary(
            **columns._asdict(),
            rays=rays,
            sum_w=self._amounts("path.sum_w", n) if weighted else rays.astype(float),
            sum_w2=sum_w2,
            sum_wc=self._color_sums(n),
            sum_wy2=self._worth_squares(n, sum_w2),
            grouped=self.grouped,
        )

    def _counted_rays(self) -> NDArray[np.int64]:
        """Rays of each path, counted; what the dictionary states of them is compared only."""
        n_paths = self._index.meta.n_paths
        stated = self._stream("path.rays", n_paths, np.int64)
        counted = np.bincount(self.path_numbers(), minlength=n_paths)
        if n_paths and not counted.all():
            raise self._damaged("a path that no ray takes")
        self.false_rays = not np.array_equal(stated, counted)
        if self.false_rays:
            error = self._damaged(FALSE_RAYS)
            if self._map.on_damage == "raise":
                raise error
        return counted

    @decodes
    def check_rows(self, numbers: NDArray[np.uint32]) -> None:
        """Make sure that the paths of the rays account for every record and crossing, once.

        Parameters
        ----------
        numbers : (n_rays,) path of each ray

        Raises
        ------
        DamagedPortion
            They do not, so that no ray can be found among the records.
        """
        if self._rows_fit or not self.has_paths:
            return
        paths = self._itineraries
        rays = np.bincount(numbers, minlength=len(paths.source))
        for starts, n, what in (
            (paths.offsets, self.n_records, "records"),
            (paths.detector_offsets[paths.offsets], self.n_descriptors, "descriptors"),
        ):
            total = int(rays @ np.diff(starts))
            if total != n:
                raise self._damaged(f"{what} of rays add up to {total}, not {n}")
        self._rows_fit = True

    def compare(self, merged: PathDictionary, local: NDArray[np.int32]) -> None:
        """Make sure that the paths are those which the footer says they are, once.

        Parameters
        ----------
        merged : the paths of the whole map
        local : (n_paths,) row of each path of this portion in it

        Raises
        ------
        FalseFooter
            They are not; the map serves no merged dictionary from here on.
        """
        if self._compared:
            return
        unlike = unlike_merged(merged, local, self._itineraries)
        if unlike:
            raise self._map.drop_merged(f"{unlike} contradict portion {self.number}")
        self._compared = True

    def _color_sums(self, n_paths: int) -> tuple[NDArray[np.float64], ...]:
        sums = [np.zeros((n_paths, 0)) for _ in self._map.channel_sets]
        if self.has_weights:
            own = self._stream("path.sum_wc", n_paths, np.float64, matrix=True)
        else:
            own = self._stream("path.sum_c", n_paths, np.uint64, matrix=True) / COLOR_SCALE
        own = own.reshape(n_paths, -1)
        with self._damage():
            check_amounts("sums of colour", own)
        if own.shape[1] != self._map.channel_sets[self.channel_set].n_channels:
            raise self._damaged("colours of the paths have another number of channels")
        sums[self.channel_set] = own
        return tuple(sums)

    def _worth_squares(
        self, n_paths: int, sum_w2: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        light = self._map.photometry(self.channel_set)
        if not light.changes:
            return sum_w2 if light.unit == "lm" else None
        if "path.sum_wy2" not in self._streams:
            return None
        return self._amounts("path.sum_wy2", n_paths)

    def _points(self, name: str) -> NDArray[Any]:
        """A column that the path dictionary implies."""
        if not self.has_paths:
            return self._plain_points(name)
        return self._expand(getattr(self._itineraries, name))

    def _plain_points(self, name: str) -> NDArray[Any]:
        column = self._stream(f"path.{name}", self.n_records, POINT_TYPES[name])
        if name != "event":
            self._check_bounds(name, column)
        if name == "face":
            objects = self._plain_points("object")
            with self._damage():
                self._map.bounds.check_faces(objects, column)
        return column

    def _expand(self, column: NDArray[Any]) -> NDArray[Any]:
        return self._runs(self._itineraries.offsets, self.path_numbers()).expand(column)

    def _check_bounds(self, name: str, column: NDArray[Any]) -> NDArray[Any]:
        with self._damage():
            return self._map.bounds.check(name, column)

    def _column_source(self) -> NDArray[np.int16]:
        if self.has_paths:
            return self._itineraries.source[self.path_numbers()]
        return self._check_bounds("source", self._stream("path.source", self.n_rays, np.int16))

    def _column_weight(self) -> NDArray[np.float32]:
        if not self.has_weights:
            return np.ones(self.n_rays, np.float32)
        return self._amounts("weight", self.n_rays, np.float32)

    def _amounts(self, name: str, rows: int, dtype: Any = np.float64) -> NDArray[Any]:
        """A column of weights or of their sums."""
        column = self._stream(name, rows, dtype)
        with self._damage():
            return check_amounts(f"values of {name!r}", column)

    def _column_descriptor_count(self) -> NDArray[np.uint16]:
        if self.has_paths:
            counts = self._expand(np.diff(self._itineraries.detector_offsets).astype(np.uint16))
        else:
            counts = self._stream("path.meetings", self.n_records, np.uint16)
        total = int(counts.sum(dtype=np.int64))
        if total != self.n_descriptors:
            raise self._damaged(
                f"descriptors of records add up to {total}, not {self.n_descriptors}"
            )
        return counts

    def _column_first_descriptor(self) -> NDArray[np.int32]:
        counts = self._column_descriptor_count()
        offsets = self._crossing_offsets(counts)
        return np.where(counts > 0, offsets[:-1], NONE).astype(np.int32)

    def _crossing_offsets(self, counts: NDArray[np.uint16]) -> NDArray[np.int64]:
        with self._damage():
            return offsets_from_counts(counts, self.n_descriptors, "descriptors of records")

    def _crossed(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        n = self.n_descriptors
        if not self.has_paths:
            detector = self._stream("path.detector", n, np.int16)
            registered = self._stream("path.registered", n, np.bool_)
            return self._check_bounds("detector", detector), registered
        paths = self._itineraries
        starts = paths.detector_offsets[paths.offsets]
        from raymap.encoding.itineraries import PathRuns

        with self._damage():
            runs = PathRuns.check(starts, self.path_numbers(), n, "descriptors of rays")
        return runs.expand(paths.detector), runs.expand(paths.registered)
