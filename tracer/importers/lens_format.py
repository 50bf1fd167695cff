"""Formats of lens files, by suffix."""

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
from tracer.importers.prescription import Prescription

__all__ = ["LENS_FORMATS", "LensFormat", "read_prescription"]


@dataclass(frozen=True, kw_only=True)
class LensFormat(FileFormat):
    """Files of lenses.

    Attributes
    ----------
    read : the lens of a file; raises `SceneError` naming line and remedy. None: such files are
        known, and refused
    remedy : of refused files, what to do in the program that wrote them
    """

    read: Callable[[Path], Prescription] | None = None
    remedy: str = ""


LENS_FORMATS: Registry[LensFormat] = Registry(
    "tracer.lens_formats",
    "tracer.importers.lens_formats",
    words=suffixes_of,
    of=LensFormat,
    sort="files of lenses",
)
"""Formats by suffix, those that are refused too."""


def read_prescription(path: str | Path) -> Prescription:
    """The lens of a file, known by its suffix, else by its first bytes.

    Raises
    ------
    SceneError
        for an unknown format, or a file that its reader refuses
    """
    path = Path(path)
    found = by_suffix(LENS_FORMATS, path)
    if found is None and path.is_file():
        found = by_content(LENS_FORMATS, path)
    if found is None:
        known = known_suffixes(kind for kind in LENS_FORMATS.kinds() if kind.read is not None)
        raise SceneError(f"{path.name}: no lens file ({known} are understood)")
    if found.read is None:
        raise SceneError(f"{path.name}: is {found.title}; {found.remedy}")
    return found.read(path)
