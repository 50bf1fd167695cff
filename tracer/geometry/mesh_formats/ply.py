"""Polygons of PLY, with colours."""

from __future__ import annotations

from functools import partial

from tracer.geometry.mesh_format import MeshFormat
from tracer.geometry.trimesh_files import read_with_trimesh

__all__ = ["KINDS"]

KINDS = (
    MeshFormat(
        suffixes=(".ply",),
        title="polygons of PLY, with colours",
        place=30,
        read=partial(read_with_trimesh, named_by_file=True),
    ),
)
