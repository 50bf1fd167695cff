"""The streams of which paths are made: read, checked against the directory, made into offsets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.directory import Directory
from raymap.errors import FormatError

__all__ = ["Bounds", "check_itineraries", "offsets_from_counts"]

Reader = Callable[[str, "int | None", Any], NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Bounds:
    """How many of each kind the directory names; indices are checked against it once."""

    source: int
    object: int
    face: int
    medium: int
    detector: int

    @staticmethod
    def of(directory: Directory) -> Bounds:
        return Bounds(
            len(directory.sources),
            len(directory.objects),
            len(directory.faces.names),
            len(directory.media),
            len(directory.detectors),
        )

    def check(self, name: str, column: NDArray[Any]) -> NDArray[Any]:
        """Refuse indices that the directory does not have."""
        count = getattr(self, name)
        least = 0 if name in ("source", "detector") else -1
        if len(column) and not least <= int(column.min()) <= int(column.max()) < count:
            raise FormatError(f"a path names a {name} that the directory does not have")
        return column


def offsets_from_counts(counts: NDArray[Any], total: int | None, what: str) -> NDArray[np.int64]:
    """Running sum with a leading zero; the end must be ``total``."""
    offsets = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    if total is not None and int(offsets[-1]) != total:
        raise FormatError(f"{what} add up to {int(offsets[-1])}, not {total}")
    return offsets


def check_itineraries(read: Reader, n_paths: int, bounds: Bounds) -> dict[str, NDArray[Any]]:
    """Offsets, points and meetings of a path dictionary.

    Parameters
    ----------
    read : (name, rows, dtype) -> column

    Raises
    ------
    FormatError
        Lengths contradict each other or the directory does not have an index.
    """
    lengths = read("length", n_paths, np.uint32)
    if n_paths and not lengths.all():
        raise FormatError("a path has no points")
    offsets = offsets_from_counts(lengths, None, "points of paths")
    n_points = int(offsets[-1])
    source = bounds.check("source", read("source", n_paths, np.int16))
    columns: dict[str, NDArray[Any]] = {"source": source, "offsets": offsets}
    for name, dtype in (
        ("object", np.int16),
        ("face", np.int32),
        ("event", np.int32),
        ("medium", np.int16),
    ):
        column = read(name, n_points, dtype)
        columns[name] = column if name == "event" else bounds.check(name, column)
    meetings = read("meetings", n_points, np.uint16)
    columns["detector_offsets"] = offsets_from_counts(meetings, None, "meetings of paths")
    n_meetings = int(columns["detector_offsets"][-1])
    columns["detector"] = bounds.check("detector", read("detector", n_meetings, np.int16))
    columns["registered"] = read("registered", n_meetings, np.bool_)
    return columns
