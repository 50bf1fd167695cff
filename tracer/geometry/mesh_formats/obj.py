"""Polygons of OBJ, with objects, groups and materials."""

from __future__ import annotations

from pathlib import Path

from tracer.geometry.mesh_format import MeshArrays, MeshFormat
from tracer.geometry.trimesh_files import check_parts, read_with_trimesh

__all__ = ["KINDS"]


def _read(file: Path, where: str) -> MeshArrays:
    count, materials = _named(file)
    check_parts(file, where, count)
    return read_with_trimesh(file, where, beside=materials, split_objects=True, split_groups=True)


def _named(file: Path) -> tuple[int, list[str]]:
    """How many objects, groups and uses of materials; the files with the materials."""
    count, materials = 0, dict[str, None]()
    with file.open("rb") as lines:
        for line in map(bytes.strip, lines):
            count += line.startswith((b"o ", b"g ", b"usemtl "))
            if line.startswith(b"mtllib"):
                materials[line[6:].strip().decode(errors="replace")] = None
    return count, list(materials)


KINDS = (
    MeshFormat(
        suffixes=(".obj",),
        title="polygons of OBJ, with objects, groups and materials",
        place=20,
        read=_read,
    ),
)
