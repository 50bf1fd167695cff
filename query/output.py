"""Selections as files and tables: ray map, Parquet, Arrow, CSV."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from raymap.errors import MapExists, RayMapError

if TYPE_CHECKING:
    from query.selection import Selection

__all__ = ["check_target", "to_arrow", "write"]

SUFFIXES = (".raymap", ".parquet", ".arrow", ".csv")
_ROWS = ("segments", "rays")


def check_target(path: Path, rows: str) -> None:
    """Refuse what could not be written, before the search begins.

    Raises
    ------
    RayMapError
    """
    if path.suffix.lower() not in SUFFIXES:
        raise RayMapError(f"a selection is written to {', '.join(SUFFIXES)}, not {path.name!r}")
    if rows not in _ROWS:
        raise RayMapError(f"rows are {' or '.join(_ROWS)}, not {rows!r}")
    if not path.parent.is_dir():
        raise RayMapError(f"there is no folder {path.parent} to write {path.name} into")


def to_arrow(selection: Selection, rows: str = "segments") -> Any:
    """The rays of a selection as one Arrow table."""
    import pyarrow as pa

    if rows not in _ROWS:
        raise RayMapError(f"rows are {' or '.join(_ROWS)}, not {rows!r}")
    tables = list(_tables(selection, rows))
    return pa.concat_tables(tables, promote_options="permissive")


def _tables(selection: Selection, rows: str) -> Iterator[Any]:
    """One Arrow table per portion; an empty one where nothing matched."""
    from raymap.arrow import empty_table, portion_table

    some = False
    for portion in selection.portions():
        some = True
        yield portion_table(selection.map, portion, rows)
    if not some:
        yield empty_table(selection.map, rows)


def write(selection: Selection, path: Path, rows: str, *, force: bool) -> Path:
    """Write a selection; the suffix chooses the format.

    Raises
    ------
    RayMapError, MapExists
    """
    check_target(path, rows)
    if path.exists() and not force:
        raise MapExists(f"{path} exists; nothing was written over")
    source = getattr(selection.map, "path", None)
    if isinstance(source, Path) and path.exists() and source.exists() and path.samefile(source):
        raise MapExists(f"{path} is the map that the selection comes from; choose another name")
    beside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        if path.suffix.lower() == ".raymap":
            _write_map(selection, beside)
        else:
            _write_tables(selection, beside, rows)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
    return path


def _write_map(selection: Selection, path: Path) -> None:
    """A map of the selected rays; it keeps the emitted counts of its parent, so fluxes agree."""
    from raymap.writer import RayMapWriter

    map = selection.map
    with RayMapWriter.create(path, map.directory, meshes=dict(map.meshes)) as writer:
        for channel_set in map.channel_sets:
            writer.add_channel_set(channel_set)
        emitted = selection.emitted.copy()
        previous = None
        for portion in selection.portions():
            if previous is not None:
                emitted -= previous.emitted
                writer.append(previous)
            previous = portion
        if previous is not None:
            # Rays emitted in portions without a match belong to the sum, too.
            writer.append(dataclasses.replace(previous, emitted=emitted))
        elif map.portions and emitted.any():
            writer.append(_no_rays(map, emitted))


def _no_rays(map: Any, emitted: Any) -> Any:
    """A portion that says only how many rays were emitted."""
    from query.extract import take_rays

    nothing = take_rays(map.portions[0], np.zeros(0, np.int64))
    return dataclasses.replace(nothing, emitted=emitted, ray_ids=None)


def _write_tables(selection: Selection, path: Path, rows: str) -> None:
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    writer: Any = None
    try:
        for table in _tables(selection, rows):
            if writer is None:
                writer = _table_writer(path, table, pa)
            writer.write_table(table)
    finally:
        if writer is not None:
            writer.close()


def _table_writer(path: Path, table: Any, pa: Any) -> Any:
    if path.suffix.lower() == ".parquet":
        return pa.parquet.ParquetWriter(path, table.schema, compression="zstd")
    if path.suffix.lower() == ".arrow":
        return pa.ipc.new_file(path, table.schema)
    return pa.csv.CSVWriter(path, table.schema)
