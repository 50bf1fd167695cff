"""Formats of CAD files, by suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from raymap.model.errors import SceneError
from raymap.model.fileformat import (
    FileFormat,
    by_content,
    by_suffix,
    known_suffixes,
    suffixes_of,
)
from raymap.model.registry import Registry
from tracer.importers.cad_solid import CadSolid

__all__ = ["CAD_FORMATS", "CadFormat", "read_cad"]


@dataclass(frozen=True, kw_only=True)
class CadFormat(FileFormat):
    """Files of solids.

    Attributes
    ----------
    read : the solids of a file, in millimetres whatever its unit, with unique names; raises
        `SceneError` with place and remedy
    """

    read: Callable[[str | Path], tuple[CadSolid, ...]]


CAD_FORMATS: Registry[CadFormat] = Registry(
    "tracer.cad_formats",
    "tracer.importers.cad_formats",
    words=suffixes_of,
    of=CadFormat,
    sort="files of solids, for [cad_files]",
)
"""Formats by suffix."""


def read_cad(path: str | Path) -> tuple[CadSolid, ...]:
    """The solids of a CAD file, known by its suffix, else by its first bytes.

    Raises
    ------
    SceneError
        There is no such file, no format is known for it, or it cannot be used.
    """
    path = Path(path)
    found = by_suffix(CAD_FORMATS, path)
    if found is None and path.is_file():
        found = by_content(CAD_FORMATS, path)
    if found is None:
        raise SceneError(
            f"{path.name}: no CAD file that is understood; such files may end in "
            f"{known_suffixes(CAD_FORMATS.kinds())}"
        )
    return found.read(path)
