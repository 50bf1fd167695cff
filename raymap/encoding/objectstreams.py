"""The objects of a scene in a map: a few columns, however many objects there are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.streams import StreamSet
from raymap.model.errors import FormatError, LimitExceeded
from raymap.model.jsontext import parse_json, write_json
from raymap.model.limits import MAX_INDEX, MAX_NAME, MAX_PRIMITIVES
from raymap.model.plaintext import plain_text
from raymap.model.sceneobjects import NO_QUADRIC, Further, ObjectColumns
from raymap.model.schema import NONE

__all__ = ["ColumnReader", "add_objects", "read_objects"]


class ColumnReader(Protocol):
    """Gives what a chunk holds under a name."""

    def text(self, name: str) -> bytes | None:
        """Opaque bytes; None where there are none."""

    def column(
        self, name: str, rows: int | None, dtype: Any, *, matrix: bool = False
    ) -> NDArray[Any]:
        """A column of numbers; one that is not there has no rows."""


def add_objects(streams: StreamSet, columns: ObjectColumns) -> None:
    """Store the objects.

    Raises
    ------
    LimitExceeded
        A name cannot be read again: an object was changed without being checked.
    """
    if not columns.names:
        return
    distinct = list(dict.fromkeys(columns.face_names))
    for names in (columns.names, distinct):
        if not all(0 < len(name) <= MAX_NAME for name in names):
            raise LimitExceeded(
                "the directory cannot be read again: names of objects and faces have 1 to "
                f"{MAX_NAME} characters"
            )
    number = {name: k for k, name in enumerate(distinct)}
    _add_json(streams, "object.names", list(columns.names))
    streams.add_smallest("object.faces", np.diff(columns.first_face).astype(np.uint32))
    _add_json(streams, "face.names", distinct)
    numbers = np.array([number[name] for name in columns.face_names], np.uint32)
    streams.add_smallest("face.name", numbers)
    streams.add_smallest("face.primitives", columns.primitive_count.astype(np.uint32))
    streams.add_smallest("face.surface", columns.surface)
    streams.add_smallest("face.shapes", np.diff(columns.first_shape).astype(np.uint32))
    streams.add_smallest("shape.axis", columns.axis)
    streams.add_smallest("shape.quadric", columns.coefficients)
    for name, further in (
        ("object.further", columns.of_objects),
        ("face.further", columns.of_faces),
        ("shape.further", columns.of_shapes),
    ):
        _add_json(streams, name, [[row, keys] for row, keys in further.rows.items()])


def _add_json(streams: StreamSet, name: str, value: list[Any]) -> None:
    if value:
        streams.add_bytes(name, write_json(value, f"the directory's {name!r}"))


def read_objects(read: ColumnReader) -> ObjectColumns:
    """The objects, checked.

    Raises
    ------
    FormatError
        Damage, or columns that contradict each other.
    """
    names = _names(read, "object.names", MAX_INDEX)
    n = len(names)
    first_face = _starts(read.column("object.faces", n, np.uint32), MAX_PRIMITIVES, "faces")
    n_faces = int(first_face[-1])
    distinct = _names(read, "face.names", n_faces)
    name = read.column("face.name", n_faces, np.uint32)
    if n_faces and int(name.max()) >= len(distinct):
        raise FormatError("a face has no name")
    owner = np.repeat(np.arange(n, dtype=np.int64), np.diff(first_face))
    pairs = np.sort(owner * max(1, len(distinct)) + name)
    if (pairs[1:] == pairs[:-1]).any():
        raise FormatError("an object has two faces of one name")
    count = read.column("face.primitives", n_faces, np.uint32).astype(np.int64)
    ends = np.zeros(n_faces + 1, np.int64)
    np.cumsum(count, out=ends[1:])
    per_object = np.diff(ends[first_face])
    if n_faces and (int(count.min()) < 1 or int(per_object.max()) > MAX_PRIMITIVES):
        raise FormatError("faces have impossible numbers of primitives")
    first_primitive = ends[:-1] - ends[first_face[:-1]][owner]
    shapes = read.column("face.shapes", n_faces, np.uint32)
    first_shape = _starts(shapes, 2**40, "shapes")
    if ((shapes != 0) & (shapes != count)).any():
        raise FormatError("a face has another number of shapes than of primitives")
    n_shapes = int(first_shape[-1])
    axis = read.column("shape.axis", n_shapes, np.int8)
    if n_shapes and not NO_QUADRIC <= int(axis.min()) <= int(axis.max()) <= 2:
        raise FormatError("a shape names a coordinate that does not exist")
    n_quadrics = int((axis != NO_QUADRIC).sum())
    coefficients = read.column("shape.quadric", n_quadrics, np.float64, matrix=True)
    if coefficients.size != 10 * n_quadrics or not np.isfinite(coefficients).all():
        raise FormatError("quadrics are not sound")
    surface = read.column("face.surface", n_faces, np.int16)
    if n_faces and int(surface.min()) < NONE:
        raise FormatError("a face names an impossible surface")
    return ObjectColumns(
        names=tuple(names),
        first_face=first_face.astype(np.int32),
        face_names=tuple(distinct[k] for k in name.tolist()),
        first_primitive=first_primitive.astype(np.int32),
        primitive_count=count.astype(np.int32),
        surface=surface,
        first_shape=first_shape,
        axis=axis,
        coefficients=coefficients.reshape(-1, 10),
        of_objects=_further(
            read, "object.further", n, {"kind": _is_text, "parameters": _is_keys}, _OF_OBJECTS
        ),
        of_faces=_further(
            read,
            "face.further",
            n_faces,
            {"aliases": _are_texts, "parameters": _is_keys},
            _OF_FACES,
        ),
        of_shapes=_further(read, "shape.further", n_shapes, {}, _OF_SHAPES),
    )


def _names(read: ColumnReader, name: str, most: int) -> list[str]:
    data = read.text(name)
    given = [] if data is None else parse_json(data, list, f"stream {name!r}")
    names = [plain_text(each) for each in given if isinstance(each, str)]
    sound = len(names) == len(given) <= most and all(0 < len(each) <= MAX_NAME for each in names)
    if not sound or len(set(names)) != len(names):
        raise FormatError(f"stream {name!r} holds no sound names")
    return names


def _starts(counts: NDArray[Any], most: int, what: str) -> NDArray[np.int64]:
    starts = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=starts[1:], dtype=np.int64)
    if int(starts[-1]) > most:
        raise FormatError(f"the directory declares {int(starts[-1])} {what}")
    return starts


def _further(
    read: ColumnReader,
    name: str,
    rows: int,
    known: Mapping[str, Callable[[Any], bool]],
    elsewhere: set[str],
) -> Further:
    """Further keys by row; those that are known must have their types."""
    data = read.text(name)
    return Further(lambda: _parsed(data, name, rows, known, elsewhere))


def _parsed(
    data: bytes | None,
    name: str,
    rows: int,
    known: Mapping[str, Callable[[Any], bool]],
    elsewhere: set[str],
) -> dict[int, dict[str, Any]]:
    pairs = [] if data is None else parse_json(data, list, f"stream {name!r}")
    found: dict[int, dict[str, Any]] = {}
    for pair in pairs:
        sound = (
            isinstance(pair, list)
            and len(pair) == 2
            and type(pair[0]) is int
            and 0 <= pair[0] < rows
            and _is_keys(pair[1])
            and all(known[key](value) for key, value in pair[1].items() if key in known)
            and not pair[1].keys() & elsewhere
        )
        if not sound:
            raise FormatError(f"stream {name!r} is not sound")
        if "kind" in known and "kind" in pair[1]:
            pair[1]["kind"] = plain_text(pair[1]["kind"])
        found[pair[0]] = pair[1]
    return found


_OF_OBJECTS = {"name", "faces"}
_OF_FACES = {"name", "first_primitive", "primitive_count", "surface", "quadrics"}
_OF_SHAPES = {"coefficients", "solve_axis"}
"""Keys that columns hold."""


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_keys(value: Any) -> bool:
    return isinstance(value, dict)


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)
