"""Polygons of OBJ, with objects, groups and materials."""

from __future__ import annotations

from pathlib import Path

from tracer.geometry.mesh_format import MeshArrays, MeshFormat
from tracer.geometry.trimesh_files import check_parts, read_with_trimesh

__all__ = ["KINDS"]


def _read(file: Path, where: str) -> MeshArrays:
    check_parts(file, where, _parts(file))
    return read_with_trimesh(file, where, split_objects=True, split_groups=True)


def _parts(file: Path) -> int:
    """Objects, groups and uses of materials of an OBJ file."""
    with file.open("rb") as lines:
        return sum(line.lstrip().startswith((b"o ", b"g ", b"usemtl ")) for line in lines)


KINDS = (
    MeshFormat(
        suffixes=(".obj",),
        title="polygons of OBJ, with objects, groups and materials",
        place=20,
        read=_read,
    ),
)
