"""Triangles of STL, binary or text."""

from __future__ import annotations

from functools import partial

from tracer.geometry.mesh_format import MeshFormat
from tracer.geometry.trimesh_files import read_with_trimesh

__all__ = ["KINDS"]

KINDS = (
    MeshFormat(
        suffixes=(".stl",),
        title="triangles of STL, binary or text",
        place=10,
        read=partial(read_with_trimesh, named_by_file=True),
    ),
)
