"""Load meshes from files, whatever their format (`tracer.geometry.mesh_formats`)."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.fileformat import by_content, by_suffix, known_suffixes
from raymap.model.givenfile import check_given, not_readable
from tracer.geometry.mesh import (
    MeshWarning,
    TriangleMesh,
    faces_by_angle,
    make_mesh,
    smooth_normals,
)
from tracer.geometry.mesh_format import MESH_FORMATS, MeshArrays
from tracer.geometry.mesh_scene import count_crossing_edges

__all__ = ["FaceRule", "load_mesh", "triangles_of"]

FaceRule = Literal["one", "group", "color", "angle"]

CROSSINGS_UP_TO = 300_000
"""Larger meshes are not searched for self-intersections when they are loaded."""


def load_mesh(
    path: str | Path,
    *,
    name: str | None = None,
    scale: float = 1.0,
    faces: FaceRule = "group",
    angle_deg: float = 30.0,
    smooth_deg: float | None = None,
    solid: bool = True,
    flip: bool = False,
) -> TriangleMesh:
    """Read a mesh file and name its faces.

    Parameters
    ----------
    path : STL, OBJ, PLY, glTF or GLB file
    name : of the body; the file's name by default
    scale : length of the file's unit in scene units (mesh files carry no unit)
    faces : "one" face for all triangles; one per "group" (object, node or material of the file);
        one per "color" of the triangles; or faces that end at edges sharper than ``angle_deg``
    smooth_deg : interpolate normals across edges flatter than this; None keeps flat triangles
    solid : the mesh must be closed
    flip : turn all triangles over

    Raises
    ------
    SceneError
        if the file cannot be read, or the mesh cannot be traced
    MissingExtra
        without the package trimesh
    """
    file = Path(path)
    body = name or file.stem
    if not np.isfinite(scale) or scale <= 0.0:
        raise SceneError(f"mesh {body!r}: the scale must be positive, got {scale:g}")
    vertices, triangles, groups, colors = _read(file, body)
    labels: list[str] | None = None
    if faces == "group":
        labels = groups
    elif faces == "color":
        if colors is None:
            raise SceneError(
                f"mesh {body!r}: {file.name} has no colours of triangles; name faces by "
                '"group" or "angle"'
            )
        labels = ["#{:02x}{:02x}{:02x}".format(*row[:3]) for row in colors.tolist()]
    mesh = make_mesh(vertices * scale, triangles, name=body, labels=labels, solid=solid, flip=flip)
    if faces == "angle":
        mesh = faces_by_angle(mesh, angle_deg)
    if smooth_deg is not None:
        mesh = smooth_normals(mesh, smooth_deg)
    if solid and len(mesh.triangles) <= CROSSINGS_UP_TO:
        crossing = count_crossing_edges(mesh)
        if crossing:
            warnings.warn(
                f"mesh {body!r}: {crossing} edges run through triangles elsewhere: it intersects "
                "itself, and light between may find itself in the wrong medium; join its parts in "
                "the program that wrote it",
                MeshWarning,
                stacklevel=2,
            )
    return mesh


def triangles_of(path: Path, scale: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (n, 3) [scene units] and triangles (m, 3) of a mesh file, closed or not.

    Parameters
    ----------
    scale : length of the file's unit in scene units

    Raises
    ------
    SceneError, MissingExtra
    """
    mesh = load_mesh(path, scale=scale, faces="one", solid=False)
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.triangles, np.int64)


def _read(file: Path, body: str) -> MeshArrays:
    """What the format of a file reads from it."""
    where = f"mesh {body!r}"
    try:
        check_given(file, "mesh file", SceneError)
        found = by_suffix(MESH_FORMATS, file) or by_content(MESH_FORMATS, file)
    except SceneError as error:
        raise SceneError(f"{where}: {error}") from None
    except OSError as error:
        raise SceneError(f"{where}: {not_readable(file, 'mesh file', error)}") from None
    if file.suffix.lower() in (".step", ".stp"):
        raise SceneError(
            f"{where}: {file.name} holds solids, not triangles; name it in [cad_files]"
        )
    if found is None:
        raise SceneError(
            f"{where}: {file.name} is of a kind that is not read; files may end in "
            f"{known_suffixes(MESH_FORMATS.kinds())}"
        )
    return found.read(file, where)
