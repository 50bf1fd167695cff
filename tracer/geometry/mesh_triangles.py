"""Rays and single triangles of a mesh, in float64."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from tracer.geometry.mesh_arrays import MeshArrays, normal_to_world, point_to_local

__all__ = [
    "Line",
    "Triangles",
    "close_to_edge",
    "cross_edges",
    "inside_triangle",
    "meet_triangle",
    "mesh_normal",
    "mesh_shading_normal",
    "nearest_around",
    "rim_point",
]

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

_INSIDE = 1e-10  # tolerance of barycentric coordinates


class Triangles(NamedTuple):
    """Corners of triangles, their vertices, and the triangles around each vertex, as in
    `MeshArrays`."""

    corners: F64
    triangles: I32
    first_around: I64
    around: I32


class Line(NamedTuple):
    """Origin and direction of a ray."""

    ox: float
    oy: float
    oz: float
    dx: float
    dy: float
    dz: float


@inner_kernel
def cross_edges(c: F64, row: int) -> tuple[float, float, float]:
    """Normal of a triangle, local, of twice its area."""
    ax, ay, az = c[row, 3] - c[row, 0], c[row, 4] - c[row, 1], c[row, 5] - c[row, 2]
    bx, by, bz = c[row, 6] - c[row, 0], c[row, 7] - c[row, 1], c[row, 8] - c[row, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inner_kernel
def meet_triangle(c: F64, row: int, line: Line) -> tuple[float, float, float, float]:
    """Distance, barycentric u and v, and d . normal (not a unit vector) of a local ray.

    References
    ----------
    T. Möller, B. Trumbore, J. Graphics Tools 2(1), 21 (1997).
    """
    x, y, z = c[row, 0], c[row, 1], c[row, 2]
    ax, ay, az = c[row, 3] - x, c[row, 4] - y, c[row, 5] - z
    bx, by, bz = c[row, 6] - x, c[row, 7] - y, c[row, 8] - z
    dx, dy, dz = line.dx, line.dy, line.dz
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    determinant = ax * px + ay * py + az * pz
    inverse = 1.0 / determinant
    sx, sy, sz = line.ox - x, line.oy - y, line.oz - z
    u = (sx * px + sy * py + sz * pz) * inverse
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) * inverse
    t = (bx * qx + by * qy + bz * qz) * inverse
    return t, u, v, -determinant


@inner_kernel
def inside_triangle(u: float, v: float) -> bool:
    return u >= -_INSIDE and v >= -_INSIDE and u + v <= 1.0 + _INSIDE


@lean_kernel
def mesh_normal(m: MeshArrays, body: int, primitive: int) -> tuple[float, float, float]:
    """Unit normal of a triangle in the world, by the order of its corners (outward)."""
    nx, ny, nz = cross_edges(m.corners, m.first_triangle[body] + primitive)
    if m.placed[body] != 0:
        nx, ny, nz = normal_to_world(m.to_local, body, nx, ny, nz)
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@lean_kernel
def mesh_shading_normal(
    m: MeshArrays, body: int, primitive: int, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Unit normal at a point of a triangle, interpolated where the mesh has smooth normals."""
    first = m.first_corner[body]
    if first < 0:
        return mesh_normal(m, body, primitive)
    # Find the point's place on the triangle
    if m.placed[body] != 0:
        px, py, pz = point_to_local(m.to_local, body, px, py, pz)
    row = m.first_triangle[body] + primitive
    nx, ny, nz = cross_edges(m.corners, row)
    _, u, v, _ = meet_triangle(m.corners, row, Line(px, py, pz, nx, ny, nz))
    w = 1.0 - u - v
    # Interpolate the normals of its corners
    c = m.corner_normals
    k = first + primitive
    nx = w * c[k, 0] + u * c[k, 3] + v * c[k, 6]
    ny = w * c[k, 1] + u * c[k, 4] + v * c[k, 7]
    nz = w * c[k, 2] + u * c[k, 5] + v * c[k, 8]
    if m.placed[body] != 0:
        nx, ny, nz = normal_to_world(m.to_local, body, nx, ny, nz)
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@inner_kernel
def close_to_edge(c: F64, row: int, x: float, y: float, z: float, distance: float) -> bool:
    """Whether a point in the plane of a triangle lies within ``distance`` of an edge's line."""
    for corner in range(3):
        i = 3 * corner
        j = (i + 3) % 9
        ax, ay, az = (
            c[row, j] - c[row, i],
            c[row, j + 1] - c[row, i + 1],
            c[row, j + 2] - c[row, i + 2],
        )
        bx, by, bz = x - c[row, i], y - c[row, i + 1], z - c[row, i + 2]
        px, py, pz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        limit = distance * distance * (ax * ax + ay * ay + az * az)
        if px * px + py * py + pz * pz < limit:
            return True
    return False


@inner_kernel
def nearest_around(
    mesh: Triangles, row: int, near: float, least: float, limit: float, way: float, line: Line
) -> tuple[float, int]:
    """Nearest hit with the triangles that share a vertex with ``row``; -1 without one.

    Hits not beyond ``least`` count only if the ray crosses the triangle in the sense of ``way``.
    """
    best, found = limit, -1
    for corner in range(3):
        vertex = mesh.triangles[row, corner]
        for index in range(mesh.first_around[vertex], mesh.first_around[vertex + 1]):
            other = mesh.around[index]
            if other == row:
                continue
            t, u, v, crossing = meet_triangle(mesh.corners, other, line)
            if (
                t < best
                and inside_triangle(u, v)
                and (t > least or (t > -near and crossing * way > 0.0))
            ):
                best, found = t, other
    return best, found


@inner_kernel
def rim_point(c: F64, row: int, u: float, v: float) -> tuple[float, float, float]:
    """The point of a triangle with clamped coordinates, local."""
    if not (abs(u) < 1e6 and abs(v) < 1e6):
        u, v = 1.0 / 3.0, 1.0 / 3.0
    u, v = max(0.0, u), max(0.0, v)
    total = max(1.0, u + v)
    u, v = u / total, v / total
    w = 1.0 - u - v
    return (
        w * c[row, 0] + u * c[row, 3] + v * c[row, 6],
        w * c[row, 1] + u * c[row, 4] + v * c[row, 7],
        w * c[row, 2] + u * c[row, 5] + v * c[row, 8],
    )
