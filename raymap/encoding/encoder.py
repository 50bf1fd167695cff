"""A portion to its chunk: the choice of encodings and the streams that they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.layout import PORTION
from raymap.bytes.streams import Scope, StreamSet
from raymap.encoding.colors import ColorCodes, runs_of_codes
from raymap.encoding.dictionary import (
    FoundPaths,
    Itineraries,
    find_paths,
    itineraries_of,
)
from raymap.encoding.geometrystreams import PathsTaken, add_geometry
from raymap.encoding.paths import PathDictionary
from raymap.encoding.pathwords import face_columns
from raymap.encoding.portionmeta import DESCRIPTOR_STREAMS, PortionMeta
from raymap.encoding.shapes import compile_shapes
from raymap.jit.scratch import BufferPool
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import FormatError, LimitExceeded
from raymap.model.portion import Portion
from raymap.model.rows import offsets_of, squares_by_emission
from raymap.model.schema import COLOR_SCALE
from raymap.optics.photometry import Photometry

__all__ = ["EncodedPortion", "PortionEncoder"]


@dataclass(frozen=True, kw_only=True, eq=False)
class EncodedPortion:
    """A portion as bytes, ready to be committed.

    Attributes
    ----------
    meta : what the chunk header says
    buffers : header and streams, to be written one after the other
    size : bytes of the chunk
    head_size : those of its header, meta block and stream table
    paths : the portion's dictionary for merging, None where it has plain columns
    lent : what some of the buffers are part of, and where it goes back
    """

    meta: PortionMeta
    buffers: list[bytes | NDArray[np.uint8]]
    size: int
    head_size: int
    paths: PathDictionary | None
    lent: tuple[NDArray[np.uint8], BufferPool] | None = field(default=None, repr=False)

    @property
    def number(self) -> int:
        return self.meta.number

    def release(self) -> None:
        """Give the memory back once the buffers are written; they are gone then."""
        self.buffers.clear()
        if self.lent is not None:
            self.lent[1].give(self.lent[0])


class PortionEncoder:
    """Encodes portions of one directory; pure and safe to use from many threads.

    Parameters
    ----------
    raw : store every stream as it is
    """

    def __init__(self, directory: Directory, *, raw: bool = False) -> None:
        self.directory = directory
        self.raw = raw
        self.shapes = compile_shapes(directory)
        self._faces = face_columns(directory.faces)
        self._pool = BufferPool()

    def encode(
        self, portion: Portion, number: int, channel_sets: Sequence[ChannelSet]
    ) -> EncodedPortion:
        """Encode one portion of a map with these channel sets."""
        offsets = offsets_of(portion.records_per_ray)
        streams = StreamSet(raw=self.raw)
        found = None if self.raw or not portion.n_rays else find_paths(portion, self._faces)
        paths = None
        if found is None:
            table, explicit = itineraries_of(portion, self._faces, offsets)
            path_numbers = np.arange(portion.n_rays, dtype=np.uint32)
            n_paths, n_points = portion.n_rays, portion.n_records
            n_crossings = len(table.detector)
            add_itineraries(streams, table)
        else:
            table, path_numbers, explicit = found.table, found.numbers, found.explicit
            paths = self._with_sums(found, portion, offsets, channel_sets)
            n_paths, n_points, n_crossings = paths.n_paths, paths.n_points, paths.n_crossings
            add_itineraries(streams, table)
            _add_sums(streams, paths, portion)
            small = np.uint16 if n_paths <= 2**16 else np.uint32
            streams.add("path_number", path_numbers.astype(small), Scope.RAY)
        if len(explicit):
            streams.add("triangle", explicit)
        rays = PathsTaken(portion, offsets, table, path_numbers)
        encodings, lent = self._add_geometry(streams, rays)
        encodings |= self._add_descriptors(streams, portion)
        _add_colors(streams, portion, offsets, self.raw)
        _add_rays(streams, portion)
        ids = portion.ray_ids if portion.n_rays else None
        first = portion.first_ray if ids is None else int(ids[0])
        meta = PortionMeta(
            number=number,
            first_ray=first,
            last_ray=first + portion.n_rays - 1 if ids is None else int(ids[-1]),
            n_rays=portion.n_rays,
            n_records=portion.n_records,
            n_descriptors=len(portion.descriptors.detector),
            n_paths=n_paths,
            n_points=n_points,
            n_crossings=n_crossings,
            channel_set=portion.channel_set,
            has_paths=paths is not None,
            has_ids=ids is not None,
            has_weights=portion.weight is not None,
            grouped=portion.emission is not None,
            encodings=encodings,
            emitted=portion.emitted.copy(),
        )
        try:
            meta.check()
        except FormatError as error:
            raise LimitExceeded(str(error)) from None
        buffers = streams.chunk(PORTION, meta.pack(), meta.least_size)
        return EncodedPortion(
            meta=meta,
            buffers=buffers,
            size=len(buffers[0]) + streams.stored_bytes,
            head_size=len(buffers[0]),
            paths=paths,
            lent=None if lent is None else (lent, self._pool),
        )

    def _add_geometry(
        self, streams: StreamSet, rays: PathsTaken
    ) -> tuple[int, NDArray[np.uint8] | None]:
        """Store positions and normals; the encodings chosen, and room to be given back."""
        lent = None if self.raw else self._pool.take(12 * rays.portion.n_records)
        return add_geometry(streams, rays, self.shapes, lent), lent

    def _add_descriptors(self, streams: StreamSet, portion: Portion) -> int:
        """Store the crossings beyond what the paths say; the encodings chosen: none."""
        d = portion.descriptors
        if len(d.detector):
            columns = (d.cell[:, 0], d.cell[:, 1], d.cosine, d.uv[:, 0], d.uv[:, 1])
            for name, column in zip(DESCRIPTOR_STREAMS, columns, strict=True):
                streams.add(name, column, Scope.DESCRIPTOR)
        return 0

    def _with_sums(
        self,
        found: FoundPaths,
        portion: Portion,
        offsets: NDArray[np.int64],
        channel_sets: Sequence[ChannelSet],
    ) -> PathDictionary:
        """The paths with how much light took them."""
        path_numbers, rays = found.numbers, found.rays
        n_paths = len(rays)
        weight: NDArray[np.float64] | float = 1.0
        if portion.weight is None and portion.emission is None:
            sum_w, sum_w2 = rays.astype(np.float64), rays.astype(np.float64)
        else:
            weight = (
                np.ones(portion.n_rays)
                if portion.weight is None
                else portion.weight.astype(np.float64)
            )
            sum_w = np.bincount(path_numbers, weight, n_paths).astype(np.float64)
            sum_w2 = squares_by_emission(path_numbers, weight, portion.emission, n_paths)
        ends = portion.color_code[offsets[1:] - 1]
        codes = ColorCodes.check(ends, portion.color_table)
        sums = codes.summed(path_numbers, portion.weight, n_paths)
        colors = (sums / COLOR_SCALE if sums.dtype == np.uint64 else sums).astype(np.float64)
        sets = [
            np.zeros((n_paths, 0)) for _ in range(max(len(channel_sets), portion.channel_set + 1))
        ]
        sets[portion.channel_set] = colors
        sum_wy2 = None
        if self.directory.flux_unit == "lm":
            light = Photometry(self.directory, channel_sets[portion.channel_set])
            sum_wy2 = sum_w2
            if light.changes:
                worth = light.worth_of_rays(portion.source, ends, portion.color_table)
                sum_wy2 = squares_by_emission(
                    path_numbers, weight * worth, portion.emission, n_paths
                )
        return found.table.with_sums(
            rays, sum_w, sum_w2, tuple(sets), sum_wy2, grouped=portion.emission is not None
        )


def add_itineraries(streams: StreamSet, rays: Itineraries) -> None:
    """Store the columns of which paths are made."""
    streams.add("path.source", rays.source, Scope.PATH)
    streams.add("path.length", _compact(np.diff(rays.offsets)), Scope.PATH)
    streams.add("path.object", _narrow(rays.object), Scope.POINT)
    streams.add("path.face", _narrow(rays.face), Scope.POINT)
    streams.add("path.event", rays.event, Scope.POINT)
    streams.add("path.medium", _narrow(rays.medium), Scope.POINT)
    streams.add("path.meetings", rays.crossings, Scope.POINT)
    streams.add("path.detector", rays.detector, Scope.CROSSING)
    streams.add("path.registered", rays.registered, Scope.CROSSING)


def _narrow(numbers: NDArray[Any]) -> NDArray[Any]:
    """As bytes where these hold the numbers: high bytes of -1 would be planes of their own."""
    if len(numbers) and int(numbers.min()) >= -(2**7) and int(numbers.max()) < 2**7:
        return numbers.astype(np.int8)
    return numbers


def _compact(counts: NDArray[Any]) -> NDArray[Any]:
    """The narrowest unsigned type that holds the values."""
    top = int(counts.max()) if len(counts) else 0
    return counts.astype(np.uint8 if top < 2**8 else np.uint16 if top < 2**16 else np.uint32)


def _add_sums(streams: StreamSet, paths: PathDictionary, portion: Portion) -> None:
    streams.add("path.rays", paths.rays.astype(np.uint32), Scope.PATH)
    colors = paths.sum_wc[portion.channel_set]
    if portion.weight is None:
        exact = np.rint(colors * COLOR_SCALE).astype(np.uint64)
        streams.add("path.sum_c", exact, Scope.PATH)
    else:
        streams.add("path.sum_wc", colors, Scope.PATH)
    if portion.weight is not None or portion.emission is not None:
        streams.add("path.sum_w", paths.sum_w, Scope.PATH)
        streams.add("path.sum_w2", paths.sum_w2, Scope.PATH)
    # Where worth does not change with colour, the squares are those of the weights themselves
    if paths.sum_wy2 is not None and paths.sum_wy2 is not paths.sum_w2:
        streams.add("path.sum_wy2", paths.sum_wy2, Scope.PATH)


def _add_colors(
    streams: StreamSet, portion: Portion, offsets: NDArray[np.int64], raw: bool
) -> None:
    runs = None if raw else runs_of_codes(offsets, portion.color_code)
    if runs is None:
        streams.add("color.code", portion.color_code, Scope.RECORD)
    else:
        first, changes, lengths, later = runs
        streams.add("color.first", _compact(first), Scope.RAY)
        streams.add("color.changes", _compact(changes), Scope.RAY)
        streams.add("color.length", _compact(lengths))
        streams.add("color.later", _compact(later))
    # Leave out the last channel, which follows from the others
    table = portion.color_table
    if len(table):
        streams.add("color.table", table[:, :-1] if table.shape[1] > 1 else table)


def _add_rays(streams: StreamSet, portion: Portion) -> None:
    if portion.ray_ids is not None and portion.n_rays:
        gaps = np.diff(portion.ray_ids, prepend=portion.ray_ids[:1])
        streams.add("ray_gap", gaps.astype(np.uint64), Scope.RAY)
    if portion.weight is not None:
        streams.add("weight", portion.weight, Scope.RAY)
    if portion.emission is not None:
        streams.add("emission", portion.emission, Scope.RAY)
    for name, column in portion.extra.items():
        scope = Scope.RECORD if len(column) == portion.n_records else Scope.RAY
        streams.add(f"x:{name}", column, scope)
