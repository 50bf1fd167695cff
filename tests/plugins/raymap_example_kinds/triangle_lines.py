"""Meshes as lines of nine numbers, the corners of one triangle each (``.tri``)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from raymap.model.errors import SceneError
from tracer.geometry.mesh_format import MeshArrays, MeshFormat

__all__ = ["FORMAT"]


def read(file: Path, where: str) -> MeshArrays:
    """The triangles of a file; corners in the same place are one vertex."""
    try:
        corners = np.loadtxt(file, ndmin=2).reshape(-1, 3)
    except ValueError as error:
        raise SceneError(f"{where}: {file.name}: {error}") from None
    vertices, rows = np.unique(corners, axis=0, return_inverse=True)
    triangles = rows.reshape(-1, 3).astype(np.int64)
    return MeshArrays(vertices, triangles, ["surface"] * len(triangles), None)


FORMAT = MeshFormat(suffixes=(".tri",), title="nine numbers a triangle", read=read)
