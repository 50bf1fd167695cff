"""Rows for the data-frame world: Arrow, Parquet and CSV, streamed portion by portion."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from raymap.file.reader import RayMap
from raymap.file.selection import places_in
from raymap.file.stored import StoredPortion
from raymap.model.errors import DamagedPortion, RayMapError
from raymap.model.portion import Portion
from raymap.model.replacing import NotWritten, refuse_existing, replacing
from raymap.model.rows import take_rays
from raymap.model.schema import COLOR_SCALE, NORMAL_SCALE, UV_SCALE

__all__ = ["batches", "export", "schema_of"]

Rows = Literal["rays", "segments"]
Form = Literal["parquet", "arrow", "csv", "folder"]
_BATCH = 2**16
FORMS: tuple[Form, ...] = ("parquet", "arrow", "csv", "folder")


def export(
    ray_map: RayMap,
    path: str | os.PathLike[str],
    *,
    rows: Rows = "segments",
    ray_ids: NDArray[np.int64] | None = None,
    force: bool = False,
    form: Form | None = None,
) -> int:
    """Write rays as a table; memory does not grow with the map.

    Parameters
    ----------
    path : ``*.parquet``, ``*.arrow`` (Arrow IPC file), ``*.csv``, or a folder that exists or whose
        name ends with a slash, which gets Parquet files
    rows : "segments": one row per segment record; "rays": one row per ray, its records nested
    ray_ids : only these rays, increasing; None: all
    force : replace an existing file
    form : "parquet", "arrow", "csv" or "folder", whatever the name of ``path``

    Returns
    -------
    n : rows written

    Raises
    ------
    RayMapError
        The name does not say in which form.
    MapExists
        There is such a file, or files in the folder, and ``force`` is off.
    NotWritten
        The system refuses to write.
    """
    ray_map.need_rays()
    target = Path(path)
    is_free = target.is_dir() and not any(target.iterdir())
    is_table = target.suffix.lower()[1:] in FORMS
    is_folder = form == "folder" or (form is None and not is_table and _names_folder(path))
    refuse_existing(target, force=force or is_free, folder=is_folder)
    chosen = form or _form_of(os.fspath(path))
    schema = schema_of(ray_map, rows)
    if chosen == "folder":
        return _export_folder(ray_map, target, schema, rows, ray_ids)
    writer: Callable[[Path, pa.Schema, Iterator[pa.RecordBatch]], int]
    writer = {"parquet": _parquet, "arrow": _ipc, "csv": _csv}[chosen]
    with replacing(target) as temporary:
        return writer(temporary, schema, batches(ray_map, rows, ray_ids, schema))


def _names_folder(path: str | os.PathLike[str]) -> bool:
    return os.path.isdir(path) or os.fspath(path).endswith(("/", os.sep))


def _form_of(path: str) -> Form:
    """The form that a name says."""
    ending = Path(path).suffix.lower()[1:]
    for form in FORMS[:3]:
        if form == ending:
            return form
    if _names_folder(path):
        return "folder"
    raise RayMapError(
        f"{path!r} ends with none of .parquet, .arrow, .csv: choose one of them, name a folder as "
        f"'{path}/' for Parquet files in it, or say --format (in Python: form=)"
    )


def schema_of(ray_map: RayMap, rows: Rows) -> pa.Schema:
    """The columns, with the scene's directory in the metadata."""
    name = pa.dictionary(pa.int32(), pa.string())
    color = pa.list_(pa.float32())
    descriptor = pa.struct(
        [
            ("detector", pa.string()),
            ("cell_u", pa.uint16()),
            ("cell_v", pa.uint16()),
            ("cosine", pa.float32()),
            ("u", pa.float32()),
            ("v", pa.float32()),
            ("registered", pa.bool_()),
        ]
    )
    record = [
        ("object", name),
        ("face", name),
        ("medium", name),
        ("triangle", pa.int32()),
        *((axis, pa.float32()) for axis in ("x", "y", "z", "nx", "ny", "nz")),
        ("event", pa.int32()),
        ("color", color),
        ("descriptors", pa.list_(descriptor)),
    ]
    if rows == "segments":
        fields = [("ray_id", pa.int64()), ("step", pa.int32()), ("source", name), *record]
        fields.insert(-1, ("weight", pa.float32()))
    else:
        fields = [
            ("ray_id", pa.int64()),
            ("source", name),
            ("weight", pa.float32()),
            ("segments", pa.list_(pa.struct(record))),
        ]
    return pa.schema(fields, metadata=_metadata(ray_map))


def _metadata(ray_map: RayMap) -> dict[str, str]:
    directory = ray_map.directory
    lights = ray_map.lights
    worth = None
    if any(light.changes for light in lights):
        worth = [light.channel_worth.tolist() for light in lights]
    return {
        "raymap.model.directory": directory.model_dump_json(exclude_defaults=True),
        "raymap.channel_sets": json.dumps(
            [channels.model_dump(mode="json") for channels in ray_map.channel_sets]
        ),
        "raymap.emitted": json.dumps(
            {
                source.name: int(count)
                for source, count in zip(directory.sources, ray_map.emitted, strict=True)
            }
        ),
        "raymap.flux": "flux of a ray = source flux x weight / rays emitted by that source"
        + ("" if worth is None else " x sum over channels of color x raymap.worth"),
        # By channel set, source and channel
        **({} if worth is None else {"raymap.worth": json.dumps(worth)}),
    }


def batches(
    ray_map: RayMap,
    rows: Rows,
    ray_ids: NDArray[np.int64] | None = None,
    schema: pa.Schema | None = None,
) -> Iterator[pa.RecordBatch]:
    """Record batches of the map's rays, in order of their numbers."""
    schema = schema or schema_of(ray_map, rows)
    build = _segments if rows == "segments" else _rays
    names = _Names(ray_map)
    for stored in ray_map.portions:
        places: NDArray[np.int64] | None = None
        if ray_ids is not None:
            places = places_in(stored, ray_ids)
            if not len(places):
                continue
        try:
            portion = stored.read()
            ids = stored.ray_ids()
            if places is not None:
                ids = ids[places]
                portion = take_rays(portion, places, ids)
            faces = names.faces_of(stored, portion)
        except DamagedPortion:
            if ray_map.on_damage == "raise":
                raise
            continue
        table = build(portion, ids, faces, names, schema)
        yield from table.to_batches(max_chunksize=_BATCH)


class _Names:
    """Names of a map's directory as Arrow arrays, and the columns that refer to them."""

    def __init__(self, ray_map: RayMap) -> None:
        directory = ray_map.directory
        self.table = directory.faces
        self.detectors = pa.array([d.name for d in directory.detectors], pa.string())
        self._values = {
            "source": pa.array([source.name for source in directory.sources], pa.string()),
            "object": pa.array([item.name for item in directory.objects], pa.string()),
            "medium": pa.array([medium.name for medium in directory.media], pa.string()),
            "face": pa.array(
                [face.name for item in directory.objects for face in item.faces], pa.string()
            ),
        }

    def column(self, kind: str, indices: NDArray[Any]) -> pa.Array:
        """Indices as dictionary-encoded names; -1 becomes null."""
        # Some readers check the codes under the nulls, too
        codes = pa.array(np.maximum(indices, 0).astype(np.int32), mask=indices < 0)
        return pa.DictionaryArray.from_arrays(codes, self._values[kind])

    def faces_of(self, stored: StoredPortion, portion: Portion) -> NDArray[np.int32]:
        """Face index of each record of some rays of a stored portion."""
        from raymap.encoding.itineraries import assign_faces

        faces = np.empty(portion.n_records, np.int32)
        bad = assign_faces(
            portion.object,
            portion.triangle,
            self.table.first_face,
            self.table.first_primitive,
            self.table.primitive_count,
            faces,
        )
        if bad >= 0:
            # What follows that record was not filled
            raise stored.map.report_damage(stored.index, "primitives do not fit the faces")
        return faces


def _records(portion: Portion, faces: NDArray[np.int32], names: _Names) -> dict[str, pa.Array]:
    """The columns of segment records."""
    normal = portion.normal.astype(np.float32) / NORMAL_SCALE
    return {
        "object": names.column("object", portion.object),
        "face": names.column("face", faces),
        "medium": names.column("medium", portion.medium),
        "triangle": pa.array(portion.triangle),
        **{axis: pa.array(np.ascontiguousarray(portion.position[:, k])) for k, axis in _AXES},
        **{f"n{axis}": pa.array(np.ascontiguousarray(normal[:, k])) for k, axis in _AXES},
        "event": pa.array(portion.event),
        "color": _colors(portion),
        "descriptors": _descriptors(portion, names),
    }


_AXES = tuple(enumerate("xyz"))


def _colors(portion: Portion) -> pa.Array:
    """Shares of the channels as lists, from codes."""
    channels = portion.color_table.shape[1]
    pure = np.eye(channels, dtype=np.float32)
    mixed = (portion.color_table / COLOR_SCALE).astype(np.float32)
    colors = np.concatenate((pure, mixed))[portion.color_code]
    offsets = np.arange(0, colors.size + 1, channels, dtype=np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), pa.array(colors.reshape(-1)))


def _descriptors(portion: Portion, names: _Names) -> pa.Array:
    d = portion.descriptors
    cosine = d.cosine.astype(np.float32) / NORMAL_SCALE
    uv = d.uv.astype(np.float32) / UV_SCALE
    values = pa.StructArray.from_arrays(
        [
            names.detectors.take(pa.array(d.detector)),
            pa.array(np.ascontiguousarray(d.cell[:, 0])),
            pa.array(np.ascontiguousarray(d.cell[:, 1])),
            pa.array(cosine),
            pa.array(np.ascontiguousarray(uv[:, 0])),
            pa.array(np.ascontiguousarray(uv[:, 1])),
            pa.array(d.registered),
        ],
        ["detector", "cell_u", "cell_v", "cosine", "u", "v", "registered"],
    )
    offsets = np.zeros(portion.n_records + 1, np.int32)
    np.cumsum(portion.descriptor_count, out=offsets[1:])
    return pa.ListArray.from_arrays(pa.array(offsets), values)


def _weights(portion: Portion) -> NDArray[np.float32]:
    return np.ones(portion.n_rays, np.float32) if portion.weight is None else portion.weight


def _segments(
    portion: Portion,
    ids: NDArray[np.int64],
    faces: NDArray[np.int32],
    names: _Names,
    schema: pa.Schema,
) -> pa.Table:
    counts = portion.records_per_ray
    starts = np.cumsum(counts) - counts
    step = np.arange(portion.n_records) - np.repeat(starts, counts)
    columns = {
        "ray_id": pa.array(np.repeat(ids, counts)),
        "step": pa.array(step.astype(np.int32)),
        "source": names.column("source", np.repeat(portion.source, counts)),
        "weight": pa.array(np.repeat(_weights(portion), counts)),
        **_records(portion, faces, names),
    }
    return pa.table([columns[name] for name in schema.names], schema=schema)


def _rays(
    portion: Portion,
    ids: NDArray[np.int64],
    faces: NDArray[np.int32],
    names: _Names,
    schema: pa.Schema,
) -> pa.Table:
    records = _records(portion, faces, names)
    nested = schema.field("segments").type
    offsets = np.zeros(portion.n_rays + 1, np.int32)
    np.cumsum(portion.records_per_ray, out=offsets[1:])
    values = pa.StructArray.from_arrays(
        list(records.values()), fields=list(nested.value_type.fields)
    )
    columns = [
        pa.array(ids),
        names.column("source", portion.source),
        pa.array(_weights(portion)),
        pa.ListArray.from_arrays(pa.array(offsets), values),
    ]
    return pa.table(columns, schema=schema)


def _parquet(path: Path, schema: pa.Schema, rows: Iterator[pa.RecordBatch]) -> int:
    import pyarrow.parquet as pq

    n = 0
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for batch in rows:
            writer.write_batch(batch)
            n += batch.num_rows
    return n


def _ipc(path: Path, schema: pa.Schema, rows: Iterator[pa.RecordBatch]) -> int:
    n = 0
    with pa.ipc.new_file(path, schema) as writer:
        for batch in rows:
            writer.write_batch(batch)
            n += batch.num_rows
    return n


def _csv(path: Path, schema: pa.Schema, rows: Iterator[pa.RecordBatch]) -> int:
    """Lists have no place in CSV: colours become one column per channel, descriptors their number.

    Raises
    ------
    RayMapError
        Rows are nested rays.
    """
    if "segments" in schema.names:
        raise RayMapError('CSV has no nested rows: export with rows="segments", or to Parquet')
    sets = json.loads(schema.metadata[b"raymap.channel_sets"])
    channels = max((len(each["wavelengths_nm"]) for each in sets), default=0)
    flat = pa.schema(
        [
            *(field for field in schema if field.name not in ("color", "descriptors")),
            *((f"color_{k}", pa.float32()) for k in range(channels)),
            ("descriptors", pa.int32()),
        ]
    )
    flat = pa.schema(
        [f.with_type(pa.string()) if pa.types.is_dictionary(f.type) else f for f in flat]
    )
    n = 0
    with path.open("wb") as file:
        file.write((",".join(f'"{name}"' for name in flat.names) + "\n").encode())
        for batch in rows:
            if batch.num_rows:
                file.write(_lines(_flattened(batch, flat)))
            n += batch.num_rows
    return n


def _lines(batch: pa.RecordBatch) -> bytes:
    """Rows of a batch as text, real numbers with a point or an exponent.

    Readers take the type of a column from its first rows, where much may be 0.
    """
    import pyarrow.compute as pc

    columns = []
    for column in batch.columns:
        if pa.types.is_string(column.type):
            text = pc.binary_join_element_wise(
                '"', pc.replace_substring(column, '"', '""'), '"', ""
            )
        else:
            text = pc.cast(column, pa.string())
        if pa.types.is_floating(column.type):
            whole = pc.invert(pc.match_substring_regex(text, "[.en]"))
            text = pc.if_else(whole, pc.binary_join_element_wise(text, ".0", ""), text)
        columns.append(pc.fill_null(text, ""))
    lines = pc.binary_join_element_wise(*columns, ",") if len(columns) > 1 else columns[0]
    return ("\n".join(lines.to_pylist()) + "\n").encode()


def _flattened(batch: pa.RecordBatch, flat: pa.Schema) -> pa.RecordBatch:
    import pyarrow.compute as pc

    colors = batch.column("color")
    lengths = pc.list_value_length(colors)
    columns = []
    for field in flat:
        if field.name.startswith("color_"):
            channel = int(field.name[6:])
            safe = pc.if_else(pc.greater(lengths, channel), colors, None)
            columns.append(pc.list_element(safe, channel) if len(batch) else _empty(field.type))
        elif field.name == "descriptors":
            columns.append(pc.list_value_length(batch.column("descriptors")))
        else:
            columns.append(batch.column(field.name).cast(field.type))
    return pa.record_batch(columns, schema=flat)


def _empty(kind: pa.DataType) -> pa.Array:
    return pa.array([], kind)


def _export_folder(
    ray_map: RayMap,
    folder: Path,
    schema: pa.Schema,
    rows: Rows,
    ray_ids: NDArray[np.int64] | None,
) -> int:
    """Parts of an earlier export stand there until all of this one are written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise NotWritten(folder, os.strerror(error.errno or 0)) from None
    earlier = set(folder.glob("part-[0-9][0-9][0-9][0-9][0-9].parquet"))
    n = 0
    parts: list[Path] = []
    pending: list[pa.RecordBatch] = []
    with contextlib.ExitStack() as whole:

        def flush() -> None:
            parts.append(folder / f"part-{len(parts):05d}.parquet")
            _parquet(whole.enter_context(replacing(parts[-1])), schema, iter(pending))
            pending.clear()

        for batch in batches(ray_map, rows, ray_ids, schema):
            pending.append(batch)
            n += batch.num_rows
            if sum(each.num_rows for each in pending) >= _BATCH * 16:
                flush()
        if pending or not parts:
            flush()
    for path in earlier.difference(parts):
        path.unlink()
    return n
