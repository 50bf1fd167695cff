"""Files in which other programs keep every ray that they traced, by suffix."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from raymap.foreign.recorded import RecordedFormat
from raymap.model.errors import RayMapError
from raymap.model.fileformat import by_content, by_suffix, known_suffixes, suffixes_of
from raymap.model.givenfile import check_given
from raymap.model.registry import Registry

__all__ = ["RECORDED_FORMATS", "import_recorded"]

RECORDED_FORMATS: Registry[RecordedFormat] = Registry(
    "raymap.recorded_formats",
    "raymap.foreign",
    words=suffixes_of,
    of=RecordedFormat,
    sort="files of rays that other programs traced",
)
"""Formats by suffix."""


def import_recorded(
    source: str | os.PathLike[str], path: str | os.PathLike[str], **options: Any
) -> dict[str, int]:
    """Write a ray map of what another program recorded; options and counts are those of its format.

    Raises
    ------
    RayMapError
        No format is known for the file, or it cannot be used.
    """
    source = Path(source)
    found = by_suffix(RECORDED_FORMATS, source)
    if found is None:
        check_given(source, "file of rays", RayMapError)
        found = by_content(RECORDED_FORMATS, source)
    if found is None:
        raise RayMapError(
            f"{source.name}: is no file of traced rays that is known; known formats are "
            f"{known_suffixes(RECORDED_FORMATS.kinds())}; rays of programs with a Python interface "
            "are recorded with raymap.foreign.recorder; lens files are scenes (raymap check, "
            "record), CAD and light files parts of one, ray files are for raymap check-rays"
        )
    return found.write_map(source, path, **options)
