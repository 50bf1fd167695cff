"""Which format a ray file has: by its first bytes when reading, by its suffix when writing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

from raymap.model.givenfile import check_given, not_readable
from raymap.model.replacing import refuse_existing, replacing
from raymap.rayfiles import tm25, zemax
from raymap.rayfiles.rays import FluxFrom, RayFileError, RaySet

__all__ = ["SUFFIXES", "RayFileWriter", "create", "read", "write"]

SUFFIXES = (".tm25ray", ".dat", ".sdf")
"""Endings of ray files that are written: IES TM-25, Zemax source files."""


class RayFileWriter(Protocol):
    """Takes rays piece by piece; `create` gives one."""

    def append(self, rays: RaySet) -> None:
        """Write rays, with the columns and units of the set that the file was created for."""


def read(path: str | os.PathLike[str], *, flux_from: FluxFrom = "header") -> RaySet:
    """Read a ray file of any known format.

    Parameters
    ----------
    path : of the file
    flux_from : what counts where the header states another flux than its rays carry: the "header"
        (the rays are scaled to it) or the "rays"

    Raises
    ------
    RayFileError
        There is no such file, or it is no sound ray file.
    """
    path = Path(path)
    check_given(path, "ray file", RayFileError)
    try:
        with path.open("rb") as file:
            start = file.read(4)
        if start == tm25.MAGIC or path.suffix.lower() == ".tm25ray":
            return tm25.read(path, flux_from)
        return zemax.read(path, flux_from)
    except OSError as error:
        raise RayFileError(not_readable(path, "ray file", error)) from None


@contextmanager
def create(
    path: str | os.PathLike[str],
    like: RaySet,
    *,
    force: bool = False,
    zemax_version: Literal[1, 2] = 2,
) -> Iterator[RayFileWriter]:
    """A ray file to be written piece by piece; it stands there when the block is left normally.

    Parameters
    ----------
    path : ``*.tm25ray``, ``*.dat`` or ``*.sdf``
    like : rays whose units, columns and texts all pieces share; they are not written
    force : replace an existing file
    zemax_version : of the header of Zemax files: 1 for old programs

    Raises
    ------
    RayFileError, MapExists
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RayFileError(f"ray files end in {', '.join(SUFFIXES)}, not {path.name!r}")
    refuse_existing(path, force=force)
    with replacing(path) as beside, beside.open("wb") as file:
        writer: Any
        if suffix == ".tm25ray":
            writer = tm25.Tm25Writer(file, like)
        else:
            writer = zemax.ZemaxWriter(file, like, version=zemax_version)
        yield writer
        writer.finish()


def write(
    rays: RaySet,
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    zemax_version: Literal[1, 2] = 2,
) -> Path:
    """Write a ray file; the suffix chooses the format.

    Raises
    ------
    RayFileError, MapExists
    """
    with create(path, rays, force=force, zemax_version=zemax_version) as writer:
        writer.append(rays)
    return Path(path)
