"""Triangles of glTF and GLB, with nodes and materials."""

from __future__ import annotations

import json
from pathlib import Path

from raymap.model.errors import SceneError
from tracer.geometry.mesh_format import MeshArrays, MeshFormat
from tracer.geometry.trimesh_files import check_parts, read_with_trimesh

__all__ = ["KINDS"]

_ZEROS = 2**20
"""Rows of a table of a glTF file that has no bytes."""


def _read(file: Path, where: str) -> MeshArrays:
    _check(file, where)
    # Nothing looks at textures, whose pixels may be many
    return read_with_trimesh(file, where, skip_materials=True)


def _check(file: Path, where: str) -> None:
    """Refuse a glTF file that claims more than its bytes can pay for, before trimesh reads it.

    Tables without bytes are zeros, which trimesh makes before it looks at anything else. Nodes that
    stand below several others, which the standard forbids, are placed as often as there are ways to
    them.
    """
    data = file.read_bytes()
    try:
        if data[:4] == b"glTF":
            length = int.from_bytes(data[12:16], "little")
            data = data[20 : 20 + length]
        described = json.loads(data)
        views = [int(view.get("byteLength", 0)) for view in described.get("bufferViews", [])]
        for accessor in described.get("accessors", []):
            rows, place = int(accessor.get("count", 0)), accessor.get("bufferView")
            limit = _ZEROS if place is None else views[place]
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
    except (ValueError, TypeError, AttributeError, LookupError, RecursionError) as error:
        raise SceneError(
            f"{where}: {file.name} cannot be read as a mesh (its glTF description: {error})"
        ) from None


KINDS = (
    MeshFormat(
        suffixes=(".gltf", ".glb"),
        title="triangles of glTF and GLB, with nodes and materials",
        place=50,
        sniff=lambda head: head.startswith(b"glTF"),
        read=_read,
    ),
)
