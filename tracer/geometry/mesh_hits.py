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

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, inner_kernel, lean_kernel, unsigned
from tracer.geometry.embree import INVALID, intersect
from tracer.geometry.mesh_arrays import (
    BLOCK,
    MeshArrays,
    MeshScratch,
    normal_to_world,
    point_to_local,
    point_to_world,
    vector_to_local,
)
from tracer.geometry.mesh_triangles import (
    Line,
    Triangles,
    close_to_edge,
    cross_edges,
    inside_triangle,
    meet_triangle,
    nearest_around,
    rim_point,
)
from tracer.geometry.prefetch import prefetch

__all__ = ["CELL_MARGIN", "EDGE", "FLAT_EDGE", "nearest_on_meshes"]

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

_OFFSET = 5e-7  # of the scene's radius: above float32 rounding of start and corners
_NEAR = 1e-10  # of the scene's radius: above float64 rounding of a start on a triangle
_TRIES = 32
EDGE, FLAT_EDGE = 64.0, 8.0
"""Offsets from an edge within which neighbours are tried: where the mesh folds, and elsewhere."""

CELL_MARGIN = 4.0 * _OFFSET
"""Of the scene's radius: how far rays seen by Embree may be off, and more."""
_FEW_CELLS = 8
_TINY = 1e-30


@inline_kernel
def _to_local(to_local: F64, placed: int, body: int, line: Line) -> Line:
    """A ray as a mesh sees it that may be a placed copy."""
    if placed == 0:
        return line
    x, y, z = point_to_local(to_local, body, line.ox, line.oy, line.oz)
    dx, dy, dz = vector_to_local(to_local, body, line.dx, line.dy, line.dz)
    return Line(x, y, z, dx, dy, dz)


@inline_kernel
def _decide(
    mesh: Triangles, to_local: F64, placed: int, closed: int, found: int, row: int, own: int,
    own_row: int, way: float, near: float, line: Line,
) -> tuple[bool, float, int, float, float, float]:  # fmt: skip
    """Hit in float64 on the triangle that Embree found: accepted, distance, row and point."""
    ox, oy, oz, dx, dy, dz = line
    local = _to_local(to_local, placed, found, line)
    hit, u, v, crossing = meet_triangle(mesh.corners, row, local)
    x, y, z = ox + hit * dx, oy + hit * dy, oz + hit * dz
    if not inside_triangle(u, v):
        # Beside it: take the neighbour that is crossed in the same sense, or the rim
        hit, other = nearest_around(mesh, row, near, math.inf, math.inf, crossing, local)
        if other >= 0 and other != own_row:
            row = other
            x, y, z = ox + hit * dx, oy + hit * dy, oz + hit * dz
        else:
            x, y, z = rim_point(mesh.corners, row, u, v)
            if placed != 0:
                x, y, z = point_to_world(to_local, found, x, y, z)
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
    corners, to_local, placed = m.corners, m.to_local, m.placed
    mesh = Triangles(corners, m.triangles, m.first_around, m.around)
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
    for base in range(0, n, BLOCK):
        size = min(BLOCK, n - base)
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
                nx, ny, nz = cross_edges(corners, own_rows[k])
                if placed[own] != 0:
                    nx, ny, nz = normal_to_world(to_local, own, nx, ny, nz)
                local = _to_local(to_local, placed[own], own, Line(ox, oy, oz, dx, dy, dz))
                way = dx * nx + dy * ny + dz * nz
                ways[k] = way
                side = math.copysign(offset, way) / math.sqrt(nx * nx + ny * ny + nz * nz)
                sx, sy, sz = sx + side * nx, sy + side * ny, sz + side * nz
                margin = offset * corners[own_rows[k], 9]
                if close_to_edge(corners, own_rows[k], local.ox, local.oy, local.oz, margin):
                    least = math.inf if closed[own] != 0 else near
                    hit, row = nearest_around(mesh, own_rows[k], near, least, t[i], -way, local)
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
                    mesh, to_local, placed[found], closed[found], found, row, own, own_rows[k],
                    ways[k], near, Line(ox, oy, oz, dx, dy, dz),
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
                nx, ny, nz = cross_edges(corners, best_row)
                if placed[best_body] != 0:
                    nx, ny, nz = normal_to_world(to_local, best_body, nx, ny, nz)
                scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
                normal[0, i], normal[1, i], normal[2, i] = nx * scale, ny * scale, nz * scale
