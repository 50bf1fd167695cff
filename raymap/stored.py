"""A portion as it lies in the file: its columns, read and decoded when they are asked for."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.errors import DamagedPortion, FormatError, RayNotFound
from raymap.footer import IndexEntry
from raymap.layout import PORTION, ChunkHeader, StreamEntry
from raymap.paths import PathDictionary
from raymap.pathstreams import check_itineraries, offsets_from_counts
from raymap.portion import Descriptors, Portion
from raymap.portionmeta import DESCRIPTOR_STREAMS, Encoding, PortionMeta
from raymap.schema import COLOR_SCALE, NONE, SEGMENT_DTYPE
from raymap.streams import Scope, decode_column

if TYPE_CHECKING:
    from raymap.reader import RayMap

__all__ = ["StoredPortion"]

_RECORD_COLUMNS = (
    "object",
    "face",
    "triangle",
    "position",
    "normal",
    "event",
    "medium",
    "descriptor_count",
    "first_descriptor",
    "color",
    "color_code",
)
_RAY_COLUMNS = ("source", "weight", "emission")
_POINT_COLUMNS = ("object", "face", "event", "medium")


class StoredPortion:
    """One portion of an open map; every method may be called from many threads.

    Attributes
    ----------
    number, first_ray, n_rays, n_records, n_descriptors, channel_set, emitted : as in its header
    has_paths : it has a path dictionary; plain columns otherwise
    has_weights : rays weigh something else than 1
    grouped : several rays may stem from one emission
    stored_bytes : bytes of its chunk
    """

    def __init__(self, map: RayMap, index: IndexEntry) -> None:
        self._map = self.map = map
        self._index = self.index = index
        meta = index.meta
        self.number = meta.number
        self.first_ray = meta.first_ray
        self.last_ray = meta.last_ray
        self.n_rays = meta.n_rays
        self.n_records = meta.n_records
        self.n_descriptors = meta.n_descriptors
        self.emitted = meta.emitted
        self.channel_set = meta.channel_set
        self.has_paths = meta.has_paths
        self.has_weights = meta.has_weights
        self.grouped = meta.grouped
        self.stored_bytes = index.size
        self.offset = index.offset

    def __repr__(self) -> str:
        return f"StoredPortion(number={self.number}, n_rays={self.n_rays})"

    # -- columns -----------------------------------------------------------------------------

    @property
    def column_names(self) -> tuple[str, ...]:
        """Names that `column` takes, columns that this version does not know included."""
        extras = [name[2:] for name in self._streams if name.startswith("x:")]
        rays = [name for name in _RAY_COLUMNS if name != "emission" or self.grouped]
        return (*rays, *_RECORD_COLUMNS, *extras)

    def column(self, name: str) -> NDArray[Any]:
        """A column by name: one row per record, or per ray ("source", "weight", "emission").

        Raises
        ------
        DamagedPortion
            The bytes fail their checksums or contradict each other.
        KeyError
            There is no such column.
        """
        if name in _POINT_COLUMNS:
            return self._points(name)
        method = getattr(self, f"_column_{name}", None)
        if method is not None:
            return method()  # type: ignore[no-any-return]
        if name == "emission" and "emission" in self._streams:
            return self._stream("emission", self.n_rays, np.int64)
        if f"x:{name}" in self._streams:
            return self._extra(name)
        raise KeyError(f"portion {self.number} has no column {name!r}")

    def paths(self) -> PathDictionary:
        """The dictionary; of a plain portion a view with one path per ray, decoded when touched."""
        if self.has_paths:
            return self._dictionary
        return PlainPaths(self)

    def path_numbers(self) -> NDArray[np.uint32]:
        """(n_rays,) row of `paths` that each ray took."""
        if not self.has_paths:
            return np.arange(self.n_rays, dtype=np.uint32)
        numbers = self._stream("path_number", self.n_rays, np.uint32)
        if self.n_rays and int(numbers.max()) >= self._index.meta.n_paths:
            raise self._damaged("a ray's path is not in the dictionary")
        return numbers

    def ray_ids(self) -> NDArray[np.int64]:
        """(n_rays,) strictly increasing ray numbers."""
        if not self._index.meta.has_ids:
            return np.arange(self.first_ray, self.first_ray + self.n_rays, dtype=np.int64)
        gaps = self._stream("ray_gap", self.n_rays, np.uint64)
        ids = self.first_ray + np.cumsum(gaps.astype(np.int64))
        if int(gaps[0]) or not gaps[1:].all() or int(ids[-1]) != self.last_ray:
            raise self._damaged("ray numbers do not increase to the last one")
        if (ids[1:] <= ids[:-1]).any():
            raise self._damaged("ray numbers do not increase to the last one")
        return ids

    def index_of(self, ray_id: int) -> int:
        """Place of a ray in the portion.

        Raises
        ------
        RayNotFound
            The portion does not hold the ray.
        """
        if self.first_ray <= ray_id <= self.last_ray:
            if not self._index.meta.has_ids:
                return ray_id - self.first_ray
            ids = self.ray_ids()
            place = int(np.searchsorted(ids, ray_id))
            if place < len(ids) and int(ids[place]) == ray_id:
                return place
        raise RayNotFound(f"{self._map.path} has no ray {ray_id}")

    def record_offsets(self) -> NDArray[np.int64]:
        """(n_rays + 1,) records of ray i are offsets[i]:offsets[i + 1]."""
        return self._record_offsets(self.path_numbers() if self.has_paths else None)

    def _record_offsets(self, numbers: NDArray[np.uint32] | None) -> NDArray[np.int64]:
        """Record offsets of rays whose path numbers are there already."""
        if numbers is not None:
            counts = np.diff(self._dictionary.offsets)[numbers]
        else:
            counts = self._stream("path.length", self.n_rays, np.uint32)
            if self.n_rays and not counts.all():
                raise self._damaged("a ray has no records")
        try:
            return offsets_from_counts(counts, self.n_records, "records of rays")
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def color_table(self) -> NDArray[np.uint16]:
        """(n_colors, n_channels) mixed colours of the portion; rows sum to COLOR_SCALE."""
        n_channels = self._map.channel_sets[self.channel_set].n_channels
        if "color.table" not in self._streams:
            return np.empty((0, n_channels), np.uint16)
        stored = self._stream("color.table", None, np.uint16, matrix=True)
        stored = stored.reshape(len(stored), -1)
        if n_channels == 1:
            return stored
        if stored.shape[1] != n_channels - 1:
            raise self._damaged(f"colour table has {stored.shape[1] + 1} channels")
        last = COLOR_SCALE - stored.sum(1, dtype=np.int64)
        if len(last) and int(last.min()) < 0:
            raise self._damaged("a colour sums to more than one")
        return np.concatenate((stored, last[:, None].astype(np.uint16)), 1)

    def descriptors(self, position: NDArray[np.float32] | None = None) -> Descriptors:
        """All meetings with detectors, in record order.

        Parameters
        ----------
        position : the column, where the caller has it: places on flat detectors follow from it
        """
        detector, registered = self._meetings()
        if not self._index.meta.encodings & Encoding.CROSSINGS:
            cell, cosine, uv = self._plain_descriptors()
        else:
            cell, cosine, uv = self._crossings(detector, position)
        return Descriptors(
            detector=detector, cell=cell, cosine=cosine, uv=uv, registered=registered
        )

    def _plain_descriptors(self) -> tuple[NDArray[Any], ...]:
        n = self.n_descriptors
        if n == 0:
            return np.empty((0, 2), np.uint16), np.empty(0, np.int16), np.empty((0, 2), np.uint16)
        kinds = (np.uint16, np.uint16, np.int16, np.uint16, np.uint16)
        columns = [
            self._stream(name, n, kind)
            for name, kind in zip(DESCRIPTOR_STREAMS, kinds, strict=True)
        ]
        return np.stack(columns[:2], 1), columns[2], np.stack(columns[3:], 1)

    def _crossings(
        self, detector: NDArray[np.int16], position: NDArray[np.float32] | None
    ) -> tuple[NDArray[Any], ...]:
        from raymap.meetings import decode_meetings

        n = self.n_descriptors
        folded = np.stack([self._stream(name, n, np.uint16) for name in DESCRIPTOR_STREAMS])
        cell, uv = np.empty((n, 2), np.uint16), np.empty((n, 2), np.uint16)
        cosine = np.empty(n, np.int16)
        counts = self._column_descriptor_count()
        self._meeting_offsets(counts)
        decode_meetings(
            counts,
            detector,
            self._column_position() if position is None else position,
            *self._map.detectors,
            bool(self._index.meta.encodings & Encoding.REVERSED),
            folded,
            cell,
            cosine,
            uv,
        )
        return cell, cosine, uv

    def read(self) -> Portion:
        """Everything."""
        ids = self.ray_ids() if self._index.meta.has_ids else None
        known = {*_RAY_COLUMNS, *_RECORD_COLUMNS}
        position = self.column("position")
        return Portion(
            emitted=self.emitted.copy(),
            source=self.column("source"),
            records_per_ray=np.diff(self.record_offsets()).astype(np.int32),
            position=position,
            normal=self._normals(position),
            object=self.column("object"),
            triangle=self.column("triangle"),
            event=self.column("event"),
            medium=self.column("medium"),
            color_code=self.column("color_code"),
            color_table=self.color_table(),
            descriptor_count=self.column("descriptor_count"),
            descriptors=self.descriptors(position),
            first_ray=self.first_ray,
            ray_ids=ids,
            channel_set=self.channel_set,
            weight=self.column("weight") if self.has_weights else None,
            emission=self.column("emission") if self.grouped else None,
            extra={name: self.column(name) for name in self.column_names if name not in known},
        )

    def segments(self) -> NDArray[np.void]:
        """(n_records,) structured array of `SEGMENT_DTYPE`: the 36-byte segment records."""
        out = np.empty(self.n_records, SEGMENT_DTYPE)
        out["source"] = np.repeat(self.column("source"), np.diff(self.record_offsets()))
        for name in SEGMENT_DTYPE.names or ():
            if name != "source":
                out[name] = self.column(name)
        return out

    def stream_bytes(self, name: str) -> int:
        """Stored bytes of a column, of all parts of its encoding together."""
        prefixes = _PARTS.get(name, (name,))
        return sum(
            entry.stored_size
            for stream, entries in self._streams.items()
            if any(stream == prefix or stream.startswith(f"{prefix}.") for prefix in prefixes)
            for entry in entries
        )

    def stream_table(self) -> tuple[StreamEntry, ...]:
        """The streams as they lie in the chunk."""
        return self._header.streams

    def chunk_bytes(self) -> bytes:
        """The chunk as it lies in the file."""
        return self._map.file.read(self._index.offset, self._index.size)

    # -- from the file -----------------------------------------------------------------------

    @cached_property
    def _header(self) -> ChunkHeader:
        file = self._map.file
        try:
            chunk = file.chunk_at(self._index.offset, self._index.offset + self._index.size)
            if chunk.tag != PORTION or chunk.header.size != self._index.size:
                raise FormatError("another chunk lies in its place")
            meta = PortionMeta.parse(chunk.header.meta, len(self.emitted))
            if meta.pack() != self._index.meta.pack():
                raise FormatError("its header contradicts the footer")
        except FormatError as error:
            raise self._damaged(str(error)) from None
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
        try:
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
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def fetch(self, entry: StreamEntry) -> bytes:
        """The stored bytes of one stream."""
        return self._map.file.read(self._index.offset + entry.offset, entry.stored_size)

    def _damaged(self, reason: str) -> DamagedPortion:
        return self._map.report_damage(self._index, reason)

    # -- columns rebuilt ---------------------------------------------------------------------

    @cached_property
    def _dictionary(self) -> PathDictionary:
        meta = self._index.meta
        try:
            columns = check_itineraries(
                lambda name, rows, dtype: self._stream(f"path.{name}", rows, dtype),
                meta.n_paths,
                self._map.bounds,
            )
            if (
                int(columns["offsets"][-1]) != meta.n_points
                or int(columns["detector_offsets"][-1]) != meta.n_meetings
            ):
                raise FormatError("path dictionary has another size than the header says")
        except DamagedPortion:
            raise
        except FormatError as error:
            raise self._damaged(str(error)) from None
        rays = self._stream("path.rays", meta.n_paths, np.int64)
        if int(rays.sum()) != self.n_rays:
            raise self._damaged("rays of the paths do not add up")
        weighted = "path.sum_w" in self._streams
        n = meta.n_paths
        return PathDictionary(
            **columns,
            rays=rays,
            sum_w=self._stream("path.sum_w", n, np.float64) if weighted else rays.astype(float),
            sum_w2=self._stream("path.sum_w2", n, np.float64) if weighted else rays.astype(float),
            sum_wc=self._color_sums(n),
            grouped=self.grouped,
        )

    def _color_sums(self, n_paths: int) -> tuple[NDArray[np.float64], ...]:
        sums = [np.zeros((n_paths, 0)) for _ in self._map.channel_sets]
        if self.has_weights:
            own = self._stream("path.sum_wc", n_paths, np.float64, matrix=True)
        else:
            own = self._stream("path.sum_c", n_paths, np.uint64, matrix=True) / COLOR_SCALE
        own = own.reshape(n_paths, -1)
        if own.shape[1] != self._map.channel_sets[self.channel_set].n_channels:
            raise self._damaged("colours of the paths have another number of channels")
        sums[self.channel_set] = own
        return tuple(sums)

    def _points(self, name: str) -> NDArray[Any]:
        """A column that the path dictionary implies."""
        if not self.has_paths:
            column = self._stream(f"path.{name}", self.n_records, _POINT_TYPES[name])
            if name != "event":
                self._check_bounds(name, column)
            return column
        return self._expand(getattr(self._dictionary, name))

    def _expand(self, column: NDArray[Any]) -> NDArray[Any]:
        from raymap.itineraries import expand_points

        out = np.empty(self.n_records, column.dtype)
        numbers = self.path_numbers()
        expand_points(numbers, self._dictionary.offsets, self._record_offsets(numbers), column, out)
        return out

    def _check_bounds(self, name: str, column: NDArray[Any]) -> NDArray[Any]:
        try:
            return self._map.bounds.check(name, column)
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def _column_source(self) -> NDArray[np.int16]:
        if self.has_paths:
            return self._dictionary.source[self.path_numbers()]
        return self._check_bounds("source", self._stream("path.source", self.n_rays, np.int16))

    def _column_weight(self) -> NDArray[np.float32]:
        if not self.has_weights:
            return np.ones(self.n_rays, np.float32)
        return self._stream("weight", self.n_rays, np.float32)

    def _column_descriptor_count(self) -> NDArray[np.uint16]:
        if self.has_paths:
            return self._expand(np.diff(self._dictionary.detector_offsets).astype(np.uint16))
        return self._stream("path.meetings", self.n_records, np.uint16)

    def _column_first_descriptor(self) -> NDArray[np.int32]:
        counts = self._column_descriptor_count()
        offsets = self._meeting_offsets(counts)
        return np.where(counts > 0, offsets[:-1], NONE).astype(np.int32)

    def _meeting_offsets(self, counts: NDArray[np.uint16]) -> NDArray[np.int64]:
        try:
            return offsets_from_counts(counts, self.n_descriptors, "descriptors of records")
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def _meetings(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        n = self.n_descriptors
        if not self.has_paths:
            detector = self._stream("path.detector", n, np.int16)
            registered = self._stream("path.registered", n, np.bool_)
            return self._check_bounds("detector", detector), registered
        paths = self._dictionary
        starts = paths.detector_offsets[paths.offsets]
        numbers = self.path_numbers()
        offsets = np.zeros(self.n_rays + 1, np.int64)
        np.cumsum(np.diff(starts)[numbers], out=offsets[1:])
        if int(offsets[-1]) != n:
            raise self._damaged(f"descriptors of rays add up to {int(offsets[-1])}, not {n}")
        from raymap.itineraries import expand_points

        detector = np.empty(n, np.int16)
        registered = np.empty(n, np.bool_)
        expand_points(numbers, starts, offsets, paths.detector, detector)
        expand_points(numbers, starts, offsets, paths.registered, registered)
        return detector, registered

    def _column_triangle(self) -> NDArray[np.int32]:
        from raymap.itineraries import face_triangles

        faces = self._map.directory.faces
        if "triangle" in self._streams:
            explicit = self._stream("triangle", None, np.int32)
        else:
            explicit = np.empty(0, np.int32)
        out = np.empty(self.n_records, np.int32)
        if not face_triangles(
            self._points("face"),
            faces.first_primitive,
            faces.primitive_count,
            self._points("object"),
            explicit,
            out,
        ):
            raise self._damaged("primitives do not fit the faces")
        return out

    def _shape_codes(
        self, triangles: NDArray[np.int32] | None
    ) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
        """(shape codes, primitives or (0,) where no code needs them, record offsets)."""
        from raymap.geometry import resolve_codes
        from raymap.shapes import MANY, RayShapes, shape_codes

        paths = self.paths()
        point_codes = np.empty(paths.n_points, np.int32)
        shapes = self._map.shapes
        shape_codes(
            paths.offsets, paths.object, paths.face, paths.event, shapes.face_code, point_codes
        )
        if triangles is None:
            many = self.n_records and bool((point_codes <= MANY).any())
            triangles = self._column_triangle() if many else np.empty(0, np.int32)
        numbers = self.path_numbers()
        offsets = self._record_offsets(numbers) if self.has_paths else paths.offsets
        codes = np.empty(self.n_records, np.int32)
        resolve_codes(
            RayShapes(numbers, paths.offsets, offsets, point_codes, triangles),
            shapes,
            codes,
        )
        return codes, triangles, offsets

    def _column_position(self) -> NDArray[np.float32]:
        encodings = self._index.meta.encodings
        solve_faces = bool(encodings & Encoding.SOLVED_FACES)
        solve_sphere = bool(encodings & Encoding.SOLVED_SPHERE)
        out = np.empty((self.n_records, 3), np.float32)
        if not solve_faces and not solve_sphere:
            for axis, name in enumerate("xyz"):
                out[:, axis] = self._stream(f"position.{name}", self.n_records, np.float32)
            return out
        from raymap.geometry import join_coordinates, solve_positions

        shapes = self._map.shapes
        several = solve_faces and len(shapes.primitive_quadric) > 0
        codes, _, _ = self._shape_codes(None if several else np.empty(0, np.int32))
        x, y, z = (self._stream(f"position.{name}", None, np.float32) for name in "xyz")
        bits = out.view(np.int32)
        solved = np.empty(self.n_records, np.int32)
        n = join_coordinates(
            codes,
            shapes.axis,
            solve_faces,
            solve_sphere,
            x.view(np.int32),
            y.view(np.int32),
            z.view(np.int32),
            bits,
            solved,
        )
        if n < 0:
            raise self._damaged("positions do not fit the paths")
        solve_positions(
            solved[:n],
            codes,
            shapes.solve,
            shapes.axis,
            self._stream("position.residual", n, np.uint32),
            self._stream("position.root", n, np.uint8),
            out,
            bits,
        )
        return out

    def _column_normal(self) -> NDArray[np.int16]:
        return self._normals(None)

    def _normals(self, position: NDArray[np.float32] | None) -> NDArray[np.int16]:
        """Normals; residuals need the positions, which may be there already."""
        out = np.empty((self.n_records, 3), np.int16)
        n = self.n_records
        if not self._index.meta.encodings & Encoding.NORMALS:
            for axis, name in enumerate("xyz"):
                out[:, axis] = self._stream(f"normal.{name}", n, np.int16)
            return out
        from raymap.geometry import decode_normals

        shapes = self._map.shapes
        codes, triangles, offsets = self._shape_codes(None)
        decode_normals(
            offsets,
            codes,
            triangles,
            self._column_source(),
            shapes.gradient,
            shapes.first_primitive,
            shapes.face_start,
            np.zeros((len(self.emitted), 3), np.int16),
            np.zeros((shapes.n_remembered, 3), np.int16),
            self._column_position() if position is None else position,
            self._stream("normal.x", n, np.uint16),
            self._stream("normal.y", n, np.uint16),
            self._stream("normal.z", n, np.uint16),
            out,
        )
        return out

    def _column_color_code(self) -> NDArray[np.int32]:
        channels = self._map.channel_sets[self.channel_set].n_channels
        if "color.code" in self._streams:
            codes = self._stream("color.code", self.n_records, np.int32)
        else:
            from raymap.colors import rebuild_codes

            codes = np.empty(self.n_records, np.int32)
            later = self._stream("color.later", None, np.int32)
            sound = rebuild_codes(
                self.record_offsets(),
                self._stream("color.first", self.n_rays, np.int32),
                self._stream("color.changes", self.n_rays, np.int32),
                self._stream("color.length", len(later), np.int32),
                later,
                codes,
            )
            if not sound:
                raise self._damaged("runs of colour do not fit the rays")
        top = channels + self._color_rows()
        if len(codes) and not 0 <= int(codes.min()) <= int(codes.max()) < top:
            raise self._damaged("a colour code is not in the colour table")
        return codes

    def _color_rows(self) -> int:
        if "color.table" not in self._streams:
            return 0
        from raymap.streams import stream_rows

        return stream_rows(self._streams["color.table"][0])

    def _column_color(self) -> NDArray[np.uint16]:
        from raymap.colors import colors_of_codes

        codes = self._column_color_code()
        table = self.color_table()
        out = np.empty((self.n_records, table.shape[1]), np.uint16)
        colors_of_codes(codes, table, out)
        return out

    def _extra(self, name: str) -> NDArray[Any]:
        entries = self._streams[f"x:{name}"]
        rows = self.n_records if entries[0].scope == Scope.RECORD else self.n_rays
        try:
            return decode_column(entries, self.fetch, rows)
        except FormatError as error:
            raise self._damaged(str(error)) from None


_POINT_TYPES: dict[str, Any] = {
    "object": np.int16,
    "face": np.int32,
    "event": np.int32,
    "medium": np.int16,
}
_PARTS = {
    "source": ("path.source", "path_number"),
    "object": ("path.object", "path_number"),
    "face": ("path.face", "path_number"),
    "event": ("path.event", "path_number"),
    "medium": ("path.medium", "path_number"),
    "descriptor_count": ("path.meetings", "path_number"),
    "descriptors": ("descriptor",),
    "color_code": ("color",),
    "ray_ids": ("ray_gap",),
    "path_numbers": ("path_number",),
    "paths": ("path",),
}


class PlainPaths(PathDictionary):
    """A plain portion as a dictionary of one path per ray; columns are decoded when touched."""

    def __init__(self, portion: StoredPortion) -> None:
        object.__setattr__(self, "_portion", portion)

    _portion: StoredPortion

    @property
    def n_paths(self) -> int:
        return self._portion.n_rays

    @property
    def n_points(self) -> int:
        return self._portion.n_records

    @property
    def n_meetings(self) -> int:
        return self._portion.n_descriptors

    def _source(self) -> NDArray[np.int16]:
        return self._portion.column("source")

    def _detector_offsets(self) -> NDArray[np.int64]:
        return self._portion._meeting_offsets(self._portion.column("descriptor_count"))

    def _sum_w2(self) -> NDArray[np.float64]:
        return self.sum_w**2

    def _sum_wc(self) -> tuple[NDArray[np.float64], ...]:
        portion = self._portion
        ends = portion.record_offsets()[1:] - 1
        codes = portion.column("color_code")[ends]
        table = portion.color_table()
        from raymap.colors import colors_of_codes

        colors = np.empty((portion.n_rays, table.shape[1]), np.uint16)
        colors_of_codes(codes, table, colors)
        sums = [np.zeros((portion.n_rays, 0)) for _ in portion._map.channel_sets]
        sums[portion.channel_set] = colors / COLOR_SCALE * self.sum_w[:, None]
        return tuple(sums)

    def __getattribute__(self, name: str) -> Any:
        getter = _LAZY.get(name)
        if getter is None:
            return object.__getattribute__(self, name)
        known = object.__getattribute__(self, "__dict__")
        if name not in known:
            known[name] = getter(self)
        return known[name]


_LAZY: dict[str, Any] = {
    "source": PlainPaths._source,
    "offsets": lambda view: view._portion.record_offsets(),
    "object": lambda view: view._portion.column("object"),
    "face": lambda view: view._portion.column("face"),
    "event": lambda view: view._portion.column("event"),
    "medium": lambda view: view._portion.column("medium"),
    "detector_offsets": PlainPaths._detector_offsets,
    "detector": lambda view: view._portion._meetings()[0],
    "registered": lambda view: view._portion._meetings()[1],
    "rays": lambda view: np.ones(view._portion.n_rays, np.int64),
    "sum_w": lambda view: view._portion.column("weight").astype(np.float64),
    "sum_w2": PlainPaths._sum_w2,
    "sum_wc": PlainPaths._sum_wc,
    "grouped": lambda view: view._portion.grouped,
}
