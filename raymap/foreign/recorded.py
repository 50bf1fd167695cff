"""What a format of recorded rays is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from raymap.model.fileformat import FileFormat

__all__ = ["RecordedFormat"]


@dataclass(frozen=True, kw_only=True)
class RecordedFormat(FileFormat):
    """Files in which another program keeps every ray that it traced.

    Attributes
    ----------
    write_map : writes a ray map of a file and returns counts, ``rays`` and ``records`` among them;
        takes file, map, and by keyword what such files may not say: ``names`` by number,
        ``length_unit``, ``flux_unit``, ``wavelength_nm``; and ``force`` to replace a map
    """

    write_map: Callable[..., dict[str, int]]
