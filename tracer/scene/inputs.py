"""What a map says of the files and tables that its scene was made of."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from raymap.model.directory import InputFile
from tracer.scene.model import Scene

__all__ = ["file_hash", "inputs_of", "taking_part"]


def inputs_of(scene: Scene, compiled: Mapping[str, Path] | None = None) -> tuple[InputFile, ...]:
    """The files that a scene read, by their names in it; of absolute ones the last part alone.

    Parameters
    ----------
    compiled : files that were read while it was compiled, beside those of its description
    """
    files = {
        **{name: Path(path) for name, path in scene.files.items()},
        **(compiled or {}),
    }
    found: dict[str, InputFile] = {}
    for name, path in sorted(files.items()):
        shown = PurePath(name).name if PurePath(name).is_absolute() else PurePath(name).as_posix()
        if path.is_file():
            size, digest = path.stat().st_size, file_hash(path)
            found.setdefault(shown, InputFile(name=shown, bytes=size, sha256=digest))
    return tuple(found.values())


def file_hash(path: Path) -> str:
    """SHA-256 of a file, empty where it cannot be read (that of a source that is off)."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def taking_part(scene: Scene) -> dict[str, Any]:
    """Which simulation and variants of the scene's text this is; empty where it is the text."""
    given = scene.selecting.model_dump(mode="json", exclude_defaults=True)
    parameters: dict[str, Any] = {"simulation": given} if given else {}
    if scene.variants:
        parameters["variants"] = list(scene.variants)
    return parameters
