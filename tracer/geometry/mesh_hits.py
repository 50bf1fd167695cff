"""Nearest hit of many rays with triangle meshes: found by Embree, decided in float64.

Embree searches in float32, robustly: its answer never falls between two triangles. Here the hit is
computed again in float64 on the triangle found. What rounding could spoil is decided as follows:

- The ray starts a little off the triangle that it leaves, on the side to which it goes; that
  triangle itself never counts as a hit.
- Where it starts close to an edge, the triangles around are also tried in float64: the start that
  Embree sees might lie beyond them. Where triangles fold back over others that reaches farther.
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

from raymap.kernels import inline_kernel, inner_kernel, lean_kernel, unsigned
from tracer.geometry.embree import INVALID, RAYHIT_WORDS, intersect
from tracer.geometry.prefetch import prefetch

__all__ = [
    "CELL_MARGIN",
    "EDGE",
    "FLAT_EDGE",
    "MeshArrays",
    "MeshScratch",
    "mesh_normal",
    "mesh_scratch",
    "mesh_shading_normal",
    "nearest_on_meshes",
]

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
    corners : (n_triangles, 10) the three corners x, y, z of each triangle, local; offsets from an
        edge within which the triangles around are tried
    triangles : (n_triangles, 3) numbers of the corners
    face : (n_triangles,) named face of the mesh to which each triangle belongs
    first_around : (n_vertices + 1,) triangles that share vertex v are
        around[first_around[v]:first_around[v + 1]]
    around : (3 n_triangles,) rows of ``triangles``
    first_triangle : (n_objects,) row of the object's primitive 0
    placed : (n_objects,) 1 for an instance with a transform, else corners are in the world
    to_local : (n_objects, 12) world to local as a (3, 4) matrix, for placed objects
    closed : (n_objects,) 1 where the mesh bounds a volume
    first_corner : (n_objects,) row of ``corner_normals`` of primitive 0, -1 without smooth normals
    corner_normals : (n, 9) unit normals at the corners of each triangle, local
    box : (9,) lowest and highest corner of the box that holds all triangles, cells per length
    occupied : (n_x, n_y, n_z) 1 for the cells of the box that triangles may reach into
    """

    handle: int
    center: F64
    radius: float
    corners: F64
    triangles: I32
    face: I32
    first_around: I64
    around: I32
    first_triangle: I64
    placed: I64
    to_local: F64
    closed: I64
    first_corner: I64
    corner_normals: F64
    box: F64
    occupied: NDArray[np.uint8]


_OFFSET = 5e-7  # of the scene's radius: above float32 rounding of start and corners
_NEAR = 1e-10  # of the scene's radius: above float64 rounding of a start on a triangle
_INSIDE = 1e-10  # tolerance of barycentric coordinates
_TRIES = 32
EDGE, FLAT_EDGE = 64.0, 8.0
"""Offsets from an edge within which neighbours are tried: where the mesh folds, and elsewhere."""

CELL_MARGIN = 4.0 * _OFFSET
"""Of the scene's radius: how far rays seen by Embree may be off, and more."""
_FEW_CELLS = 8
_TINY = 1e-30
_BLOCK = 128


class MeshScratch(NamedTuple):
    """Working memory of one thread; see `mesh_scratch`.

    words and bits are one ray and hit as Embree lays them out, at ``address``; the others belong
    to the rays of a block: what Embree gets, and what it gave.
    """

    words: NDArray[np.float32]
    bits: NDArray[np.uint32]
    address: int
    shifted: F64
    begin: F64
    ways: F64
    bests: F64
    own_rows: I64
    best_rows: I64
    hit_body: I64
    hit_row: I64
    chosen: I64
    cells: I32


def mesh_scratch() -> MeshScratch:
    """Working memory for `nearest_on_meshes`: one per thread, to be kept and used again."""
    raw = np.zeros(RAYHIT_WORDS + 4, np.float32)
    skew = (16 - raw.ctypes.data % 16) % 16 // 4
    words = raw[skew : skew + RAYHIT_WORDS]
    return MeshScratch(
        words=words,
        bits=words.view(np.uint32),
        address=words.ctypes.data,
        shifted=np.zeros((3, _BLOCK)),
        begin=np.zeros(_BLOCK),
        ways=np.zeros(_BLOCK),
        bests=np.zeros(_BLOCK),
        own_rows=np.zeros(_BLOCK, np.int64),
        best_rows=np.zeros(_BLOCK, np.int64),
        hit_body=np.zeros(_BLOCK, np.int64),
        hit_row=np.zeros(_BLOCK, np.int64),
        chosen=np.zeros(_BLOCK, np.int64),
        cells=np.zeros((6, _BLOCK), np.int32),
    )


@inner_kernel
def _point_to_local(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        a[b, 0] * x + a[b, 1] * y + a[b, 2] * z + a[b, 3],
        a[b, 4] * x + a[b, 5] * y + a[b, 6] * z + a[b, 7],
        a[b, 8] * x + a[b, 9] * y + a[b, 10] * z + a[b, 11],
    )


@inner_kernel
def _vector_to_local(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        a[b, 0] * x + a[b, 1] * y + a[b, 2] * z,
        a[b, 4] * x + a[b, 5] * y + a[b, 6] * z,
        a[b, 8] * x + a[b, 9] * y + a[b, 10] * z,
    )


@inner_kernel
def _normal_to_world(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        a[b, 0] * x + a[b, 4] * y + a[b, 8] * z,
        a[b, 1] * x + a[b, 5] * y + a[b, 9] * z,
        a[b, 2] * x + a[b, 6] * y + a[b, 10] * z,
    )


@inner_kernel
def _cross_edges(c: F64, row: int) -> tuple[float, float, float]:
    """Normal of a triangle, local, of twice its area."""
    ax, ay, az = c[row, 3] - c[row, 0], c[row, 4] - c[row, 1], c[row, 5] - c[row, 2]
    bx, by, bz = c[row, 6] - c[row, 0], c[row, 7] - c[row, 1], c[row, 8] - c[row, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inner_kernel
def _meet(
    c: F64, row: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> tuple[float, float, float, float]:
    """Distance, barycentric u and v, and d . normal (not a unit vector) of a local ray.

    References
    ----------
    T. Möller, B. Trumbore, J. Graphics Tools 2(1), 21 (1997).
    """
    x, y, z = c[row, 0], c[row, 1], c[row, 2]
    ax, ay, az = c[row, 3] - x, c[row, 4] - y, c[row, 5] - z
    bx, by, bz = c[row, 6] - x, c[row, 7] - y, c[row, 8] - z
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    determinant = ax * px + ay * py + az * pz
    inverse = 1.0 / determinant
    sx, sy, sz = ox - x, oy - y, oz - z
    u = (sx * px + sy * py + sz * pz) * inverse
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) * inverse
    t = (bx * qx + by * qy + bz * qz) * inverse
    return t, u, v, -determinant


@inner_kernel
def _inside(u: float, v: float) -> bool:
    return u >= -_INSIDE and v >= -_INSIDE and u + v <= 1.0 + _INSIDE


@lean_kernel
def mesh_normal(m: MeshArrays, body: int, primitive: int) -> tuple[float, float, float]:
    """Unit normal of a triangle in the world, by the order of its corners (outward)."""
    nx, ny, nz = _cross_edges(m.corners, m.first_triangle[body] + primitive)
    if m.placed[body] != 0:
        nx, ny, nz = _normal_to_world(m.to_local, body, nx, ny, nz)
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
        px, py, pz = _point_to_local(m.to_local, body, px, py, pz)
    row = m.first_triangle[body] + primitive
    nx, ny, nz = _cross_edges(m.corners, row)
    _, u, v, _ = _meet(m.corners, row, px, py, pz, nx, ny, nz)
    w = 1.0 - u - v
    # Interpolate the normals of its corners
    c = m.corner_normals
    k = first + primitive
    nx = w * c[k, 0] + u * c[k, 3] + v * c[k, 6]
    ny = w * c[k, 1] + u * c[k, 4] + v * c[k, 7]
    nz = w * c[k, 2] + u * c[k, 5] + v * c[k, 8]
    if m.placed[body] != 0:
        nx, ny, nz = _normal_to_world(m.to_local, body, nx, ny, nz)
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@inner_kernel
def _close_to_edge(c: F64, row: int, x: float, y: float, z: float, distance: float) -> bool:
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
def _nearest_around(
    c: F64, triangles: I32, first_around: I64, around: I32, row: int,
    near: float, least: float, limit: float, way: float,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float,
) -> tuple[float, int]:  # fmt: skip
    """Nearest hit with the triangles that share a vertex with ``row``; -1 without one.

    Hits not beyond ``least`` count only if the ray crosses the triangle in the sense of ``way``.
    """
    best, found = limit, -1
    for corner in range(3):
        vertex = triangles[row, corner]
        for place in range(first_around[vertex], first_around[vertex + 1]):
            other = around[place]
            if other == row:
                continue
            t, u, v, crossing = _meet(c, other, ox, oy, oz, dx, dy, dz)
            if t < best and _inside(u, v) and (t > least or (t > -near and crossing * way > 0.0)):
                best, found = t, other
    return best, found


@inline_kernel
def _decide(
    corners: F64, triangles: I32, first_around: I64, around: I32, to_local: F64, placed: int,
    closed: int, found: int, row: int, own: int, own_row: int, way: float,
    near: float,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float,
) -> tuple[bool, float, int, float, float, float]:  # fmt: skip
    """Hit in float64 on the triangle that Embree found: accepted, distance, row and point."""
    lx, ly, lz, ex, ey, ez = ox, oy, oz, dx, dy, dz
    if placed != 0:
        lx, ly, lz = _point_to_local(to_local, found, ox, oy, oz)
        ex, ey, ez = _vector_to_local(to_local, found, dx, dy, dz)
    hit, u, v, crossing = _meet(corners, row, lx, ly, lz, ex, ey, ez)
    x, y, z = ox + hit * dx, oy + hit * dy, oz + hit * dz
    if not _inside(u, v):
        # Beside it: take the neighbour that is crossed in the same sense, or the rim
        hit, other = _nearest_around(
            corners, triangles, first_around, around, row, near, math.inf, math.inf, crossing,
            lx, ly, lz, ex, ey, ez,
        )  # fmt: skip
        if other >= 0 and other != own_row:
            row = other
            x, y, z = ox + hit * dx, oy + hit * dy, oz + hit * dz
        else:
            x, y, z = _rim(corners, row, u, v)
            if placed != 0:
                x, y, z = _point_to_world(to_local, found, x, y, z)
            hit = (x - ox) * dx + (y - oy) * dy + (z - oz) * dz
    if found == own and row == own_row:
        accepted = False
    elif found == own and closed != 0:
        accepted = hit > -near and crossing * way < 0.0
    elif hit > near:
        accepted = True
    elif own >= 0:
        accepted = hit > -near and crossing * way < 0.0
    else:
        accepted = hit > 0.0
    return accepted, max(hit, 0.0), row, x, y, z


@inner_kernel
def _clip_to_box(
    rays: F64, t: F64, base: int, size: int, box: F64, slack: float, enter: F64, leave: F64
) -> None:
    """Where rays enter and leave the box; they miss it where they enter behind where they leave."""
    for k in range(size):
        enter[k] = 0.0
        leave[k] = t[base + k] + slack
    for axis in range(3):
        low, high = box[axis], box[3 + axis]
        for k in range(size):
            origin, way = rays[axis, base + k], rays[3 + axis, base + k]
            per = 1.0 / (way if abs(way) > _TINY else _TINY)
            a, b = (low - origin) * per, (high - origin) * per
            near, far = (a if a < b else b), (b if a < b else a)
            enter[k] = near if near > enter[k] else enter[k]
            leave[k] = far if far < leave[k] else leave[k]


@inner_kernel
def _find_cells(
    rays: F64, base: int, size: int, box: F64, counts: tuple[int, int, int], enter: F64,
    leave: F64, cells: I32,
) -> None:  # fmt: skip
    """First and last cells along the axes that the stretches of rays in the box touch."""
    for axis in range(3):
        low, per, top = box[axis], box[6 + axis], counts[axis] - 1.0
        if counts[axis] == 1:
            for k in range(size):
                cells[axis, k] = 0
            for k in range(size):
                cells[3 + axis, k] = 0
            continue
        for k in range(size):
            origin, way = rays[axis, base + k], rays[3 + axis, base + k]
            a, b = (origin + enter[k] * way - low) * per, (origin + leave[k] * way - low) * per
            first = a if a < b else b
            first = first if first > 0.0 else 0.0
            cells[axis, k] = np.int32(first if first < top else top)
        for k in range(size):
            origin, way = rays[axis, base + k], rays[3 + axis, base + k]
            a, b = (origin + enter[k] * way - low) * per, (origin + leave[k] * way - low) * per
            last = b if a < b else a
            last = last if last > 0.0 else 0.0
            cells[3 + axis, k] = np.int32(last if last < top else top)


@inline_kernel
def _may_meet(cells: I32, k: int, occupied: NDArray[np.uint8]) -> bool:
    """Whether a stretch of a ray comes through an occupied cell, or through too many to look."""
    ax, ay, az = unsigned(cells[0, k]), unsigned(cells[1, k]), unsigned(cells[2, k])
    bx, by, bz = unsigned(cells[3, k]), unsigned(cells[4, k]), unsigned(cells[5, k])
    if (bx - ax) | (by - ay) | (bz - az) == 0:
        return bool(occupied[ax, ay, az] != 0)
    if (bx - ax + 1) * (by - ay + 1) * (bz - az + 1) > _FEW_CELLS:
        return True
    for p in range(ax, bx + 1):
        for q in range(ay, by + 1):
            for s in range(az, bz + 1):
                if occupied[unsigned(p), unsigned(q), unsigned(s)] != 0:
                    return True
    return False


@lean_kernel
def nearest_on_meshes(
    m: MeshArrays, rays: F64, own_body: I64, own_primitive: I64, t: F64, body: I64,
    primitive: I64, point: F64, normal: F64, n: int, scratch: MeshScratch,
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
    normal : (3, >= n) outward unit normal of the triangle, replaced likewise
    scratch : working memory of this thread, from `mesh_scratch`

    Notes
    -----
    Rays go through in blocks, and each step is a loop of its own: triangles lie scattered in
    memory, and the processor fetches those of the next rays while it computes on this one's.
    """
    # Take the arrays out of the tuple once
    corners, triangles, to_local, placed = m.corners, m.triangles, m.to_local, m.placed
    first_around, around = m.first_around, m.around
    first_triangle, closed = m.first_triangle, m.closed
    words, bits, address = scratch.words, scratch.bits, np.uintp(scratch.address)
    shifted, begin, ways, bests = scratch.shifted, scratch.begin, scratch.ways, scratch.bests
    own_rows, best_rows = scratch.own_rows, scratch.best_rows
    hit_body, hit_row = scratch.hit_body, scratch.hit_row
    scene = np.uintp(m.handle)
    radius = m.radius
    offset = _OFFSET * radius
    near = _NEAR * radius
    cx, cy, cz = m.center[0], m.center[1], m.center[2]
    box, occupied, chosen, cells = m.box, m.occupied, scratch.chosen, scratch.cells
    for base in range(0, n, _BLOCK):
        size = min(_BLOCK, n - base)
        # Choose the rays that come near a triangle
        _clip_to_box(rays, t, base, size, box, CELL_MARGIN * radius, begin, ways)
        _find_cells(rays, base, size, box, occupied.shape, begin, ways, cells)
        count = 0
        for k in range(size):
            if begin[k] <= ways[k] and _may_meet(cells, k, occupied):
                i = base + k
                chosen[count], begin[count] = i, begin[k]
                own = own_body[i]
                own_rows[count] = -1
                if own >= 0:
                    own_rows[count] = first_triangle[own] + own_primitive[i]
                    prefetch(corners, own_rows[count])
                count += 1
        for k in range(count):
            i = chosen[k]
            ox, oy, oz = rays[0, i], rays[1, i], rays[2, i]
            dx, dy, dz = rays[3, i], rays[4, i], rays[5, i]
            sx, sy, sz = ox - cx, oy - cy, oz - cz
            bests[k], best_rows[k] = t[i], -1
            ways[k] = 0.0
            # Step off the triangle that the ray leaves; near its edges try the triangles around
            own = own_body[i]
            if own >= 0:
                nx, ny, nz = _cross_edges(corners, own_rows[k])
                lx, ly, lz, ex, ey, ez = ox, oy, oz, dx, dy, dz
                if placed[own] != 0:
                    nx, ny, nz = _normal_to_world(to_local, own, nx, ny, nz)
                    lx, ly, lz = _point_to_local(to_local, own, ox, oy, oz)
                    ex, ey, ez = _vector_to_local(to_local, own, dx, dy, dz)
                way = dx * nx + dy * ny + dz * nz
                ways[k] = way
                side = math.copysign(offset, way) / math.sqrt(nx * nx + ny * ny + nz * nz)
                sx, sy, sz = sx + side * nx, sy + side * ny, sz + side * nz
                if _close_to_edge(
                    corners, own_rows[k], lx, ly, lz, offset * corners[own_rows[k], 9]
                ):
                    least = math.inf if closed[own] != 0 else near
                    hit, row = _nearest_around(
                        corners, triangles, first_around, around, own_rows[k], near, least,
                        t[i], -way, lx, ly, lz, ex, ey, ez,
                    )  # fmt: skip
                    if row >= 0:
                        bests[k], best_rows[k] = max(hit, 0.0), row
            # Start where the ray enters the box, so that distant starts stay precise
            start = begin[k]
            shifted[0, k] = sx + start * dx
            shifted[1, k] = sy + start * dy
            shifted[2, k] = sz + start * dz
        # Ask Embree
        for k in range(count):
            i = chosen[k]
            hit_body[k] = -1
            words[0], words[1], words[2], words[3] = shifted[0, k], shifted[1, k], shifted[2, k], 0
            words[4], words[5], words[6], words[7] = rays[3, i], rays[4, i], rays[5, i], 0
            words[8] = (bests[k] - begin[k]) * 1.000001 + offset
            bits[9], bits[10], bits[11] = INVALID, 0, 0
            bits[18], bits[19] = INVALID, INVALID
            intersect(scene, address, np.uintp(0))
            if bits[18] != INVALID:
                # Name the triangle: an instance hides the number of its own geometry
                number = bits[19] if bits[19] != INVALID else bits[18]
                hit_body[k] = np.int64(number)
                hit_row[k] = first_triangle[hit_body[k]] + np.int64(bits[17])
                prefetch(corners, hit_row[k])
        # Decide in float64; look further along the few rays whose hit is not accepted
        for k in range(count):
            i = chosen[k]
            best, best_row, best_body = bests[k], best_rows[k], own_body[i]
            ox, oy, oz = rays[0, i], rays[1, i], rays[2, i]
            dx, dy, dz = rays[3, i], rays[4, i], rays[5, i]
            px, py, pz = ox + best * dx, oy + best * dy, oz + best * dz
            found, row = hit_body[k], hit_row[k]
            tries = 0
            while found >= 0:
                own = own_body[i]
                accepted, hit, row, qx, qy, qz = _decide(
                    corners, triangles, first_around, around, to_local, placed[found],
                    closed[found], found, row, own, own_rows[k], ways[k], near,
                    ox, oy, oz, dx, dy, dz,
                )  # fmt: skip
                if accepted:
                    if hit < best:
                        best, best_body, best_row = hit, found, row
                        px, py, pz = qx, qy, qz
                    break
                # Repeat the query up to here, then from here on
                if tries == 0:
                    words[0], words[1], words[2] = shifted[0, k], shifted[1, k], shifted[2, k]
                    words[4], words[5], words[6] = dx, dy, dz
                    words[3], words[7] = 0.0, 0.0
                    words[8] = (best - begin[k]) * 1.000001 + offset
                    bits[9], bits[10], bits[11] = INVALID, 0, 0
                    bits[18], bits[19] = INVALID, INVALID
                    intersect(scene, address, np.uintp(0))
                tries += 1
                if tries > _TRIES:
                    break
                words[3] = words[8] * 1.0000003 + 1e-9 * radius
                words[8] = (best - begin[k]) * 1.000001 + offset
                bits[18], bits[19] = INVALID, INVALID
                intersect(scene, address, np.uintp(0))
                found = -1
                if bits[18] != INVALID:
                    number = bits[19] if bits[19] != INVALID else bits[18]
                    found = int(np.int64(number))
                    row = int(first_triangle[found] + np.int64(bits[17]))
            if best_row >= 0:
                t[i] = best
                body[i] = best_body
                primitive[i] = best_row - first_triangle[best_body]
                point[0, i], point[1, i], point[2, i] = px, py, pz
                nx, ny, nz = _cross_edges(corners, best_row)
                if placed[best_body] != 0:
                    nx, ny, nz = _normal_to_world(to_local, best_body, nx, ny, nz)
                scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
                normal[0, i], normal[1, i], normal[2, i] = nx * scale, ny * scale, nz * scale


@inner_kernel
def _rim(c: F64, row: int, u: float, v: float) -> tuple[float, float, float]:
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


@inner_kernel
def _point_to_world(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Solve local = A world + shift by Cramer's rule."""
    x, y, z = x - a[b, 3], y - a[b, 7], z - a[b, 11]
    c0 = a[b, 5] * a[b, 10] - a[b, 6] * a[b, 9]
    c1 = a[b, 6] * a[b, 8] - a[b, 4] * a[b, 10]
    c2 = a[b, 4] * a[b, 9] - a[b, 5] * a[b, 8]
    d0 = a[b, 2] * a[b, 9] - a[b, 1] * a[b, 10]
    d1 = a[b, 0] * a[b, 10] - a[b, 2] * a[b, 8]
    d2 = a[b, 1] * a[b, 8] - a[b, 0] * a[b, 9]
    e0 = a[b, 1] * a[b, 6] - a[b, 2] * a[b, 5]
    e1 = a[b, 2] * a[b, 4] - a[b, 0] * a[b, 6]
    e2 = a[b, 0] * a[b, 5] - a[b, 1] * a[b, 4]
    scale = 1.0 / (a[b, 0] * c0 + a[b, 1] * c1 + a[b, 2] * c2)
    return (
        (c0 * x + d0 * y + e0 * z) * scale,
        (c1 * x + d1 * y + e1 * z) * scale,
        (c2 * x + d2 * y + e2 * z) * scale,
    )
