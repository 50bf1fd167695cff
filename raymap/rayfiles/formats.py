"""Which format a ray file has: by its first bytes when reading, by its suffix when writing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from raymap.model.fileformat import (
    by_content,
    by_suffix,
    known_suffixes,
    of_other_program,
    suffixes_of,
)
from raymap.model.givenfile import check_given, not_readable
from raymap.model.registry import Registry
from raymap.model.replacing import refuse_existing, replacing
from raymap.rayfiles.format import RayFileWriter, RayFormat
from raymap.rayfiles.rays import FluxFrom, RayFileError, RaySet

__all__ = ["RAY_FORMATS", "create", "read", "write"]

RAY_FORMATS: Registry[RayFormat] = Registry(
    "raymap.ray_formats",
    "raymap.rayfiles",
    words=suffixes_of,
    of=RayFormat,
    sort="formats of ray files",
)
"""Formats of ray files by suffix."""


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
        found = by_content(RAY_FORMATS, path) or by_suffix(RAY_FORMATS, path)
        if found is None:
            raise RayFileError(
                f"{path.name} is no ray file that is known{of_other_program(path)}; they end in "
                f"{known_suffixes(RAY_FORMATS.kinds())}"
            )
        return found.read(path, flux_from)
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
    written = [kind for kind in RAY_FORMATS.kinds() if kind.writer is not None]
    found = by_suffix(RAY_FORMATS, path)
    if found is None or found.writer is None:
        raise RayFileError(f"ray files end in {known_suffixes(written)}, not {path.name!r}")
    refuse_existing(path, force=force)
    with replacing(path) as beside, beside.open("wb") as file:
        writer = found.writer(file, like, zemax_version)
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
