"""All meshes of a scene behind one object: Embree's search tree and the arrays of compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.geometry.embree import EmbreeScene
from tracer.geometry.mesh import TriangleMesh, triangles_around
from tracer.geometry.mesh_arrays import MeshArrays, mesh_scratch
from tracer.geometry.mesh_cells import MeshCells, find_cells
from tracer.geometry.mesh_hits import CELL_MARGIN, EDGE, FLAT_EDGE, nearest_on_meshes

__all__ = ["MeshScene", "Placement", "count_crossing_edges"]

INSTANCE_ABOVE = 2_000_000
"""Copies of a mesh become instances if they would hold more triangles than this together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement:
    """A mesh in the scene; ``transform`` (3, 4) or (4, 4) from its frame to the world."""

    mesh: TriangleMesh
    transform: ArrayLike | None = None


class _Kept:
    """Memory of an array together with what must live as long as the array does."""

    def __init__(self, array: NDArray[np.float64], companion: object) -> None:
        self.__array_interface__ = array.__array_interface__
        self._kept = (array, companion)


class MeshScene:
    """Meshes ready to be hit. Embree's tree lives as long as ``arrays`` does.

    Parameters
    ----------
    placements : one per mesh object, in the order of their numbers. A mesh that is placed more
        than once is stored once if its copies together exceed ``instance_above`` triangles.

    Attributes
    ----------
    placements : as given
    arrays : MeshArrays, for `nearest_on_meshes` and the normals
    """

    def __init__(
        self, placements: Sequence[Placement], *, instance_above: int = INSTANCE_ABOVE
    ) -> None:
        if not placements:
            raise SceneError("a mesh scene needs at least one mesh")
        self.placements = tuple(placements)
        uses: dict[int, int] = {}
        for placement in placements:
            uses[id(placement.mesh)] = uses.get(id(placement.mesh), 0) + 1
        self._parts: list[TriangleMesh] = []
        self._first_row: list[int] = []
        self._rows = 0
        prototype_part: dict[int, int] = {}
        part_of: list[int] = []
        matrices: list[NDArray[np.float64] | None] = []
        for placement in placements:
            matrix = _matrix(placement)
            key = id(placement.mesh)
            instanced = uses[key] > 1 and (
                uses[key] * len(placement.mesh.triangles) > instance_above
            )
            if instanced:
                if key not in prototype_part:
                    prototype_part[key] = self._add_part(placement.mesh)
                part_of.append(prototype_part[key])
                matrices.append(matrix)
            else:
                identity = bool(np.array_equal(matrix, np.eye(3, 4)))
                mesh = placement.mesh if identity else placement.mesh.transformed(matrix)
                part_of.append(self._add_part(mesh))
                matrices.append(None)
        self._embree = EmbreeScene()
        self.arrays = self._build(part_of, matrices)

    def _add_part(self, mesh: TriangleMesh) -> int:
        self._parts.append(mesh)
        self._first_row.append(self._rows)
        self._rows += len(mesh.triangles)
        return len(self._parts) - 1

    def _build(self, part_of: list[int], matrices: list[NDArray[np.float64] | None]) -> MeshArrays:
        """Fill Embree's scene, relative to a common centre, and the arrays."""
        lows, highs = [], []
        for part, matrix in zip(part_of, matrices, strict=True):
            points = self._parts[part].vertices
            if matrix is not None:
                points = points @ matrix[:, :3].T + matrix[:, 3]
            corners = points[self._parts[part].triangles]
            lows.append(corners.min(axis=1))
            highs.append(corners.max(axis=1))
        low, high = np.concatenate(lows), np.concatenate(highs)
        center = 0.5 * (low.min(axis=0) + high.max(axis=0))
        radius = float(0.5 * np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
        cells = find_cells(low, high, CELL_MARGIN * radius)
        prototypes: dict[int, tuple[int, NDArray[np.float64]]] = {}
        to_local = np.tile(np.eye(3, 4), (len(part_of), 1, 1))
        for number, (part, matrix) in enumerate(zip(part_of, matrices, strict=True)):
            mesh = self._parts[part]
            if matrix is None:
                self._embree.add_mesh(number, mesh.vertices - center, mesh.triangles)
                continue
            if part not in prototypes:
                middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
                handle = self._embree.add_prototype(mesh.vertices - middle, mesh.triangles)
                prototypes[part] = handle, middle
            handle, middle = prototypes[part]
            shifted = matrix.copy()
            shifted[:, 3] += matrix[:, :3] @ middle - center
            self._embree.add_instance(number, handle, shifted)
            inverse = np.linalg.inv(matrix[:, :3])
            to_local[number] = np.column_stack((inverse, -inverse @ matrix[:, 3]))
        self._embree.commit()
        return self._gather(part_of, matrices, to_local, center, radius, cells)

    def _gather(
        self,
        part_of: list[int],
        matrices: list[NDArray[np.float64] | None],
        to_local: NDArray[np.float64],
        center: NDArray[np.float64],
        radius: float,
        cells: MeshCells,
    ) -> MeshArrays:
        first_vertex = np.cumsum([0] + [len(part.vertices) for part in self._parts])
        vertices = np.concatenate([part.vertices for part in self._parts])
        triangles = np.concatenate(
            [
                part.triangles + np.int32(first)
                for part, first in zip(self._parts, first_vertex, strict=False)
            ]
        ).astype(np.int32)
        first_around, around = triangles_around(len(vertices), triangles)
        corners = np.ascontiguousarray(vertices[triangles].reshape(-1, 9))
        folded = _folded(corners, triangles, first_around, around)
        corners = np.column_stack((corners, np.where(folded, EDGE, FLAT_EDGE)))
        # Corner normals of the smooth parts, one after the other
        smooth: list[NDArray[np.float64]] = []
        first_corner: list[int] = []
        rows = 0
        for part in self._parts:
            first_corner.append(-1 if part.corner_normals is None else rows)
            if part.corner_normals is not None:
                smooth.append(part.corner_normals.reshape(-1, 9))
                rows += len(part.corner_normals)
        return MeshArrays(
            handle=self._embree.handle,
            center=center,
            radius=radius,
            corners=np.asarray(_Kept(corners, self._embree)),
            triangles=np.ascontiguousarray(triangles),
            face=np.concatenate([part.face for part in self._parts]).astype(np.int32),
            first_around=first_around,
            around=around,
            first_triangle=np.array([self._first_row[part] for part in part_of], np.int64),
            placed=np.array([matrix is not None for matrix in matrices], np.int64),
            to_local=to_local.reshape(-1, 12),
            closed=np.array([self._parts[part].closed for part in part_of], np.int64),
            first_corner=np.array([first_corner[part] for part in part_of], np.int64),
            corner_normals=np.concatenate(smooth) if smooth else np.zeros((0, 9)),
            box=cells.box,
            occupied=cells.occupied,
        )


def _folded(
    corners: NDArray[np.float64],
    triangles: NDArray[np.int32],
    first_around: NDArray[np.int64],
    around: NDArray[np.int32],
) -> NDArray[np.bool_]:
    """(n_triangles,) whether some triangle at a corner may be turned by more than 60 degrees."""
    points = corners.reshape(-1, 3, 3)
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Those within 30 degrees of their mean are within 60 degrees of each other
    starts, gathered = first_around[:-1], normals[around]
    mean = np.add.reduceat(gathered, starts)
    cosines = np.einsum("ij,ij->i", gathered, np.repeat(mean, np.diff(first_around), axis=0))
    least = np.minimum.reduceat(cosines, starts)
    sharp = least <= 0.8660255 * np.linalg.norm(mean, axis=1)
    return np.asarray(sharp[triangles].any(axis=1))


def _matrix(placement: Placement) -> NDArray[np.float64]:
    if placement.transform is None:
        return np.eye(3, 4)
    matrix = np.asarray(placement.transform, np.float64)
    if matrix.shape not in ((3, 4), (4, 4)) or not np.all(np.isfinite(matrix)):
        raise SceneError(
            f"mesh {placement.mesh.name!r}: its transform must be a (3, 4) or (4, 4) matrix of "
            "finite numbers"
        )
    if abs(np.linalg.det(matrix[:3, :3])) < 1e-12 * np.abs(matrix[:3, :3]).max() ** 3:
        raise SceneError(f"mesh {placement.mesh.name!r}: its transform flattens the mesh")
    return matrix[:3, :4].copy()


def count_crossing_edges(mesh: TriangleMesh) -> int:
    """Number of edges that run through a triangle elsewhere: signs of self-intersection.

    Each edge is followed as a ray; grazing contacts may stay unseen. Takes about a second for a
    hundred thousand triangles.
    """
    arrays = MeshScene([Placement(mesh=mesh)]).arrays
    rows = mesh.triangles.astype(np.int64)
    edges = np.sort(np.concatenate((rows[:, :2], rows[:, 1:], rows[:, [2, 0]])), axis=1)
    edges = np.unique(edges, axis=0)
    start, end = mesh.vertices[edges[:, 0]], mesh.vertices[edges[:, 1]]
    vector = end - start
    length = np.linalg.norm(vector, axis=1)
    count = len(edges)
    margin = 1e-5 * length
    direction = vector / length[:, None]
    rays = np.ascontiguousarray(
        np.concatenate((start + margin[:, None] * direction, direction), 1).T
    )
    t = length - 2.0 * margin
    none = np.full(count, -1, np.int64)
    body, primitive = none.copy(), none.copy()
    unused = np.zeros((3, count))
    nearest_on_meshes(
        arrays, rays, none, none, t, body, primitive, unused, unused.copy(), count, mesh_scratch()
    )
    hit = body >= 0
    met = rows[primitive[hit]]
    ends = edges[hit]
    shares = (met[:, :, None] == ends[:, None, :]).any(axis=(1, 2))
    return int((~shares).sum())
