"""The full branching tree of one ray in a scene of crystals, heaviest branch first.

Every meeting with a boundary makes up to four branches. Branches wait in a heap ordered by weight;
growing stops when all that still waits weighs less than the tolerance, so the flux that was left
out is known and bounded: exits + absorbed + pruned + truncated = 1.

Fields keep their phase (N . dP along each straight piece), so exits may be summed coherently.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from raymap.jit.kernels import inner_kernel, kernel, lean_kernel
from tracer.geometry.mesh_triangles import Line
from tracer.optics.crystals.interface import WAVE, InterfaceScratch, interface_event
from tracer.optics.crystals.rows import ISOTROPIC, KIND
from tracer.optics.crystals.waves import ray_absorption
from tracer.render.bodies import BodyArrays
from tracer.render.triangle_tree import first_triangle

__all__ = [
    "EXIT",
    "NODE",
    "TreeScratch",
    "body_behind",
    "grow_tree",
    "next_boundary",
    "tree_scratch",
]

Array = np.ndarray[Any, np.dtype[Any]]

NODE = 20
"""Columns of a branch: point (3), N (3), ray direction (3), Re E (3), Im E (3), weight, number of
surface events so far, body it travels in (-1 world), last body it left, 1 if unpolarised."""

EXIT = NODE
"""An exit is a branch that left the scene, at its last point."""

_WEIGHT, _EVENTS, _BODY, _LEFT, _UNPOLARISED = 15, 16, 17, 18, 19

TreeScratch = tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, Array, Array]


@kernel
def tree_scratch(capacity: int) -> TreeScratch:
    """Working arrays for one thread; at most ``capacity`` branches wait at once."""
    return (
        np.zeros((3, 4, 4), np.float64),
        np.zeros((2, 4, 5), np.complex128),
        np.zeros((4, 7), np.complex128),
        np.zeros((8, 6), np.float64),
        np.zeros((2, 4, WAVE), np.float64),
        np.zeros((capacity, NODE), np.float64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(3, np.complex128),
        np.zeros(64, np.int64),
        np.zeros((2, NODE), np.float64),
    )


@inner_kernel
def _enter_convex(
    planes: Array, start: int, end: int, p: Array, dx: float, dy: float, dz: float
) -> tuple[float, int]:
    near = -np.inf
    far = np.inf
    found = -1
    for k in range(start, end):
        along = planes[k, 0] * dx + planes[k, 1] * dy + planes[k, 2] * dz
        gap = planes[k, 3] - (planes[k, 0] * p[0] + planes[k, 1] * p[1] + planes[k, 2] * p[2])
        if along == 0.0:
            if gap < 0.0:
                return np.inf, -1
        elif along < 0.0:
            t = gap / along
            if t > near:
                near = t
                found = k
        else:
            t = gap / along
            if t < far:
                far = t
    if found < 0 or near >= far or near <= 0.0:
        return np.inf, -1
    return near, found


@inner_kernel
def _leave_convex(
    planes: Array, start: int, end: int, p: Array, dx: float, dy: float, dz: float
) -> tuple[float, int]:
    best = np.inf
    found = -1
    for k in range(start, end):
        along = planes[k, 0] * dx + planes[k, 1] * dy + planes[k, 2] * dz
        if along > 1e-15:
            gap = planes[k, 3] - (planes[k, 0] * p[0] + planes[k, 1] * p[1] + planes[k, 2] * p[2])
            t = gap / along
            if t < best:
                best = t
                found = k
    return max(best, 0.0), found


@inner_kernel
def next_boundary(
    bodies: BodyArrays,
    p: Array,
    dx: float,
    dy: float,
    dz: float,
    inside: int,
    left: int,
    stack: Array,
) -> tuple[float, int, float, float, float, int]:
    """Nearest boundary: distance, body, outward normal, face of a convex body or triangle.

    From inside a body only its own counts.


    ``left``: a convex body that the ray just left and cannot meet again.
    """
    best = np.inf
    body = -1
    primitive = -1
    nx = ny = nz = 0.0
    first, last = (inside, inside + 1) if inside >= 0 else (0, bodies.tree_root.shape[0])
    for b in range(first, last):
        root = bodies.tree_root[b]
        if root < 0:
            if inside < 0 and b == left:
                continue
            start = bodies.plane_start[b]
            end = bodies.plane_start[b + 1]
            if inside >= 0:
                t, k = _leave_convex(bodies.planes, start, end, p, dx, dy, dz)
            else:
                t, k = _enter_convex(bodies.planes, start, end, p, dx, dy, dz)
            if k >= 0 and t < best:
                best = t
                body = b
                primitive = k - start
                nx, ny, nz = bodies.planes[k, 0], bodies.planes[k, 1], bodies.planes[k, 2]
        else:
            t, k = first_triangle(
                root,
                bodies.tree_boxes,
                bodies.tree_links,
                bodies.triangles,
                Line(p[0], p[1], p[2], dx, dy, dz),
                inside >= 0,
                1e-4 * bodies.nudge,
                stack,
            )
            if k >= 0 and t < best:
                best = t
                body = b
                primitive = int(bodies.triangles[k, 12])
                nx = bodies.triangles[k, 9]
                ny = bodies.triangles[k, 10]
                nz = bodies.triangles[k, 11]
    return best, body, nx, ny, nz, primitive


@inner_kernel
def body_behind(
    bodies: BodyArrays, own: int, x: float, y: float, z: float, nx: float, ny: float, nz: float
) -> int:
    """The convex body just behind a face, -1 for the world."""
    x += bodies.nudge * nx
    y += bodies.nudge * ny
    z += bodies.nudge * nz
    for b in range(bodies.tree_root.shape[0]):
        if b != own and bodies.tree_root[b] < 0:
            inside = True
            for k in range(bodies.plane_start[b], bodies.plane_start[b + 1]):
                row = bodies.planes[k]
                if row[0] * x + row[1] * y + row[2] * z > row[3]:
                    inside = False
                    break
            if inside:
                return b
    return -1


@inner_kernel
def _push(nodes: Array, heap: Array, size: int, slot: int) -> None:
    """Add a filled slot to the heap of ``size`` entries."""
    weight = nodes[slot, _WEIGHT]
    k = size
    while k > 0:
        parent = (k - 1) // 2
        if nodes[heap[parent], _WEIGHT] >= weight:
            break
        heap[k] = heap[parent]
        k = parent
    heap[k] = slot


@inner_kernel
def _pop(nodes: Array, heap: Array, size: int) -> int:
    """Take the heaviest of ``size`` entries out."""
    top = int(heap[0])
    moved = heap[size - 1]
    weight = nodes[moved, _WEIGHT]
    k = 0
    while True:
        child = 2 * k + 1
        if child >= size - 1:
            break
        if child + 1 < size - 1 and nodes[heap[child + 1], _WEIGHT] > nodes[heap[child], _WEIGHT]:
            child += 1
        if nodes[heap[child], _WEIGHT] <= weight:
            break
        heap[k] = heap[child]
        k = child
    heap[k] = moved
    return top


@inner_kernel
def _copy(source: Array, target: Array, row: int) -> None:
    """Copy a node into a row; element by element, for code without reference counts."""
    for k in range(NODE):
        target[row, k] = source[k]


@lean_kernel
def grow_tree(
    bodies: BodyArrays,
    media: Array,
    k0: float,
    start: Array,
    max_events: int,
    tolerance: float,
    coherent: bool,
    scratch: TreeScratch,
    exits: Array,
) -> tuple[int, float, float, float]:
    """Grow the tree of one ray.

    Parameters
    ----------
    bodies : from `compile_bodies`
    media : (n_bodies + 1, ROW), medium of each body, then of the (isotropic) world
    k0 : 2 pi / wavelength [1/mm]
    start : (NODE,) the root, weight 1
    max_events : branches that need more surface events than this are truncated
    tolerance : share that may be left out; 0 grows everything above 1e-26 of the root
    coherent : carry phases along, so that fields of exits may be summed
    exits : (capacity, EXIT), filled

    Returns
    -------
    number of exits, and the shares pruned, truncated, absorbed
    """
    work, cwork, modes, frame, out, nodes, heap, free, field, stack, child = scratch
    at_interface = InterfaceScratch(work, cwork, modes, frame)
    capacity = heap.shape[0]
    world = media.shape[0] - 1
    n_exits = 0
    pruned = 0.0
    truncated = 0.0
    absorbed = 0.0
    for k in range(capacity):
        free[k] = k
    used = 1
    waiting = 1
    open_weight = start[_WEIGHT]
    summed = open_weight
    least = max(tolerance, 1e-26 * open_weight)
    _copy(start, nodes, 0)
    heap[0] = 0
    while waiting > 0 and open_weight > least:
        # Take the heaviest branch and move it to its next boundary
        slot = _pop(nodes, heap, waiting)
        waiting -= 1
        node = nodes[slot]
        weight = node[_WEIGHT]
        open_weight -= weight
        body = int(node[_BODY])
        t, met, nx, ny, nz, _ = next_boundary(
            bodies, node[0:3], node[6], node[7], node[8], body, int(node[_LEFT]), stack
        )
        if met < 0:
            # Only the root can get here, or a branch that slipped through a mesh
            if body < 0 and n_exits < exits.shape[0]:
                _copy(node, exits, n_exits)
                n_exits += 1
            else:
                pruned += weight
            used -= 1
            free[used] = slot
            continue
        x = node[0] + t * node[6]
        y = node[1] + t * node[7]
        z = node[2] + t * node[8]

        # Carry phase and absorption along
        for i in range(3):
            field[i] = complex(node[9 + i], node[12 + i])
        if coherent:
            path = k0 * t * (node[3] * node[6] + node[4] * node[7] + node[5] * node[8])
            turn = complex(math.cos(path), math.sin(path))
            for i in range(3):
                field[i] *= turn
        if body >= 0:
            rate = ray_absorption(
                media[body], node[3], node[4], node[5], field[0], field[1], field[2]
            )
            if rate > 0.0:
                kept = math.exp(-k0 * rate * t)
                absorbed += weight * (1.0 - kept)
                weight *= kept
                for i in range(3):
                    field[i] *= math.sqrt(kept)

        # Find the media on both sides, with the normal along the ray
        if body >= 0:
            behind = body_behind(bodies, body, x, y, z, nx, ny, nz) if bodies.contacts else -1
        else:
            behind = met
            nx, ny, nz = -nx, -ny, -nz
        row_1 = media[body] if body >= 0 else media[world]
        row_2 = media[behind] if behind >= 0 else media[world]
        n1x, n1y, n1z = node[3], node[4], node[5]
        events = node[_EVENTS] + 1.0

        # Meet the boundary; natural light as two orthogonal states
        passes = 1
        if node[_UNPOLARISED] > 0.5:
            passes = 2
            ax, ay, az = node[6], node[7], node[8]
            if abs(ax * nx + ay * ny + az * nz) > 1.0 - 1e-12:
                bx, by, bz = (0.0, 1.0, 0.0) if abs(ax) > 0.5 else (1.0, 0.0, 0.0)
            else:
                bx, by, bz = nx, ny, nz
            sx = ay * bz - az * by
            sy = az * bx - ax * bz
            sz = ax * by - ay * bx
            size = math.sqrt(sx * sx + sy * sy + sz * sz)
            sx, sy, sz = sx / size, sy / size, sz / size
            field[0], field[1], field[2] = sx + 0.0j, sy + 0.0j, sz + 0.0j
            tx = ay * sz - az * sy
            ty = az * sx - ax * sz
            tz = ax * sy - ay * sx
        for k in range(passes):
            if k == 1:
                field[0], field[1], field[2] = tx + 0.0j, ty + 0.0j, tz + 0.0j
            interface_event(row_1, row_2, n1x, n1y, n1z, field, nx, ny, nz, out[k], at_interface)
        used -= 1
        free[used] = slot

        for j in range(4):
            # In a crystal both states of natural light feed the same two waves
            target = body if j < 2 else behind
            merge = passes == 2 and target >= 0 and row_2[KIND] != ISOTROPIC
            for k in range(passes):
                if merge and k == 1:
                    continue
                source = k
                share = out[k, j, 12] / passes
                if merge:
                    share += out[1, j, 12] / passes
                    if out[1, j, 12] > out[0, j, 12]:
                        source = 1
                branch = weight * share
                if out[source, j, 15] == 0.0 or branch <= 0.0:
                    continue
                row = child[0]
                row[0], row[1], row[2] = x, y, z
                for i in range(3):
                    row[3 + i] = out[source, j, i]
                    row[6 + i] = out[source, j, 3 + i]
                    row[9 + i] = out[source, j, 6 + i]
                    row[12 + i] = out[source, j, 9 + i]
                row[_WEIGHT] = branch
                row[_EVENTS] = events
                row[_BODY] = target
                row[_LEFT] = body if body >= 0 else (met if j < 2 else -1)
                row[_UNPOLARISED] = 0.0

                # Out into the world: gone, unless another boundary stands in the way
                if target < 0:
                    _, hit, _, _, _, _ = next_boundary(
                        bodies, row[0:3], row[6], row[7], row[8], -1, int(row[_LEFT]), stack
                    )
                    if hit < 0:
                        if n_exits < exits.shape[0]:
                            _copy(row, exits, n_exits)
                            n_exits += 1
                        else:
                            pruned += branch
                        continue
                if events >= max_events:
                    truncated += branch
                elif used >= capacity or branch < 1e-6 * tolerance:
                    pruned += branch
                else:
                    slot = int(free[used])
                    used += 1
                    _copy(row, nodes, slot)
                    _push(nodes, heap, waiting, slot)
                    waiting += 1
                    open_weight += branch
        # Sum anew now and then: what rounding leaves would hide faint branches
        if open_weight < 1e-3 * summed:
            open_weight = 0.0
            for k in range(waiting):
                open_weight += nodes[heap[k], _WEIGHT]
            summed = open_weight
    return n_exits, pruned + open_weight, truncated, absorbed
