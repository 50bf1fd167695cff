"""A portion to its chunk: the choice of encodings and the streams that they give."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.colors import runs_of_codes
from raymap.dictionary import (
    FoundPaths,
    Itineraries,
    color_sums,
    find_paths,
    itineraries_of,
    offsets_of,
)
from raymap.directory import Directory
from raymap.layout import PORTION, pack_chunk_header
from raymap.meetings import compile_detectors, encode_meetings
from raymap.normals import end_residuals, imply_normals, normal_residuals, other_residuals
from raymap.paths import PathDictionary
from raymap.pathwords import face_columns
from raymap.planes import split_positions
from raymap.portion import Portion
from raymap.portionmeta import DESCRIPTOR_STREAMS, Encoding, PortionMeta
from raymap.positions import gather_coordinates, position_residuals, resolve_codes
from raymap.schema import COLOR_SCALE
from raymap.scratch import BufferPool, scratch
from raymap.shapes import (
    LEFT_SCENE,
    RayPoints,
    RayShapes,
    ShapeTable,
    compile_shapes,
    shape_codes,
)
from raymap.streams import Scope, StreamSet

__all__ = ["EncodedPortion", "PortionEncoder"]

_FEW_MEETINGS = 64


@dataclass(frozen=True, kw_only=True, eq=False)
class EncodedPortion:
    """A portion as bytes, ready to be committed.

    Attributes
    ----------
    meta : what the chunk header says
    buffers : header and streams, to be written one after the other
    size : bytes of the chunk
    paths : the portion's dictionary for merging, None where it has plain columns
    lent : what some of the buffers are part of, and where it goes back
    """

    meta: PortionMeta
    buffers: list[bytes | NDArray[np.uint8]]
    size: int
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


class _Rays(NamedTuple):
    """A portion's rays and the paths that they take."""

    portion: Portion
    offsets: NDArray[np.int64]
    table: Itineraries
    path_numbers: NDArray[np.uint32]


class PortionEncoder:
    """Encodes portions of one directory; pure and safe to use from many threads.

    Parameters
    ----------
    raw : store every stream as it is
    compact : leave out what the shapes imply of positions and of places on detectors, too. Saves
        about 1.7 bytes a record; encoding takes half as long again, reading positions ten times
    """

    def __init__(self, directory: Directory, *, raw: bool = False, compact: bool = False) -> None:
        self.faces = directory.faces
        self.raw = raw
        self.compact = compact
        self.shapes = compile_shapes(directory)
        self.detectors = compile_detectors(directory)
        self._faces = face_columns(directory.faces)
        self._pool = BufferPool()

    def encode(self, portion: Portion, number: int, n_channel_sets: int) -> EncodedPortion:
        """Encode one portion."""
        offsets = offsets_of(portion.records_per_ray)
        streams = StreamSet(raw=self.raw)
        found = None if self.raw or not portion.n_rays else find_paths(portion, self._faces)
        paths = None
        if found is None:
            table, explicit = itineraries_of(portion, self._faces, offsets)
            path_numbers = np.arange(portion.n_rays, dtype=np.uint32)
            n_paths, n_points = portion.n_rays, portion.n_records
            n_meetings = len(table.detector)
            add_itineraries(streams, table)
        else:
            table, path_numbers, explicit = found.table, found.numbers, found.explicit
            paths = _with_sums(found, portion, offsets, n_channel_sets)
            n_paths, n_points, n_meetings = paths.n_paths, paths.n_points, paths.n_meetings
            add_itineraries(streams, table)
            _add_sums(streams, paths, portion)
            small = np.uint16 if n_paths <= 2**16 else np.uint32
            streams.add("path_number", path_numbers.astype(small), Scope.RAY)
        if len(explicit):
            streams.add("triangle", explicit)
        lent = None if self.raw or self.compact else self._pool.take(12 * portion.n_records)
        rays = _Rays(portion, offsets, table, path_numbers)
        encodings = self._add_geometry(streams, rays, lent)
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
            n_meetings=n_meetings,
            channel_set=portion.channel_set,
            has_paths=paths is not None,
            has_ids=ids is not None,
            has_weights=portion.weight is not None,
            grouped=portion.emission is not None,
            encodings=encodings,
            emitted=portion.emitted.copy(),
        )
        header = pack_chunk_header(PORTION, meta.pack(), streams.entries)
        return EncodedPortion(
            meta=meta,
            buffers=[header, *streams.buffers],
            size=len(header) + streams.stored_bytes,
            paths=paths,
            lent=None if lent is None else (lent, self._pool),
        )

    def _add_geometry(self, streams: StreamSet, rays: _Rays, room: NDArray[np.uint8] | None) -> int:
        """Store positions and normals; returns the encodings chosen."""
        portion = rays.portion
        if room is not None:
            planes = room[: 12 * portion.n_records].reshape(12, -1)
            split_positions(portion.position, planes)
            for axis, name in enumerate("xyz"):
                own = planes[4 * axis : 4 * axis + 4]
                streams.add_split(f"position.{name}", portion.position[:, axis], own, Scope.RECORD)
            if portion.implied_normals:
                return _add_unlike_normals(streams, rays, self.shapes)
        if self.raw and not portion.implied_normals:
            return _add_raw_geometry(streams, portion)
        codes = self._shape_codes(rays)
        if portion.implied_normals:
            normal = portion.normal.copy()
            imply_normals(codes, self.shapes.gradient, portion.position, normal)
            portion = replace(portion, normal=normal)
        if self.raw:
            return _add_raw_geometry(streams, portion)
        chosen = _add_positions(streams, portion, codes, self.shapes) if self.compact else 0
        return chosen | _add_normals(streams, portion, rays.offsets, codes, self.shapes)

    def _shape_codes(self, rays: _Rays) -> NDArray[np.int32]:
        """Shape code of each record."""
        table = rays.table
        point_codes = np.empty(table.object.size, np.int32)
        shape_codes(
            table.offsets, table.object, table.face, table.event, self.shapes.face_code, point_codes
        )
        codes = scratch("codes", rays.portion.n_records, np.int32)
        resolve_codes(
            RayShapes(
                rays.path_numbers, table.offsets, rays.offsets, point_codes, rays.portion.triangle
            ),
            self.shapes,
            codes,
        )
        return codes

    def _add_descriptors(self, streams: StreamSet, portion: Portion) -> int:
        """Store the meetings beyond what the paths say; returns the encodings chosen."""
        d = portion.descriptors
        n = len(d.detector)
        if not n:
            return 0
        plain = (d.cell[:, 0], d.cell[:, 1], d.cosine, d.uv[:, 0], d.uv[:, 1])
        if not self.compact:
            for name, column in zip(DESCRIPTOR_STREAMS, plain, strict=True):
                streams.add(name, column, Scope.DESCRIPTOR)
            return 0
        folded = np.empty((5, n), np.uint16)

        def missed(counts: NDArray[np.uint16], reverse: bool) -> int:
            return encode_meetings(
                counts,
                d.detector,
                d.cell,
                d.cosine,
                d.uv,
                portion.position,
                *self.detectors,
                reverse,
                folded,
            )

        # Let the first meetings say against which direction cosines are positive
        so_far = np.cumsum(portion.descriptor_count, dtype=np.int64)
        few = portion.descriptor_count[: np.searchsorted(so_far, _FEW_MEETINGS) + 1]
        reverse = missed(few, True) < missed(few, False)
        if missed(portion.descriptor_count, reverse) > _nonzero(plain):
            for name, column in zip(DESCRIPTOR_STREAMS, plain, strict=True):
                streams.add(name, column, Scope.DESCRIPTOR)
            return 0
        for name, column in zip(DESCRIPTOR_STREAMS, folded, strict=True):
            streams.add(name, column, Scope.DESCRIPTOR)
        return int(Encoding.CROSSINGS | (Encoding.REVERSED if reverse else Encoding(0)))


def _nonzero(columns: Iterable[NDArray[Any]]) -> int:
    return sum(int(np.count_nonzero(column)) for column in columns)


def _add_raw_geometry(streams: StreamSet, portion: Portion) -> int:
    for axis, name in enumerate("xyz"):
        streams.add(f"position.{name}", portion.position[:, axis], Scope.RECORD)
    for axis, name in enumerate("xyz"):
        streams.add(f"normal.{name}", portion.normal[:, axis], Scope.RECORD)
    return 0


def _add_positions(
    streams: StreamSet, portion: Portion, codes: NDArray[np.int32], shapes: ShapeTable
) -> int:
    n = portion.n_records
    position = np.ascontiguousarray(portion.position)
    bits = position.view(np.int32)
    # One more row, into which the pass writes ahead before it knows whether the value counts
    xs, ys, zs = (scratch(f"position.{axis}", n + 1, np.int32) for axis in "xyz")
    solved = scratch("solved", n + 1, np.int32)
    residual = scratch("residual", n, np.uint32)
    roots = np.empty(n, np.uint8)
    faces, sphere = True, True
    while True:
        nx, ny, nz, k = gather_coordinates(
            codes, shapes.axis, faces, sphere, bits, xs, ys, zs, solved
        )
        records = solved[:k]
        position_residuals(
            records, codes, shapes.solve, shapes.axis, position, bits, residual, roots
        )
        # Give up a kind of shape that saves less than a byte per coordinate
        bad_faces, bad_sphere = _far_off(codes, records, residual)
        if not bad_faces and not bad_sphere:
            break
        faces, sphere = faces and not bad_faces, sphere and not bad_sphere
    for name, values in (("x", xs[:nx]), ("y", ys[:ny]), ("z", zs[:nz])):
        streams.add(f"position.{name}", values.view(np.float32))
    if k:
        streams.add("position.residual", residual[:k])
        streams.add("position.root", roots[:k])
    chosen = Encoding(0)
    if k and faces:
        chosen |= Encoding.SOLVED_FACES
    if k and sphere:
        chosen |= Encoding.SOLVED_SPHERE
    return int(chosen)


def _far_off(
    codes: NDArray[np.int32], records: NDArray[np.int32], residual: NDArray[np.uint32]
) -> tuple[bool, bool]:
    """Whether most points are far off their faces, and most ends far off the bounding sphere."""
    far = np.flatnonzero(residual[: len(records)] >= 2**24)
    if len(far) == 0:
        return False, False
    on_sphere = codes[records] < 0
    far_on_sphere = int(on_sphere[far].sum())
    n_sphere = int(on_sphere.sum())
    far_on_faces = len(far) - far_on_sphere
    return 2 * far_on_faces > len(records) - n_sphere, 2 * far_on_sphere > n_sphere


def _add_normals(
    streams: StreamSet,
    portion: Portion,
    offsets: NDArray[np.int64],
    codes: NDArray[np.int32],
    shapes: ShapeTable,
) -> int:
    folded = scratch("normals", 3 * portion.n_records, np.uint16).reshape(3, -1)
    missed, plain = normal_residuals(
        offsets,
        codes,
        portion.triangle,
        portion.source,
        shapes.gradient,
        shapes.first_primitive,
        shapes.face_start,
        np.zeros((len(portion.emitted), 3), np.int16),
        np.zeros((shapes.n_remembered, 3), np.int16),
        portion.position,
        portion.normal,
        folded,
    )
    if missed > plain:
        for axis, name in enumerate("xyz"):
            streams.add(f"normal.{name}", portion.normal[:, axis], Scope.RECORD)
        return 0
    for axis, name in enumerate("xyz"):
        streams.add(f"normal.{name}", folded[axis], Scope.RECORD)
    return int(Encoding.NORMALS)


def _add_unlike_normals(streams: StreamSet, rays: _Rays, shapes: ShapeTable) -> int:
    """Store normals of which those on quadrics are implied."""
    portion = rays.portion
    most = 2 * portion.n_rays if shapes.complete else portion.n_records
    places = scratch("places", most, np.int32)
    folded = scratch("folded", 3 * most, np.uint16).reshape(3, -1)
    emission = np.zeros((len(portion.emitted), 3), np.int16)
    position, normal = portion.position, portion.normal
    if shapes.complete:
        n = end_residuals(
            rays.offsets, rays.path_numbers, *_ends(rays.table), portion.source, emission,
            position, normal, places, folded,
        )  # fmt: skip
    else:
        table = rays.table
        points = RayPoints(
            rays.path_numbers, table.offsets, rays.offsets, table.object, table.face, table.event,
            portion.triangle, portion.source,
        )  # fmt: skip
        remembered = np.zeros((shapes.n_remembered, 3), np.int16)
        n = other_residuals(points, shapes, emission, remembered, position, normal, places, folded)
    for axis, name in enumerate("xyz"):
        streams.add_sparse(
            f"normal.{name}", portion.n_records, places[:n], folded[axis, :n], Scope.RECORD
        )
    return int(Encoding.NORMALS)


def _ends(table: Itineraries) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether each path begins on no face, and whether it ends where the ray has left."""
    first, last = table.offsets[:-1], table.offsets[1:] - 1
    left = (table.object[last] < 0) & ((table.event[last] & LEFT_SCENE) != 0) & (last > first)
    return table.face[first] < 0, left & (table.face[last] < 0)


def add_itineraries(streams: StreamSet, rays: Itineraries) -> None:
    """Store the columns of which paths are made."""
    streams.add("path.source", rays.source, Scope.PATH)
    streams.add("path.length", _compact(np.diff(rays.offsets)), Scope.PATH)
    streams.add("path.object", _narrow(rays.object), Scope.POINT)
    streams.add("path.face", _narrow(rays.face), Scope.POINT)
    streams.add("path.event", rays.event, Scope.POINT)
    streams.add("path.medium", _narrow(rays.medium), Scope.POINT)
    streams.add("path.meetings", rays.meetings, Scope.POINT)
    streams.add("path.detector", rays.detector, Scope.MEETING)
    streams.add("path.registered", rays.registered, Scope.MEETING)


def _narrow(numbers: NDArray[Any]) -> NDArray[Any]:
    """As bytes where these hold the numbers: high bytes of -1 would be planes of their own."""
    if len(numbers) and int(numbers.min()) >= -(2**7) and int(numbers.max()) < 2**7:
        return numbers.astype(np.int8)
    return numbers


def _compact(counts: NDArray[Any]) -> NDArray[Any]:
    """The narrowest unsigned type that holds the values."""
    top = int(counts.max()) if len(counts) else 0
    return counts.astype(np.uint8 if top < 2**8 else np.uint16 if top < 2**16 else np.uint32)


def _with_sums(
    found: FoundPaths, portion: Portion, offsets: NDArray[np.int64], n_channel_sets: int
) -> PathDictionary:
    path_numbers, rays = found.numbers, found.rays
    n_paths = len(rays)
    if portion.weight is None and portion.emission is None:
        sum_w, sum_w2 = rays.astype(np.float64), rays.astype(np.float64)
    else:
        weight = (
            np.ones(portion.n_rays) if portion.weight is None else portion.weight.astype(np.float64)
        )
        sum_w = np.bincount(path_numbers, weight, n_paths).astype(np.float64)
        sum_w2 = sum_of_squares(path_numbers, weight, portion.emission, n_paths)
    ends = portion.color_code[offsets[1:] - 1]
    sums = color_sums(ends, portion.color_table, path_numbers, portion.weight, n_paths)
    colors = (sums / COLOR_SCALE if sums.dtype == np.uint64 else sums).astype(np.float64)
    sets = [np.zeros((n_paths, 0)) for _ in range(max(n_channel_sets, portion.channel_set + 1))]
    sets[portion.channel_set] = colors
    return found.table.with_sums(
        rays, sum_w, sum_w2, tuple(sets), grouped=portion.emission is not None
    )


def sum_of_squares(
    path_numbers: NDArray[np.uint32],
    weight: NDArray[np.float64],
    emission: NDArray[np.int64] | None,
    n_paths: int,
) -> NDArray[np.float64]:
    """Σw² per path; rays of one emission are summed first."""
    if emission is None:
        return np.bincount(path_numbers, weight**2, n_paths).astype(np.float64)
    order = np.lexsort((emission, path_numbers))
    path, group, w = path_numbers[order], emission[order], weight[order]
    starts = np.flatnonzero(
        np.r_[True, (path[1:] != path[:-1]) | (group[1:] != group[:-1])][: len(order)]
    )
    sums = np.add.reduceat(w, starts) if len(starts) else w
    return np.bincount(path[starts], sums**2, n_paths).astype(np.float64)


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
