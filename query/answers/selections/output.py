"""Selections as files and tables: ray map, Parquet, Arrow, CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MapExists, RayMapError
from raymap.model.replacing import refuse_existing
from raymap.rayfiles.formats import RAY_FORMATS

__all__ = ["check_target", "to_arrow", "write"]

SUFFIXES = (".raymap", ".parquet", ".arrow", ".csv")
_ROWS = ("segments", "rays")


class Chosen(Protocol):
    """What is written: a map, the numbers of rays of it, and the criterion that they satisfy."""

    @property
    def map(self) -> Any: ...
    @property
    def ray_ids(self) -> NDArray[np.int64]: ...
    @property
    def criterion(self) -> object: ...


def check_target(path: Path, rows: str, *, force: bool) -> None:
    """Refuse what could not be written, before the search begins.

    Parameters
    ----------
    force : replace an existing file

    Raises
    ------
    RayMapError, MapExists
    """
    if path.suffix.lower() in RAY_FORMATS:
        raise RayMapError(
            f"{path.name} is a ray file: say where the rays are taken with "
            f"raymap rayfile MAP PLACE [CRITERION] -o {path.name}"
        )
    if path.suffix.lower() not in SUFFIXES:
        raise RayMapError(f"a selection is written to {', '.join(SUFFIXES)}, not {path.name!r}")
    if rows not in _ROWS:
        raise RayMapError(f"rows are {' or '.join(_ROWS)}, not {rows!r}")
    refuse_existing(path, force=force)


def to_arrow(selection: Chosen, rows: str = "segments") -> Any:
    """The rays of a selection as one Arrow table."""
    import pyarrow as pa

    from raymap.tables.arrow import batches, schema_of

    if rows not in _ROWS:
        raise RayMapError(f"rows are {' or '.join(_ROWS)}, not {rows!r}")
    chosen: Any = rows
    schema = schema_of(selection.map, chosen)
    found = batches(selection.map, chosen, selection.ray_ids, schema)
    return pa.Table.from_batches(found, schema)


def write(selection: Chosen, path: Path, rows: str, *, force: bool) -> Path:
    """Write a selection; the suffix chooses the format.

    Raises
    ------
    RayMapError, MapExists
    """
    check_target(path, rows, force=force)
    source = getattr(selection.map, "path", None)
    if isinstance(source, Path) and path.exists() and source.exists() and path.samefile(source):
        raise MapExists(f"{path} is the map that the selection comes from; choose another name")
    if path.suffix.lower() == ".raymap":
        from raymap.file.selection import copy_selection

        asked = "" if selection.criterion is None else str(selection.criterion)
        copy_selection(selection.map, selection.ray_ids, path, force=force, description=asked)
    else:
        from raymap.tables.arrow import export

        chosen: Any = rows
        export(selection.map, path, rows=chosen, ray_ids=selection.ray_ids, force=force)
    return path
