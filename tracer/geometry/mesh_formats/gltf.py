"""Triangles of glTF and GLB, with nodes and materials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from raymap.model.errors import SceneError
from raymap.model.giventext import json_value
from tracer.description.named_files import named_file
from tracer.geometry.mesh_format import MeshArrays, MeshFormat
from tracer.geometry.trimesh_files import check_parts, read_with_trimesh

__all__ = ["KINDS"]

_ZEROS = 2**20
"""Rows of a table of a glTF file that has no bytes."""

_BUILT_FLOOR, _BUILT_PER_BYTE = 2**26, 64
"""Bytes that are built of any glTF file, and as many times its bytes."""

_ITEM_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_SEPARATE = (0, 1, 4)
"""Modes whose rows are not repeated: points, lines, triangles; strips and fans are."""

_KEPT_BYTES = 8
"""Of a number of a primitive: coordinates in float64, corners of triangles in int64."""


def _read(file: Path, where: str) -> MeshArrays:
    beside = _check(file, where)
    # Nothing looks at textures, whose pixels may be many
    return read_with_trimesh(file, where, beside=beside, skip_materials=True)


def _check(file: Path, where: str) -> list[str]:
    """Refuse a glTF file that claims more than its bytes can pay for, before trimesh reads it.

    What is paid for is the sum of everything that trimesh makes: pieces of buffers, tables,
    primitives from them, and placements of these. Tables without bytes are zeros; primitives may
    share a table, and tables the bytes of a buffer. Nodes that stand below several others, which
    the standard forbids, are placed as often as there are ways to them.

    Returns
    -------
    Names of the files with its buffers.
    """
    data = file.read_bytes()
    try:
        if data[:4] == b"glTF":
            length = int.from_bytes(data[12:16], "little")
            data = data[20 : 20 + length]
        described = json_value(data)
        views = [_count(view, "byteLength") for view in described.get("bufferViews", [])]
        for accessor in described.get("accessors", []):
            rows, view = _count(accessor, "count"), accessor.get("bufferView")
            limit = _ZEROS if view is None else views[view]
            if rows > limit:
                raise SceneError(
                    f"{where}: {file.name} claims a table of {rows} rows; its bytes hold at "
                    f"most {limit}"
                )
        nodes = described.get("nodes", [])
        meshes = [len(mesh.get("primitives", [])) for mesh in described.get("meshes", [])]
        placed = sum(meshes[node["mesh"]] for node in nodes if node.get("mesh") is not None)
        check_parts(file, where, len(nodes) + sum(meshes) + placed)
        below = [int(child) for node in nodes for child in node.get("children", [])]
        tops = [[int(node) for node in one.get("nodes", [])] for one in described.get("scenes", [])]
        if any(len({*below, *top}) != len(below) + len(top) for top in tops or [[]]):
            raise SceneError(
                f"{where}: {file.name} places a node below several others; glTF wants a tree"
            )
        beside = _buffer_files(described)
        own = file.stat().st_size + sum(_size(file.parent, name) for name in beside)
        total, limit = sum(views) + _built(described), max(_BUILT_FLOOR, _BUILT_PER_BYTE * own)
        if total > limit:
            raise SceneError(
                f"{where}: {file.name} makes {total} bytes of tables, primitives and placements "
                f"from its {own}; a file of its size may make {limit}; place copies in the scene"
            )
    except SceneError:
        raise
    except (ValueError, TypeError, AttributeError, LookupError, ArithmeticError) as error:
        raise SceneError(
            f"{where}: {file.name} cannot be read as a mesh (its glTF description: {error})"
        ) from None
    except RecursionError:
        raise SceneError(
            f"{where}: {file.name} cannot be read as a mesh (its description nests too deeply)"
        ) from None
    return beside


def _count(entry: dict[str, Any], key: str) -> int:
    number = int(entry.get(key, 0))
    if number < 0:
        raise ValueError(f"{key} is {number}")
    return number


def _built(described: dict[str, Any]) -> int:
    """Bytes of all tables, of the primitives that are made of them, and of their placements."""
    accessors = described.get("accessors", [])
    numbers: list[int] = [_count(each, "count") * _NUMBERS[each["type"]] for each in accessors]
    tables = sum(
        n * _ITEM_BYTES[each["componentType"]] for n, each in zip(numbers, accessors, strict=True)
    )
    meshes = [
        sum(_of_primitive(each, accessors, numbers) for each in mesh.get("primitives", []))
        for mesh in described.get("meshes", [])
    ]
    nodes = described.get("nodes", [])
    placed = sum(meshes[node["mesh"]] for node in nodes if node.get("mesh") is not None)
    return int(tables + sum(meshes) + placed)


def _of_primitive(
    primitive: dict[str, Any], accessors: list[dict[str, Any]], numbers: list[int]
) -> int:
    """Bytes of one primitive: its columns and the corners of its triangles."""
    columns = primitive.get("attributes", {})
    corners = primitive.get("indices", columns.get("POSITION"))
    rows = 0 if corners is None else _count(accessors[corners], "count")
    repeated = 1 if primitive.get("mode", 4) in _SEPARATE else 3
    own = sum(numbers[column] for column in columns.values())
    return _KEPT_BYTES * int(own + repeated * rows)


def _buffer_files(described: dict[str, Any]) -> list[str]:
    """Files beside it that hold its buffers, each once."""
    places = (buffer.get("uri") for buffer in described.get("buffers", []))
    # As trimesh tells them from bytes that stand in the text
    return list(dict.fromkeys(path for path in places if path and "base64," not in path))


def _size(folder: Path, name: str) -> int:
    """Bytes of a file beside it; whoever reads it says what is wrong with it."""
    try:
        return named_file(folder, name.strip()).stat().st_size
    except OSError:
        return 0


KINDS = (
    MeshFormat(
        suffixes=(".gltf", ".glb"),
        title="triangles of glTF and GLB, with nodes and materials",
        place=50,
        sniff=lambda head: head.startswith(b"glTF"),
        read=_read,
    ),
)
