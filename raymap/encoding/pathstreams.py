"""The streams of which paths are made: read, checked against the directory, made into offsets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory
from raymap.model.errors import FormatError

__all__ = ["Bounds", "check_amounts", "check_itineraries", "offsets_from_counts"]

Reader = Callable[[str, "int | None", Any], NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Bounds:
    """How many of each kind the directory names; indices are checked against it once.

    Attributes
    ----------
    source, object, face, medium, detector : counts
    owner : (n_faces,) int16, object of each face
    """

    source: int
    object: int
    face: int
    medium: int
    detector: int
    owner: NDArray[np.int16]

    @staticmethod
    def of(directory: Directory) -> Bounds:
        return Bounds(
            len(directory.sources),
            len(directory.objects),
            len(directory.faces),
            len(directory.media),
            len(directory.detectors),
            directory.faces.object,
        )

    def check(self, name: str, column: NDArray[Any]) -> NDArray[Any]:
        """Refuse indices that the directory does not have."""
        count = getattr(self, name)
        least = 0 if name in ("source", "detector") else -1
        if len(column) and not least <= int(column.min()) <= int(column.max()) < count:
            raise FormatError(f"a path names a {name} that the directory does not have")
        return column

    def check_faces(self, objects: NDArray[Any], faces: NDArray[Any]) -> None:
        """Refuse faces of another object than the one met; both are within the directory."""
        if not len(self.owner):
            return
        on_face = faces >= 0
        if (on_face & (self.owner[faces] != objects)).any():
            raise FormatError("a path names a face that its object does not have")


class CheckedPaths(NamedTuple):
    """Checked paths: every length fits the columns, every index the directory.

    Attributes
    ----------
    source, offsets, object, face, event, medium, detector_offsets, detector, registered : as in
        `raymap.encoding.paths.PathDictionary`
    """

    source: NDArray[np.int16]
    offsets: NDArray[np.int64]
    object: NDArray[np.int16]
    face: NDArray[np.int32]
    event: NDArray[np.int32]
    medium: NDArray[np.int16]
    detector_offsets: NDArray[np.int64]
    detector: NDArray[np.int16]
    registered: NDArray[np.bool_]

    @property
    def n_points(self) -> int:
        return int(self.offsets[-1])

    @property
    def n_crossings(self) -> int:
        return int(self.detector_offsets[-1])


def offsets_from_counts(counts: NDArray[Any], total: int | None, what: str) -> NDArray[np.int64]:
    """Running sum with a leading zero; the end must be ``total``."""
    offsets = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    # Counts of 32 bits and at most 2^31 rows: the sum cannot wrap around
    if total is not None and int(offsets[-1]) != total:
        raise FormatError(f"{what} add up to {int(offsets[-1])}, not {total}")
    return offsets


def check_amounts(what: str, column: NDArray[Any]) -> NDArray[Any]:
    """Refuse weights and sums of weights that are negative or no numbers.

    Raises
    ------
    FormatError
    """
    if column.size and not 0.0 <= float(column.min()) <= float(column.max()) < np.inf:
        raise FormatError(f"{what} are negative or not finite")
    return column


def check_itineraries(read: Reader, n_paths: int, bounds: Bounds) -> CheckedPaths:
    """Offsets, points and crossings of a path dictionary.

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
    bounds.check_faces(columns["object"], columns["face"])
    crossings = read("meetings", n_points, np.uint16)
    columns["detector_offsets"] = offsets_from_counts(crossings, None, "crossings of paths")
    n_crossings = int(columns["detector_offsets"][-1])
    columns["detector"] = bounds.check("detector", read("detector", n_crossings, np.int16))
    columns["registered"] = read("registered", n_crossings, np.bool_)
    return CheckedPaths(**columns)
