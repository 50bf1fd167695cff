"""A portion as it lies in the file: its columns, read and decoded when they are asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.bytes.streams import Scope, decode_column
from raymap.file.portiongeometry import PortionGeometry
from raymap.model.errors import FormatError, RayNotFound
from raymap.model.portion import Portion
from raymap.model.schema import COLOR_SCALE, SEGMENT_DTYPE

if TYPE_CHECKING:
    from raymap.encoding.colors import ColorCodes

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


class StoredPortion(PortionGeometry):
    """One portion of an open map; every method may be called from many threads.

    Attributes
    ----------
    number, first_ray, n_rays, n_records, n_descriptors, channel_set, emitted : as in its header
    has_paths : it has a path dictionary; plain columns otherwise
    has_weights : rays weigh something else than 1
    grouped : several rays may stem from one emission
    stored_bytes : bytes of its chunk
    """

    @property
    def column_names(self) -> tuple[str, ...]:
        """Names that `column` takes, columns that this version does not know included."""
        extras = [name[2:] for name in self._streams if name.startswith("x:")]
        rays = [name for name in _RAY_COLUMNS if name != "emission" or self.grouped]
        return (*rays, *_RECORD_COLUMNS, *extras)

    def column(self, name: str) -> NDArray[Any]:
        """A column by name: one row per record, per ray ("source", "weight", "emission"), or per
        crossing of a detector ("uv", "cell").

        Raises
        ------
        DamagedPortion
            The bytes fail their checksums or contradict each other.
        KeyError
            There is no such column.
        """
        column = self._decoded(name)
        if column is None:
            raise KeyError(f"portion {self.number} has no column {name!r}")
        return column

    @decodes
    def _decoded(self, name: str) -> NDArray[Any] | None:
        """A column, None where there is none of that name."""
        if name in _POINT_COLUMNS:
            return self._points(name)
        method = getattr(self, f"_column_{name}", None)
        if method is not None:
            return method()  # type: ignore[no-any-return]
        if name == "emission" and (self.grouped or "emission" in self._streams):
            return self._stream("emission", self.n_rays, np.int64)
        return self._extra(name) if f"x:{name}" in self._streams else None

    @decodes
    def ray_ids(self) -> NDArray[np.int64]:
        """(n_rays,) strictly increasing ray numbers."""
        if not self._index.meta.has_ids:
            return np.arange(self.first_ray, self.first_ray + self.n_rays, dtype=np.int64)
        gaps = self._stream("ray_gap", self.n_rays, np.uint64)
        ids = self.first_ray + np.cumsum(gaps.astype(np.int64))
        # Gaps so large that the sum wraps around show in the numbers only
        rising = not int(gaps[0]) and gaps[1:].all() and (ids[1:] > ids[:-1]).all()
        if not rising or int(ids[-1]) != self.last_ray:
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
            index = int(np.searchsorted(ids, ray_id))
            if index < len(ids) and int(ids[index]) == ray_id:
                return index
        raise RayNotFound(f"{self._map.path} has no ray {ray_id}")

    @decodes
    def color_table(self) -> NDArray[np.uint16]:
        """(n_colors, n_channels) mixed colours of the portion; rows sum to COLOR_SCALE."""
        n_channels = self._map.channel_sets[self.channel_set].n_channels
        if "color.table" not in self._streams:
            return np.empty((0, n_channels), np.uint16)
        stored = self._stream("color.table", None, np.uint16, matrix=True)
        stored = stored.reshape(len(stored), -1)
        # The last channel is left out, but for the only one
        if stored.shape[1] != max(n_channels - 1, 1):
            raise self._damaged(f"colour table has {stored.shape[1]} columns")
        if n_channels == 1:
            return stored
        last = COLOR_SCALE - stored.sum(1, dtype=np.int64)
        if len(last) and int(last.min()) < 0:
            raise self._damaged("a colour sums to more than one")
        return np.concatenate((stored, last[:, None].astype(np.uint16)), 1)

    def carried(
        self, rays: NDArray[Any], records: NDArray[Any], *, whole: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Light on segments: weights (n,), and shares (n, n_channels) that sum to 1.

        Parameters
        ----------
        rays, records : (n,) rows of the portion; the segments start at the records
        whole : the light that goes on as the whole ray did; else all that comes along there. Only
            where rays are weighed anew does it matter (`raymap.passes.revised`).
        """
        del whole
        codes = self._column_color_code()[records]
        shares = self.color_codes(codes).colors() / COLOR_SCALE
        weight = np.ones(len(records))
        if self.has_weights:
            weight = self.column("weight")[rays].astype(np.float64)
        return weight, shares

    @decodes
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

    @decodes
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

    def _column_color_code(self) -> NDArray[np.int32]:
        channels = self._map.channel_sets[self.channel_set].n_channels
        if "color.code" in self._streams:
            codes = self._stream("color.code", self.n_records, np.int32)
        else:
            from raymap.encoding.colors import rebuild_codes

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

    def _column_last_color(self) -> NDArray[np.int32]:
        """(n_rays,) colour code of each ray's last record, without those of all others."""
        if "color.code" in self._streams:
            return self._column_color_code()[self.record_offsets()[1:] - 1]
        later = self._stream("color.later", None, np.int32)
        codes = self._stream("color.first", self.n_rays, np.int32).copy()
        changes = self._stream("color.changes", self.n_rays, np.int32)
        runs = np.cumsum(changes, dtype=np.int64)
        if self.n_rays and (int(changes.min()) < 0 or int(runs[-1]) != len(later)):
            raise self._damaged("runs of colour do not fit the rays")
        changed = changes > 0
        codes[changed] = later[runs[changed] - 1]
        top = self._map.channel_sets[self.channel_set].n_channels + self._color_rows()
        if len(codes) and not 0 <= int(codes.min()) <= int(codes.max()) < top:
            raise self._damaged("a colour code is not in the colour table")
        return codes

    def _color_rows(self) -> int:
        if "color.table" not in self._streams:
            return 0
        from raymap.bytes.streams import stream_rows

        try:
            return stream_rows(self._streams["color.table"][0])
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def _column_color(self) -> NDArray[np.uint16]:
        return self.color_codes(self._column_color_code()).colors()

    def color_codes(self, codes: NDArray[np.int32]) -> ColorCodes:
        """Codes of this portion, checked against its table of mixed colours."""
        from raymap.encoding.colors import ColorCodes

        try:
            return ColorCodes.check(codes, self.color_table())
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def _extra(self, name: str) -> NDArray[Any]:
        entries = self._streams[f"x:{name}"]
        rows = self.n_records if entries[0].scope == Scope.RECORD else self.n_rays
        try:
            return decode_column(entries, self.fetch, rows)
        except FormatError as error:
            raise self._damaged(str(error)) from None


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
