"""Triangles of STL, binary or text."""

from __future__ import annotations

from pathlib import Path

from tracer.geometry.mesh_format import MeshArrays, MeshFormat
from tracer.geometry.trimesh_files import check_parts, read_with_trimesh

__all__ = ["KINDS"]


def _read(file: Path, where: str) -> MeshArrays:
    with file.open("rb") as lines:
        if lines.read(5).lower() == b"solid":
            lines.seek(0)
            check_parts(file, where, sum(line.lstrip().startswith(b"solid") for line in lines))
    return read_with_trimesh(file, where, named_by_file=True)


KINDS = (
    MeshFormat(
        suffixes=(".stl",),
        title="triangles of STL, binary or text",
        place=10,
        read=_read,
    ),
)
