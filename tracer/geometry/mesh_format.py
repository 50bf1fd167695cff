"""Formats of mesh files, by suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.model.fileformat import FileFormat, suffixes_of
from raymap.model.registry import Registry

__all__ = ["MESH_FORMATS", "MeshArrays", "MeshFormat"]


class MeshArrays(NamedTuple):
    """What a mesh file holds.

    Attributes
    ----------
    vertices : (n, 3) float64 in the unit of the file
    triangles : (m, 3) int64, rows of vertices
    groups : m names of the parts of the file that the triangles belong to
    colors : (m, 4) uint8, None where the file has none
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    groups: list[str]
    colors: NDArray[np.uint8] | None


@dataclass(frozen=True, kw_only=True)
class MeshFormat(FileFormat):
    """Files of triangles.

    Attributes
    ----------
    read : what a file holds; takes the body too, as messages begin ("mesh 'lamp'"); raises
        `SceneError`
    """

    read: Callable[[Path, str], MeshArrays]


MESH_FORMATS: Registry[MeshFormat] = Registry(
    "tracer.mesh_formats",
    "tracer.geometry.mesh_formats",
    words=suffixes_of,
    of=MeshFormat,
    sort="files of triangles, for bodies of the kind mesh",
)
"""Formats by suffix. Archives and XML (3MF, COLLADA, ZAE, …) are left out: they are unpacked."""
