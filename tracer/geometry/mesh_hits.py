"""Nearest hit of many rays with triangle meshes: found by Embree, decided in float64.

Embree searches in float32, robustly: its answer never falls between two triangles. Here the hit is
computed again in float64 on the triangle found. What rounding could spoil is decided as follows:

- The ray starts a little off the triangle that it leaves, on the side to which it goes; that
  triangle itself never counts as a hit.
- Where it starts close to an edge, the triangles around are also tried in float64: the start that
  Embree sees might lie beyond them.
- A hit nearer than rounding (``near``) counts only if the ray crosses that triangle the other way
  than the one it leaves. For a closed body this holds at every distance: what goes in comes out,
  so media stay consistent at edges.
- Where the exact ray passes just beside the triangle found, one of its neighbours is taken if the
  ray meets it; else the point is put on the rim of the triangle found.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import kernel
from tracer.geometry.embree import INVALID, RAYHIT_WORDS, intersect

__all__ = ["MeshArrays", "mesh_normal", "mesh_shading_normal", "nearest_on_meshes"]

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]


class MeshArrays(NamedTuple):
    """All meshes of a scene, for compiled code [scene units].

    Attributes
    ----------
    handle : Embree's scene
    center : (3,) point that Embree sees as origin
    radius : of the sphere about ``center`` that holds all triangles
    vertices : (n_vertices, 3)
    triangles : (n_triangles, 3) rows of ``vertices``
    first_around : (n_vertices + 1,) triangles that share vertex v are
        around[first_around[v]:first_around[v + 1]]
    around : (3 n_triangles,) rows of ``triangles``
    first_triangle : (n_objects,) row of the object's primitive 0
    placed : (n_objects,) 1 for an instance with a transform, else vertices are in the world
    to_local : (n_objects, 3, 4) world to local, for placed objects
    closed : (n_objects,) 1 where the mesh bounds a volume
    first_corner : (n_objects,) row of ``corner_normals`` of primitive 0, -1 without smooth normals
    corner_normals : (n, 3, 3) unit normals at the corners of each triangle, local
    """

    handle: int
    center: F64
    radius: float
    vertices: F64
    triangles: I32
    first_around: I64
    around: I32
    first_triangle: I64
    placed: I64
    to_local: F64
    closed: I64
    first_corner: I64
    corner_normals: F64


_OFFSET = 5e-7  # of the scene's radius: above float32 rounding of start and vertices
_EDGE = 64.0  # offsets from an edge within which neighbours are tried
_NEAR = 1e-10  # of the scene's radius: above float64 rounding of a start on a triangle
_INSIDE = 1e-10  # tolerance of barycentric coordinates
_TRIES = 32


@kernel
def _local_ray(
    m: MeshArrays, body: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> tuple[float, float, float, float, float, float]:
    if m.placed[body] == 0:
        return ox, oy, oz, dx, dy, dz
    a = m.to_local[body]
    return (
        a[0, 0] * ox + a[0, 1] * oy + a[0, 2] * oz + a[0, 3],
        a[1, 0] * ox + a[1, 1] * oy + a[1, 2] * oz + a[1, 3],
        a[2, 0] * ox + a[2, 1] * oy + a[2, 2] * oz + a[2, 3],
        a[0, 0] * dx + a[0, 1] * dy + a[0, 2] * dz,
        a[1, 0] * dx + a[1, 1] * dy + a[1, 2] * dz,
        a[2, 0] * dx + a[2, 1] * dy + a[2, 2] * dz,
    )


@kernel
def _meet(
    m: MeshArrays, row: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> tuple[float, float, float, float]:
    """Distance, barycentric u and v, and d . normal (not a unit vector) of a local ray.

    References
    ----------
    T. Möller, B. Trumbore, J. Graphics Tools 2(1), 21 (1997).
    """
    i, j, k = m.triangles[row, 0], m.triangles[row, 1], m.triangles[row, 2]
    x, y, z = m.vertices[i, 0], m.vertices[i, 1], m.vertices[i, 2]
    ax, ay, az = m.vertices[j, 0] - x, m.vertices[j, 1] - y, m.vertices[j, 2] - z
    bx, by, bz = m.vertices[k, 0] - x, m.vertices[k, 1] - y, m.vertices[k, 2] - z
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    determinant = ax * px + ay * py + az * pz
    inverse = 1.0 / determinant
    sx, sy, sz = ox - x, oy - y, oz - z
    u = (sx * px + sy * py + sz * pz) * inverse
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) * inverse
    t = (bx * qx + by * qy + bz * qz) * inverse
    return t, u, v, -determinant


@kernel
def _inside(u: float, v: float) -> bool:
    return u >= -_INSIDE and v >= -_INSIDE and u + v <= 1.0 + _INSIDE


@kernel
def mesh_normal(m: MeshArrays, body: int, primitive: int) -> tuple[float, float, float]:
    """Unit normal of a triangle in the world, by the order of its vertices (outward)."""
    row = m.first_triangle[body] + primitive
    i, j, k = m.triangles[row, 0], m.triangles[row, 1], m.triangles[row, 2]
    x, y, z = m.vertices[i, 0], m.vertices[i, 1], m.vertices[i, 2]
    ax, ay, az = m.vertices[j, 0] - x, m.vertices[j, 1] - y, m.vertices[j, 2] - z
    bx, by, bz = m.vertices[k, 0] - x, m.vertices[k, 1] - y, m.vertices[k, 2] - z
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return _normal_to_world(m, body, nx, ny, nz)


@kernel
def _normal_to_world(
    m: MeshArrays, body: int, nx: float, ny: float, nz: float
) -> tuple[float, float, float]:
    if m.placed[body] != 0:
        a = m.to_local[body]
        x = a[0, 0] * nx + a[1, 0] * ny + a[2, 0] * nz
        y = a[0, 1] * nx + a[1, 1] * ny + a[2, 1] * nz
        z = a[0, 2] * nx + a[1, 2] * ny + a[2, 2] * nz
        nx, ny, nz = x, y, z
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@kernel
def mesh_shading_normal(
    m: MeshArrays, body: int, primitive: int, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Unit normal at a point of a triangle, interpolated where the mesh has smooth normals."""
    first = m.first_corner[body]
    if first < 0:
        return mesh_normal(m, body, primitive)
    nx, ny, nz = mesh_normal(m, body, primitive)
    ox, oy, oz, dx, dy, dz = _local_ray(m, body, px, py, pz, nx, ny, nz)
    _, u, v, _ = _meet(m, m.first_triangle[body] + primitive, ox, oy, oz, dx, dy, dz)
    w = 1.0 - u - v
    c = m.corner_normals[first + primitive]
    return _normal_to_world(
        m,
        body,
        w * c[0, 0] + u * c[1, 0] + v * c[2, 0],
        w * c[0, 1] + u * c[1, 1] + v * c[2, 1],
        w * c[0, 2] + u * c[1, 2] + v * c[2, 2],
    )


@kernel
def _edge_distance(m: MeshArrays, row: int, px: float, py: float, pz: float) -> float:
    """Distance of a point in the plane of a triangle from the nearest edge's line, local."""
    nearest = math.inf
    for corner in range(3):
        i = m.triangles[row, corner]
        j = m.triangles[row, (corner + 1) % 3]
        ax = m.vertices[j, 0] - m.vertices[i, 0]
        ay = m.vertices[j, 1] - m.vertices[i, 1]
        az = m.vertices[j, 2] - m.vertices[i, 2]
        bx, by, bz = px - m.vertices[i, 0], py - m.vertices[i, 1], pz - m.vertices[i, 2]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        square = (cx * cx + cy * cy + cz * cz) / (ax * ax + ay * ay + az * az)
        nearest = min(nearest, square)
    return math.sqrt(nearest)


@kernel
def _nearest_around(
    m: MeshArrays, row: int, near: float, least: float, limit: float, way: float,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float,
) -> tuple[float, int]:  # fmt: skip
    """Nearest hit with the triangles that share a vertex with ``row``; -1 without one.

    Hits not beyond ``least`` count only if the ray crosses the triangle in the sense of ``way``.
    """
    best, found = limit, -1
    for corner in range(3):
        vertex = m.triangles[row, corner]
        for place in range(m.first_around[vertex], m.first_around[vertex + 1]):
            other = m.around[place]
            if other == row:
                continue
            t, u, v, crossing = _meet(m, other, ox, oy, oz, dx, dy, dz)
            if t < best and _inside(u, v) and (t > least or (t > -near and crossing * way > 0.0)):
                best, found = t, other
    return best, found


@kernel
def _neighbour_hit(
    m: MeshArrays, row: int, low: float, way: float,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float,
) -> tuple[float, int]:  # fmt: skip
    """The neighbour of ``row`` that a ray meets beyond ``low`` crossing it in the same sense."""
    best, found = math.inf, -1
    for corner in range(3):
        vertex = m.triangles[row, corner]
        for place in range(m.first_around[vertex], m.first_around[vertex + 1]):
            other = m.around[place]
            t, u, v, crossing = _meet(m, other, ox, oy, oz, dx, dy, dz)
            if low < t < best and _inside(u, v) and crossing * way > 0.0:
                best, found = t, other
    return best, found


@kernel
def nearest_on_meshes(
    m: MeshArrays, rays: F64, own_body: I64, own_primitive: I64, t: F64, body: I64,
    primitive: I64, point: F64, n: int,
) -> None:  # fmt: skip
    """Improve the nearest hit of ``n`` rays by all meshes.

    Parameters
    ----------
    rays : (6, >= n) origin x, y, z and unit direction x, y, z
    own_body, own_primitive : (>= n,) mesh object and triangle on which each ray starts, -1 none
    t : (>= n,) nearest distance so far; replaced where a triangle is nearer
    body, primitive : (>= n,) replaced likewise
    point : (3, >= n) place of the hit, on the triangle, replaced likewise. It differs from
        origin + t direction only where the ray passes an edge within float32 rounding.
    """
    # Lay out one ray and hit for Embree, aligned to 16 bytes
    raw = np.zeros(RAYHIT_WORDS + 4, np.float32)
    skew = (16 - raw.ctypes.data % 16) % 16 // 4
    words = raw[skew : skew + RAYHIT_WORDS]
    bits = words.view(np.uint32)
    address = words.ctypes.data
    offset = _OFFSET * m.radius
    near = _NEAR * m.radius
    cx, cy, cz = m.center[0], m.center[1], m.center[2]
    for i in range(n):
        ox, oy, oz = rays[0, i], rays[1, i], rays[2, i]
        dx, dy, dz = rays[3, i], rays[4, i], rays[5, i]
        # Clip the ray to the sphere around all triangles, so that distant starts stay precise
        wx, wy, wz = ox - cx, oy - cy, oz - cz
        along = -(wx * dx + wy * dy + wz * dz)
        gx, gy, gz = wx + along * dx, wy + along * dy, wz + along * dz
        outer = 1.001 * m.radius
        chord = outer * outer - (gx * gx + gy * gy + gz * gz)
        if chord <= 0.0:
            continue
        chord = math.sqrt(chord)
        if along + chord <= 0.0:
            continue
        start = max(0.0, along - chord)
        if start >= t[i]:
            continue
        sx, sy, sz = wx + start * dx, wy + start * dy, wz + start * dz
        best, best_body, best_row = t[i], -1, -1
        hx, hy, hz = 0.0, 0.0, 0.0
        # Step off the triangle that the ray leaves; near its edges try the triangles around
        own, own_row, way = own_body[i], -1, 0.0
        if own >= 0:
            own_row = m.first_triangle[own] + own_primitive[i]
            nx, ny, nz = mesh_normal(m, own, own_primitive[i])
            way = dx * nx + dy * ny + dz * nz
            side = offset if way > 0.0 else -offset
            sx, sy, sz = sx + side * nx, sy + side * ny, sz + side * nz
            lx, ly, lz, ex, ey, ez = _local_ray(m, own, ox, oy, oz, dx, dy, dz)
            if _edge_distance(m, own_row, lx, ly, lz) < _EDGE * offset:
                least = math.inf if m.closed[own] != 0 else near
                around, row = _nearest_around(
                    m, own_row, near, least, best, -way, lx, ly, lz, ex, ey, ez
                )
                if row >= 0:
                    best, best_body, best_row = max(around, 0.0), own, row
                    hx, hy, hz = ox + best * dx, oy + best * dy, oz + best * dz
        words[0], words[1], words[2] = sx, sy, sz
        words[4], words[5], words[6] = dx, dy, dz
        words[7] = 0.0
        words[3] = 0.0
        for _ in range(_TRIES):
            words[8] = (best - start) * 1.000001 + offset
            bits[9], bits[10], bits[11] = INVALID, 0, 0
            bits[18], bits[19] = INVALID, INVALID
            intersect(np.uintp(m.handle), address, np.uintp(0))
            if bits[18] == INVALID:
                break
            # Name the triangle: an instance hides the number of its own geometry
            number = bits[19] if bits[19] != INVALID else bits[18]
            found = int(np.int64(number))
            row = int(m.first_triangle[found] + np.int64(bits[17]))
            lx, ly, lz, ex, ey, ez = _local_ray(m, found, ox, oy, oz, dx, dy, dz)
            hit, u, v, crossing = _meet(m, row, lx, ly, lz, ex, ey, ez)
            snapped = False
            if not _inside(u, v):
                other_hit, other = _neighbour_hit(m, row, -near, crossing, lx, ly, lz, ex, ey, ez)
                if other >= 0 and not (found == own and other == own_row):
                    hit, row = other_hit, other
                else:
                    snapped = True
            if snapped:
                px, py, pz, hit = _snap(m, found, row, u, v, ox, oy, oz, dx, dy, dz)
            # Accept it, or look further along the ray
            if found == own and row == own_row:
                accepted = False
            elif found == own and m.closed[own] != 0:
                accepted = hit > -near and crossing * way < 0.0
            elif hit > near:
                accepted = True
            elif own >= 0:
                accepted = hit > -near and crossing * way < 0.0
            else:
                accepted = hit > 0.0
            if accepted:
                if hit < best:
                    best, best_body, best_row = max(hit, 0.0), found, row
                    if snapped:
                        hx, hy, hz = px, py, pz
                    else:
                        hx, hy, hz = ox + best * dx, oy + best * dy, oz + best * dz
                break
            words[3] = words[8] * 1.0000003 + 1e-9 * m.radius
        if best_body >= 0:
            t[i] = best
            body[i] = best_body
            primitive[i] = best_row - m.first_triangle[best_body]
            point[0, i], point[1, i], point[2, i] = hx, hy, hz


@kernel
def _snap(
    m: MeshArrays, body: int, row: int, u: float, v: float,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """The point of a triangle with clamped coordinates, in the world, and its distance."""
    if not (abs(u) < 1e6 and abs(v) < 1e6):
        u, v = 1.0 / 3.0, 1.0 / 3.0
    u, v = max(0.0, u), max(0.0, v)
    total = max(1.0, u + v)
    u, v = u / total, v / total
    w = 1.0 - u - v
    i, j, k = m.triangles[row, 0], m.triangles[row, 1], m.triangles[row, 2]
    x = w * m.vertices[i, 0] + u * m.vertices[j, 0] + v * m.vertices[k, 0]
    y = w * m.vertices[i, 1] + u * m.vertices[j, 1] + v * m.vertices[k, 1]
    z = w * m.vertices[i, 2] + u * m.vertices[j, 2] + v * m.vertices[k, 2]
    if m.placed[body] != 0:
        # Solve local = A world + b by the adjugate of A
        a = m.to_local[body]
        x, y, z = x - a[0, 3], y - a[1, 3], z - a[2, 3]
        c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
        c01 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
        c02 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
        inverse = 1.0 / (a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02)
        rx = c00 * x + (a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]) * y
        rx += (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]) * z
        ry = c01 * x + (a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]) * y
        ry += (a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]) * z
        rz = c02 * x + (a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]) * y
        rz += (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]) * z
        x, y, z = rx * inverse, ry * inverse, rz * inverse
    hit = (x - ox) * dx + (y - oy) * dy + (z - oz) * dz
    return x, y, z, hit
