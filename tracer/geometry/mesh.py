"""Triangle meshes: a closed or open surface whose triangles are grouped into named faces.

A mesh is checked when it is made: what cannot be traced as a solid is refused with the place and
the remedy, what is only suspicious is a counted warning.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inner_kernel, kernel
from raymap.model.directory import DisplayMesh
from raymap.model.errors import SceneError

__all__ = [
    "MeshWarning",
    "TriangleMesh",
    "check_solid",
    "faces_by_angle",
    "faces_by_label",
    "make_mesh",
    "smooth_normals",
    "triangles_around",
    "weld",
]

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]


class MeshWarning(UserWarning):
    """Something about a mesh is suspicious but can be traced."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TriangleMesh:
    """Triangles with outward order, sorted by face.

    Attributes
    ----------
    name : of the body, for messages
    vertices : (n, 3) float64 [scene units]
    triangles : (m, 3) int32 rows of ``vertices``, counter-clockwise seen from outside
    face : (m,) int32 rising, index into ``face_names``
    face_names : one name per face
    closed : the mesh bounds a volume
    corner_normals : (m, 3, 3) float64 smooth unit normals, or None
    """

    name: str
    vertices: F64
    triangles: I32
    face: I32
    face_names: tuple[str, ...]
    closed: bool = True
    corner_normals: F64 | None = None

    @property
    def face_counts(self) -> I64:
        """Triangles of each face: faces are contiguous runs in order."""
        return np.bincount(self.face, minlength=len(self.face_names)).astype(np.int64)

    @property
    def volume(self) -> float:
        """Enclosed volume; negative if the triangles are ordered inside out."""
        a, b, c = (self.vertices[self.triangles[:, corner]] for corner in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)

    @property
    def areas(self) -> F64:
        """Area of each triangle."""
        return np.asarray(0.5 * np.linalg.norm(_normals(self.vertices, self.triangles), axis=1))

    def display(self) -> DisplayMesh:
        """The triangles as they are drawn."""
        return DisplayMesh(
            vertices=self.vertices.astype(np.float32),
            triangles=self.triangles,
            face=self.face,
        )

    def transformed(self, transform: ArrayLike) -> TriangleMesh:
        """A copy moved by a (3, 4) or (4, 4) matrix; a mirror keeps the outward order."""
        matrix = np.asarray(transform, np.float64)[:3, :4]
        linear = matrix[:, :3]
        triangles, corners = self.triangles, self.corner_normals
        if corners is not None:
            corners = corners @ np.linalg.inv(linear)
            corners /= np.linalg.norm(corners, axis=2, keepdims=True)
        if np.linalg.det(linear) < 0.0:
            triangles = np.ascontiguousarray(triangles[:, [0, 2, 1]])
            corners = None if corners is None else corners[:, [0, 2, 1]]
        vertices = self.vertices @ linear.T + matrix[:, 3]
        return replace(self, vertices=vertices, triangles=triangles, corner_normals=corners)


def make_mesh(
    vertices: ArrayLike,
    triangles: ArrayLike,
    *,
    name: str = "mesh",
    labels: Sequence[str] | None = None,
    solid: bool = True,
    flip: bool = False,
) -> TriangleMesh:
    """A checked mesh of arrays.

    Parameters
    ----------
    vertices : (n, 3) [scene units]
    triangles : (m, 3) rows of ``vertices``
    name : of the body
    labels : the face name of each triangle; without it one face called "surface"
    solid : the mesh bounds a volume and must be closed
    flip : turn the triangles over

    Raises
    ------
    SceneError
        for indices out of range, numbers that are not finite, a solid that is open, has edges of
        more than two triangles, inconsistent order, or is inside out
    """
    points = np.array(vertices, np.float64)
    rows = np.array(triangles, np.int64)
    if points.ndim != 2 or points.shape[1:] != (3,) or rows.ndim != 2 or rows.shape[1:] != (3,):
        raise SceneError(f"mesh {name!r}: needs vertices (n, 3) and triangles (m, 3)")
    if rows.size == 0:
        raise SceneError(f"mesh {name!r} has no triangles")
    if rows.min() < 0 or rows.max() >= len(points):
        raise SceneError(f"mesh {name!r}: a triangle names vertex {rows.max()} of {len(points)}")
    if not np.all(np.isfinite(points[np.unique(rows)])):
        raise SceneError(f"mesh {name!r}: a vertex is not a finite number")
    if flip:
        rows = rows[:, [0, 2, 1]]
    names = ["surface"] * len(rows) if labels is None else list(labels)
    if len(names) != len(rows):
        raise SceneError(f"mesh {name!r}: {len(names)} face labels for {len(rows)} triangles")
    points, rows, kept = weld(points, rows)
    dropped = len(kept) - int(kept.sum())
    if dropped:
        warnings.warn(
            f"mesh {name!r}: {dropped} of {len(kept)} triangles have no area and are left out",
            MeshWarning,
            stacklevel=2,
        )
    if not len(rows):
        raise SceneError(f"mesh {name!r}: no triangle has an area")
    mesh = faces_by_label(
        TriangleMesh(
            name=name,
            vertices=points,
            triangles=rows.astype(np.int32),
            face=np.zeros(len(rows), np.int32),
            face_names=("surface",),
            closed=solid,
        ),
        [label for label, keep in zip(names, kept, strict=True) if keep],
    )
    if solid:
        check_solid(mesh)
    return mesh


def weld(vertices: F64, triangles: I64) -> tuple[F64, I64, NDArray[np.bool_]]:
    """Join vertices at one place, and drop triangles without area.

    Returns
    -------
    vertices : (k, 3) the different places that are used
    triangles : (j, 3)
    kept : (m,) which of the triangles given stayed
    """
    used = vertices[np.unique(triangles)]
    extent = float(np.ptp(used, axis=0).max()) or 1.0
    keys = np.round((vertices - used.min(axis=0)) * (1e8 / extent)).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    rows = inverse.reshape(-1)[triangles]
    places = vertices[first]
    double = _normals(places, rows)
    longest = np.max(
        [np.linalg.norm(places[rows[:, i]] - places[rows[:, i - 1]], axis=1) for i in range(3)],
        axis=0,
    )
    kept = np.linalg.norm(double, axis=1) > 1e-14 * longest * extent
    rows = rows[kept]
    remaining, rows = np.unique(rows, return_inverse=True)
    return places[remaining], rows.reshape(-1, 3), kept


def check_solid(mesh: TriangleMesh) -> None:
    """Refuse a mesh that does not bound a volume.

    Raises
    ------
    SceneError
        naming how many edges are open or shared by too many triangles, and where the first one is
    """
    rows = mesh.triangles.astype(np.int64)
    start = rows.ravel()
    end = rows[:, [1, 2, 0]].ravel()
    size = np.int64(len(mesh.vertices))
    directed, counts = np.unique(start * size + end, return_counts=True)
    backward = (directed % size) * size + directed // size
    open_edges = directed[~np.isin(backward, directed)]
    repeated = directed[counts > 1]
    if len(repeated):
        undirected = np.minimum(repeated, (repeated % size) * size + repeated // size)
        turned = len(np.unique(undirected))
        raise SceneError(
            f"mesh {mesh.name!r}: {turned} edges belong to more than two triangles or to triangles "
            f"of opposite order, {_edge_place(mesh, int(repeated[0]))}; light could not tell "
            "inside from outside; repair the mesh, or give it as a surface (without a medium)"
        )
    if len(open_edges):
        raise SceneError(
            f"mesh {mesh.name!r} is open: {len(open_edges)} edges have one triangle only, "
            f"{_edge_place(mesh, int(open_edges[0]))}; light would leak in; close the mesh, or "
            "give it as a surface (without a medium)"
        )
    if mesh.volume < 0.0:
        raise SceneError(
            f"mesh {mesh.name!r} is inside out: its triangles are ordered clockwise seen from "
            "outside; set flip = true or turn the normals over in the program that wrote it"
        )
    _check_parts(mesh)


def _check_parts(mesh: TriangleMesh) -> None:
    """Refuse a part that is inside out and is no cavity: it lies in no other part's box."""
    root = _groups(len(mesh.triangles), *_neighbours(mesh.triangles))
    parts, member = np.unique(root, return_inverse=True)
    if len(parts) == 1:
        return
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    volumes = np.bincount(member.reshape(-1), np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)
    low, high = np.full((len(parts), 3), np.inf), np.full((len(parts), 3), -np.inf)
    for corner in (a, b, c):
        np.minimum.at(low, member.reshape(-1), corner)
        np.maximum.at(high, member.reshape(-1), corner)
    outer = volumes > 0.0
    for part in np.flatnonzero(~outer):
        holds = outer & np.all(low <= low[part], axis=1) & np.all(high >= high[part], axis=1)
        if not np.any(holds):
            x, y, z = 0.5 * (low[part] + high[part])
            raise SceneError(
                f"mesh {mesh.name!r}: one of its {len(parts)} parts is inside out, the one about "
                f"({x:.6g}, {y:.6g}, {z:.6g}); turn its normals over in the program that wrote it"
            )


def _edge_place(mesh: TriangleMesh, edge: int) -> str:
    a, b = divmod(edge, len(mesh.vertices))
    (x0, y0, z0), (x1, y1, z1) = mesh.vertices[a], mesh.vertices[b]
    return f"the first from ({x0:.6g}, {y0:.6g}, {z0:.6g}) to ({x1:.6g}, {y1:.6g}, {z1:.6g})"


def faces_by_label(mesh: TriangleMesh, labels: Sequence[str]) -> TriangleMesh:
    """Group the triangles by a name each; faces stand in the order of their first triangle."""
    names, first, inverse = np.unique(
        np.asarray(labels, dtype=str), return_index=True, return_inverse=True
    )
    rank = np.empty(len(names), np.int32)
    rank[np.argsort(first, kind="stable")] = np.arange(len(names), dtype=np.int32)
    face = rank[inverse.reshape(-1)]
    ordered = tuple(str(name) for name in names[np.argsort(first, kind="stable")])
    order = np.argsort(face, kind="stable")
    corners = mesh.corner_normals
    return replace(
        mesh,
        triangles=np.ascontiguousarray(mesh.triangles[order]),
        face=face[order].astype(np.int32),
        face_names=ordered,
        corner_normals=None if corners is None else corners[order],
    )


def faces_by_angle(mesh: TriangleMesh, angle_deg: float = 30.0) -> TriangleMesh:
    """Group the triangles into faces "face_1", "face_2", … that meet at sharper edges only.

    Two triangles with a common edge belong to one face if their normals differ by less than
    ``angle_deg``. Faces are numbered in the order of their first triangle.
    """
    normals = _normals(mesh.vertices, mesh.triangles)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    a, b = _neighbours(mesh.triangles)
    flat = np.einsum("ij,ij->i", normals[a], normals[b]) >= math.cos(math.radians(angle_deg))
    root = _groups(len(mesh.triangles), a[flat], b[flat])
    _, start, number = np.unique(root, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(start, kind="stable"), kind="stable")
    return faces_by_label(mesh, [f"face_{rank[k] + 1}" for k in number.reshape(-1)])


def smooth_normals(mesh: TriangleMesh, crease_deg: float = 45.0) -> TriangleMesh:
    """Give the mesh normals that vary across triangles, except over edges sharper than a crease.

    At a corner the normals of the triangles around it are averaged, weighted by their angle there.
    """
    normals = _normals(mesh.vertices, mesh.triangles)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    first, around = triangles_around(len(mesh.vertices), mesh.triangles)
    limit = math.cos(math.radians(crease_deg))
    corners = _corner_normals(mesh.vertices, mesh.triangles, normals, first, around, limit)
    return replace(mesh, corner_normals=corners)


def triangles_around(n_vertices: int, triangles: NDArray[Any]) -> tuple[I64, I32]:
    """Triangles that share each vertex: (n_vertices + 1,) offsets and (3 m,) triangle rows."""
    corner_vertex = triangles.ravel()
    order = np.argsort(corner_vertex, kind="stable")
    counts = np.bincount(corner_vertex, minlength=n_vertices)
    first = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    return first, (order // 3).astype(np.int32)


def _normals(vertices: F64, triangles: NDArray[Any]) -> F64:
    """Normals of twice the triangles' areas."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    return np.asarray(np.cross(b - a, c - a))


def _neighbours(triangles: NDArray[Any]) -> tuple[I64, I64]:
    """Pairs of triangles with a common edge."""
    rows = triangles.astype(np.int64)
    start, end = rows.ravel(), rows[:, [1, 2, 0]].ravel()
    edge = np.minimum(start, end) * (rows.max() + 1) + np.maximum(start, end)
    order = np.argsort(edge, kind="stable")
    same = edge[order][1:] == edge[order][:-1]
    return order[:-1][same] // 3, order[1:][same] // 3


def _groups(count: int, a: I64, b: I64) -> I64:
    """Lowest member of the group of each of ``count`` items, where pairs (a, b) join items."""
    label = np.arange(count)
    while True:
        # Hang each root under the lowest neighbouring one, then shorten the chains
        lowest = np.minimum(label[a], label[b])
        joined = label.copy()
        np.minimum.at(joined, label[a], lowest)
        np.minimum.at(joined, label[b], lowest)
        while not np.array_equal(joined, joined[joined]):
            joined = joined[joined]
        if np.array_equal(joined, label):
            return label
        label = joined


@kernel
def _corner_normals(
    vertices: F64, triangles: I32, normals: F64, first: I64, around: I32, limit: float
) -> F64:
    result = np.zeros((len(triangles), 3, 3))
    for row in range(len(triangles)):
        for corner in range(3):
            vertex = triangles[row, corner]
            for index in range(first[vertex], first[vertex + 1]):
                other = around[index]
                cosine = 0.0
                for k in range(3):
                    cosine += normals[row, k] * normals[other, k]
                if cosine < limit:
                    continue
                angle = _corner_angle(vertices, triangles, other, vertex)
                for k in range(3):
                    result[row, corner, k] += angle * normals[other, k]
            length = 0.0
            for k in range(3):
                length += result[row, corner, k] ** 2
            for k in range(3):
                result[row, corner, k] /= math.sqrt(length)
    return result


@inner_kernel
def _corner_angle(vertices: F64, triangles: I32, row: int, vertex: int) -> float:
    corner = 0
    for k in range(3):
        if triangles[row, k] == vertex:
            corner = k
    b, c = triangles[row, (corner + 1) % 3], triangles[row, (corner + 2) % 3]
    dot, bb, cc = 0.0, 0.0, 0.0
    for k in range(3):
        p, q = vertices[b, k] - vertices[vertex, k], vertices[c, k] - vertices[vertex, k]
        dot += p * q
        bb += p * p
        cc += q * q
    return math.acos(min(1.0, max(-1.0, dot / math.sqrt(bb * cc))))
