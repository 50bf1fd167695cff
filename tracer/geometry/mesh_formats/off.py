"""Polygons of OFF."""

from __future__ import annotations

from tracer.geometry.mesh_format import MeshFormat
from tracer.geometry.trimesh_files import read_with_trimesh

__all__ = ["KINDS"]

KINDS = (
    MeshFormat(
        suffixes=(".off",),
        title="polygons of OFF",
        place=40,
        read=read_with_trimesh,
    ),
)
