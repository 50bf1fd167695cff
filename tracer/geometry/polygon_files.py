"""Mesh files with polygons, rewritten so that concave ones are triangles.

The reader behind cuts every polygon as a fan about its first corner, which covers places outside of
concave ones. OBJ, OFF and PLY have polygons; files without concave ones are left as they are.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.polygons import crosses_itself, cut_ears, is_convex

__all__ = ["UncutPolygons", "with_triangles"]

Array = NDArray[np.float64]

_MOST = 5_000
"""Corners of a concave polygon that is cut; the work grows with their square."""

_LINES = re.compile(rb"\\\r?\n")
_POLYGON = re.compile(rb"(?m)^[ \t]*f(?:[ \t]+\S+){4}")


class UncutPolygons(UserWarning):
    """Polygons of a mesh file are cut as fans though that may be wrong."""


@dataclass
class _Cutter:
    """Cuts polygons and counts those that cannot be cut."""

    crossed: int = 0
    large: int = 0
    changed: bool = False

    def triangles(self, points: Array) -> NDArray[np.int64] | None:
        """Triangles of a polygon; None where the fan is right, or nothing is."""
        if len(points) < 4 or not np.all(np.isfinite(points)) or is_convex(points):
            return None
        if len(points) > _MOST:
            self.large += 1
            return None
        if crosses_itself(points):
            self.crossed += 1
            return None
        found = cut_ears(points)
        self.changed |= found is not None
        return found


def with_triangles(data: bytes, suffix: str, name: str) -> bytes:
    """The bytes of a mesh file with concave polygons as triangles.

    Parameters
    ----------
    suffix : of the file's name, with the dot
    name : of the file, for warnings

    Warns
    -----
    UncutPolygons
        where a polygon crosses itself or has too many corners; it is left as it is
    """
    read = _READERS.get(suffix.lower())
    if read is None:
        return data
    cutter = _Cutter()
    try:
        changed = read(data, cutter)
    except (ValueError, LookupError, TypeError):
        # The reader behind says what is wrong with the file
        return data
    for count, what in (
        (cutter.crossed, "cross themselves"),
        (cutter.large, f"are concave and have over {_MOST} corners"),
    ):
        if count:
            warnings.warn(
                f"{name}: {count} polygons {what}; they are cut as fans about their first corners, "
                "and what they cover is a guess: mend them in the program that wrote the file",
                UncutPolygons,
                stacklevel=2,
            )
    return changed if cutter.changed else data


def _obj(data: bytes, cutter: _Cutter) -> bytes:
    joined = _LINES.sub(b" ", data)
    if not _POLYGON.search(joined):
        return data
    points: list[tuple[float, ...]] = []
    out = []
    for line in joined.split(b"\n"):
        words = line.split()
        if words and words[0] == b"v":
            points.append(tuple(map(float, words[1:4])))
        elif words and words[0] == b"f" and len(words) > 4:
            corners = words[1:]
            numbers = [int(word.split(b"/")[0]) for word in corners]
            places = [number - 1 if number > 0 else len(points) + number for number in numbers]
            cut = cutter.triangles(np.array([points[k] for k in places]))
            if cut is not None:
                # Counted from the end, as they may be, numbers stay what they are at this line
                out += [b"f " + b" ".join(corners[k] for k in row) for row in cut.tolist()]
                continue
        out.append(line)
    return b"\n".join(out)


def _off(data: bytes, cutter: _Cutter) -> bytes:
    lines = [line.split(b"#")[0].split() for line in data.splitlines()]
    lines = [words for words in lines if words]
    if lines[0][0].upper() != b"OFF":
        return data
    head = lines[0][1:] if len(lines[0]) > 1 else lines[1]
    start = 1 if len(lines[0]) > 1 else 2
    n_points, n_faces = int(head[0]), int(head[1])
    rows = lines[start : start + n_points]
    points = np.array([[float(word) for word in row[:3]] for row in rows])
    faces = []
    for row in lines[start + n_points : start + n_points + n_faces]:
        n = int(row[0])
        corners, rest = row[1 : n + 1], row[n + 1 :]
        cut = cutter.triangles(points[[int(word) for word in corners]])
        pieces = [range(n)] if cut is None else cut.tolist()
        faces += [[b"%d" % len(p), *(corners[k] for k in p), *rest] for p in pieces]
    text = [[b"OFF"], [b"%d" % n_points, b"%d" % len(faces), b"0"], *rows, *faces]
    return b"\n".join(b" ".join(words) for words in text) + b"\n"


_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_HEAD_END = re.compile(rb"end_header\r?\n")


class _PlyHead(NamedTuple):
    """What a PLY file says of its vertices and faces."""

    order: str
    vertices: np.dtype[Any]
    n_vertices: int
    counts: np.dtype[Any]
    corners: np.dtype[Any]
    n_faces: int
    rest: int
    """Bytes of a face after its corners."""


def _ply(data: bytes, cutter: _Cutter) -> bytes:
    end = _HEAD_END.search(data)
    head = None if end is None else _ply_head(data[: end.end()].decode("ascii", "replace"))
    if end is None or head is None:
        return data
    cut = _ply_rows if head.order else _ply_lines
    faces, count = cut(data[end.end() :], head, cutter)
    text = re.sub(rb"(?m)^(element\s+face\s+)\d+", rb"\g<1>%d" % count, data[: end.end()])
    return text + faces


def _ply_head(text: str) -> _PlyHead | None:
    """None where faces have no corners in front, or vertices are no rows of numbers."""
    order, tables = "", dict[str, tuple[int, list[list[str]]]]()
    for words in map(str.split, text.splitlines()):
        if words[:1] == ["format"]:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"]:
            tables[words[1]] = int(words[2]), []
        elif words[:1] == ["property"]:
            tables[list(tables)[-1]][1].append(words[1:])
    if list(tables)[:2] != ["vertex", "face"]:
        return None
    (n_vertices, columns), (n_faces, corners) = tables["vertex"], tables["face"]
    first, others = corners[0], corners[1:]
    if first[0] != "list" or any(words[0] == "list" for words in columns + others):
        return None
    return _PlyHead(
        order=order,
        vertices=np.dtype([(words[1], order + _TYPES[words[0]]) for words in columns]),
        n_vertices=n_vertices,
        counts=np.dtype(order + _TYPES[first[1]]),
        corners=np.dtype(order + _TYPES[first[2]]),
        n_faces=n_faces,
        rest=sum(np.dtype(_TYPES[words[0]]).itemsize for words in others),
    )


def _ply_lines(body: bytes, head: _PlyHead, cutter: _Cutter) -> tuple[bytes, int]:
    lines = body.splitlines(keepends=True)
    places = [(head.vertices.names or ()).index(axis) for axis in "xyz"]
    n, end = head.n_vertices, head.n_vertices + head.n_faces
    rows = (line.split() for line in lines[:n])
    points = np.array([[float(row[k]) for k in places] for row in rows])
    faces = []
    for line in lines[n:end]:
        words = line.split()
        corners, rest = words[1 : int(words[0]) + 1], words[int(words[0]) + 1 :]
        cut = cutter.triangles(points[[int(word) for word in corners]])
        if cut is None:
            faces.append(line)
            continue
        rows = ([b"3", *(corners[k] for k in row), *rest] for row in cut.tolist())
        faces += [b" ".join(row) + b"\n" for row in rows]
    return b"".join([*lines[:n], *faces, *lines[end:]]), len(faces)


def _ply_rows(body: bytes, head: _PlyHead, cutter: _Cutter) -> tuple[bytes, int]:
    start = head.n_vertices * head.vertices.itemsize
    triangle = head.counts.itemsize + 3 * head.corners.itemsize + head.rest
    if len(body) == start + head.n_faces * triangle:
        return body, head.n_faces
    table = np.frombuffer(body, head.vertices, head.n_vertices)
    points = np.column_stack([table[axis].astype(float) for axis in "xyz"])
    three = np.array(3, head.counts).tobytes()
    # The reader behind wants equally many corners in all faces of binary files
    cutter.changed = True
    faces, at = [], start
    for _ in range(head.n_faces):
        n = int(np.frombuffer(body, head.counts, 1, at)[0])
        middle = at + head.counts.itemsize
        end = middle + n * head.corners.itemsize
        corners = np.frombuffer(body, head.corners, n, middle)
        cut = cutter.triangles(points[corners])
        rest = body[end : end + head.rest]
        if cut is None:
            cut = np.array([(0, k, k + 1) for k in range(1, n - 1)], np.int64).reshape(-1, 3)
        faces += [three + corners[row].tobytes() + rest for row in cut]
        at = end + head.rest
    return b"".join([body[:start], *faces, body[at:]]), len(faces)


_READERS = {".obj": _obj, ".off": _off, ".ply": _ply}
