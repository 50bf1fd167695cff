"""Display meshes of a map: all of them in a few columns, decoded together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from raymap.bytes.chunks import Chunk, MapFile
from raymap.bytes.streams import StreamSet
from raymap.encoding.objectstreams import ColumnReader
from raymap.model.directory import DisplayMesh
from raymap.model.errors import FormatError, LimitExceeded

__all__ = ["add_meshes", "meshes_of_version_1", "read_meshes"]


def add_meshes(streams: StreamSet, meshes: Mapping[int, DisplayMesh], n_objects: int) -> None:
    """Store the meshes of objects.

    Raises
    ------
    LimitExceeded
        A mesh of no object, or one whose triangles name vertices that it does not have.
    """
    given = sorted(meshes.items())
    if not given:
        return
    for number, mesh in given:
        if not 0 <= number < n_objects or not _is_sound(mesh):
            raise LimitExceeded(f"the display mesh of object {number} is not sound")
    every = [mesh for _, mesh in given]
    streams.add_smallest("mesh.object", np.array([number for number, _ in given], np.int16))
    for name, counts in (
        ("mesh.vertices", [len(mesh.vertices) for mesh in every]),
        ("mesh.triangles", [len(mesh.triangles) for mesh in every]),
    ):
        streams.add_smallest(name, np.array(counts, np.uint32))
    streams.add_smallest(
        "mesh.vertex", np.concatenate([np.asarray(m.vertices, np.float32) for m in every])
    )
    streams.add_smallest(
        "mesh.triangle", np.concatenate([np.asarray(m.triangles, np.int32) for m in every])
    )
    streams.add_smallest("mesh.face", np.concatenate([np.asarray(m.face, np.int32) for m in every]))


def read_meshes(read: ColumnReader, n_objects: int) -> dict[int, DisplayMesh]:
    """The meshes by object.

    Raises
    ------
    FormatError
        They are damaged or contradict each other.
    """
    item = read.column("mesh.object", None, np.int16)
    n_meshes = len(item)
    vertices = np.cumsum(read.column("mesh.vertices", n_meshes, np.uint32), dtype=np.int64)
    triangles = np.cumsum(read.column("mesh.triangles", n_meshes, np.uint32), dtype=np.int64)
    n_vertices, n_triangles = (int(ends[-1]) if n_meshes else 0 for ends in (vertices, triangles))
    vertex = read.column("mesh.vertex", n_vertices, np.float32, matrix=True)
    triangle = read.column("mesh.triangle", n_triangles, np.int32, matrix=True)
    face = read.column("mesh.face", n_triangles, np.int32)
    if vertex.size != 3 * n_vertices or triangle.size != 3 * n_triangles:
        raise FormatError("display meshes have vertices or triangles that are none")
    found: dict[int, DisplayMesh] = {}
    before = 0, 0
    for number, *ends in zip(item.tolist(), vertices.tolist(), triangles.tolist(), strict=True):
        mesh = DisplayMesh(
            vertices=vertex.reshape(-1, 3)[before[0] : ends[0]],
            triangles=triangle.reshape(-1, 3)[before[1] : ends[1]],
            face=face[before[1] : ends[1]],
        )
        before = ends[0], ends[1]
        if not 0 <= number < n_objects or number in found or not _is_sound(mesh):
            raise FormatError(f"display mesh of object {number} is not sound")
        found[number] = mesh
    return found


def meshes_of_version_1(file: MapFile, chunk: Chunk, n_objects: int) -> dict[int, DisplayMesh]:
    """The meshes of a directory of version 1, in which each has streams of its own."""
    table = chunk.by_name
    found: dict[int, DisplayMesh] = {}
    for name in table:
        first, _, rest = name.partition(".")
        number, _, last = rest.partition(".")
        if first != "mesh" or last != "vertices" or not number.isdigit():
            continue
        if int(number) < n_objects:
            found[int(number)] = _mesh_of_version_1(file, chunk, int(number))
    return dict(sorted(found.items()))


def _mesh_of_version_1(file: MapFile, chunk: Chunk, number: int) -> DisplayMesh:
    vertices = file.column(chunk, f"mesh.{number}.vertices", None, np.float32, matrix=True)
    triangles = file.column(chunk, f"mesh.{number}.triangles", None, np.int32, matrix=True)
    face = file.column(chunk, f"mesh.{number}.face", None, np.int32)
    mesh = DisplayMesh(vertices=vertices, triangles=triangles, face=face)
    if not _is_sound(mesh):
        raise FormatError(f"display mesh of object {number} is not sound")
    return mesh


def _is_sound(mesh: DisplayMesh) -> bool:
    return (
        mesh.vertices.shape == (len(mesh.vertices), 3)
        and bool(np.isfinite(mesh.vertices).all())
        and mesh.triangles.shape == (len(mesh.triangles), 3)
        and mesh.face.shape == (len(mesh.triangles),)
        and (
            not len(mesh.triangles)
            or 0 <= int(mesh.triangles.min()) <= int(mesh.triangles.max()) < len(mesh.vertices)
        )
    )
