"""What a format of 3D files is, and those that there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from raymap.model.fileformat import FileFormat, suffixes_of
from raymap.model.registry import Registry
from viewer.export.content import Content

__all__ = ["EXPORT_FORMATS", "ExportFormat"]


@dataclass(frozen=True, kw_only=True)
class ExportFormat(FileFormat):
    """A format of 3D files that hold the rays of a selection and the scene.

    Attributes
    ----------
    write : writes everything to a path, a name beside the one that was asked for
    """

    write: Callable[[Content, Path], None]


EXPORT_FORMATS: Registry[ExportFormat] = Registry(
    "raymap.export_formats",
    "viewer.export",
    words=suffixes_of,
    of=ExportFormat,
    sort="formats of 3D files with rays",
)
