"""Files that clients put into the served folder: scenes, meshes, CAD, tables; bounded."""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import Any

from raymap.model.errors import MapExists, RayMapError
from service.answers.requests import BadRequest, Request
from service.files.confine import OutsideFolder, ServedFolder
from service.files.disk import Disk

__all__ = ["KINDS", "take_file"]

KINDS = (
    ".toml", ".csv", ".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".step", ".stp",
    ".iges", ".igs", ".brep", ".zmx", ".seq", ".agf", ".ies", ".ldt", ".png", ".tm25ray", ".dat",
    ".sdf",
)  # fmt: skip


def take_file(request: Request, folder: ServedFolder, disk: Disk, reader: Any) -> Path:
    """Write an uploaded file: all binary values of the stream's first column, one after the other.

    Raises
    ------
    OutsideFolder, BadRequest, MapExists
    RayMapError
        It is too large.
    """
    name, force = request.text("file"), request.flag("force")
    request.finish()
    target = folder.path(name)
    if target.suffix.lower() not in KINDS:
        raise BadRequest(f"upload: {name!r} is not of a kind that scenes use ({' '.join(KINDS)})")
    if target.exists() and not (force and target.is_file()):
        raise MapExists(f"upload: {name!r} exists and stays as it is; 'force' replaces it")
    beside = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    try:
        missing = folder.missing(target.parent)
        disk.check("upload", folders=len(missing))
        # Links that appear meanwhile lead nowhere: all is done in the folder that is held
        with (
            folder.holding(target.parent, make=True) as held,
            disk.writing(beside, target, keeps=False, folders=missing),
        ):
            try:
                with os.fdopen(held.create(beside.name), "wb") as file:
                    _write(request, name, disk, reader, file)
                held.replace(beside.name, target.name)
            finally:
                held.remove(beside.name)
    except OutsideFolder:
        raise
    except OSError as error:
        raise RayMapError(f"upload: {name!r} cannot be written: {error.strerror}") from None
    return target


def _write(request: Request, name: str, disk: Disk, reader: Any, file: Any) -> None:
    """Take the values of the stream's first column, as far as there is room."""
    most, size = request.limits.upload_bytes, 0
    for chunk in reader:
        if chunk.data is None or not chunk.data.num_columns:
            continue
        for value in chunk.data.column(0).to_pylist():
            if not isinstance(value, bytes):
                raise BadRequest("upload: the first column must be binary")
            size += len(value)
            if size > most:
                raise RayMapError(f"upload: {name!r} has more than the {most} bytes that are taken")
            disk.check("upload", len(value))
            file.write(value)
