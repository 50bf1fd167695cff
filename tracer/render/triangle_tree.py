"""A tree of boxes over the triangles of a crystal, and the first triangle that a ray meets.

A scalar query inside compiled functions, which the branching tree of one ray needs; wavefronts of
many rays go through Embree instead.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel
from tracer.geometry.mesh_triangles import Line

__all__ = ["TriangleTree", "build_triangle_tree", "first_triangle"]

Real = NDArray[np.float64]
Array = np.ndarray[Any, np.dtype[Any]]

_LEAF = 4


class TriangleTree(NamedTuple):
    """Boxes (n, 6) min and max; links (n, 2): (first triangle, count) of a leaf, (right child, 0)
    of an inner node, whose left child follows it; triangles (m, 13): corner, two edges, normal,
    number in the mesh."""

    boxes: Real
    links: NDArray[np.int64]
    triangles: Real


def build_triangle_tree(vertices: Real, faces: NDArray[np.int64]) -> TriangleTree:
    """Split at the median of the longest side until few triangles are left."""
    corners = vertices[faces]
    centres = corners.mean(axis=1)
    boxes: list[Real] = []
    links: list[list[int]] = []
    order: list[NDArray[np.int64]] = []
    placed = 0

    def add(members: NDArray[np.int64]) -> None:
        nonlocal placed
        points = corners[members].reshape(-1, 3)
        boxes.append(np.concatenate([points.min(axis=0), points.max(axis=0)]))
        links.append([0, 0])
        node = len(links) - 1
        if len(members) <= _LEAF:
            links[node] = [placed, len(members)]
            order.append(members)
            placed += len(members)
            return
        side = int(np.argmax(np.ptp(centres[members], axis=0)))
        ranked = members[np.argsort(centres[members, side], kind="stable")]
        add(ranked[: len(ranked) // 2])
        links[node] = [len(links), 0]
        add(ranked[len(ranked) // 2 :])

    add(np.arange(len(faces)))
    ranks = np.concatenate(order)
    a, b, c = (corners[ranks, i] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return TriangleTree(
        boxes=np.array(boxes),
        links=np.array(links, np.int64),
        triangles=np.column_stack([a, b - a, c - a, normals, ranks]),
    )


@inner_kernel
def first_triangle(
    root: int,
    boxes: Array,
    links: Array,
    triangles: Array,
    line: Line,
    outward: bool,
    t_min: float,
    stack: Array,
) -> tuple[float, int]:
    """Distance and number of the nearest triangle met from inside (outward) or from outside.

    inf and -1 for none. ``stack`` is (64,) int64 scratch.
    """
    px, py, pz, dx, dy, dz = line
    best = np.inf
    found = -1
    ix = 1.0 / dx
    iy = 1.0 / dy
    iz = 1.0 / dz
    depth = 1
    stack[0] = root
    while depth > 0:
        depth -= 1
        node = stack[depth]

        # Clip the ray by the box
        x1 = (boxes[node, 0] - px) * ix
        x2 = (boxes[node, 3] - px) * ix
        y1 = (boxes[node, 1] - py) * iy
        y2 = (boxes[node, 4] - py) * iy
        z1 = (boxes[node, 2] - pz) * iz
        z2 = (boxes[node, 5] - pz) * iz
        near = max(max(min(x1, x2), min(y1, y2)), min(z1, z2))
        far = min(min(max(x1, x2), max(y1, y2)), max(z1, z2))
        if near > far * (1.0 + 1e-12) + 1e-12 or far < t_min or near > best:
            continue
        if links[node, 1] == 0:
            stack[depth] = links[node, 0]
            stack[depth + 1] = node + 1
            depth += 2
            continue

        # Meet the triangles of the leaf (Möller and Trumbore)
        for k in range(links[node, 0], links[node, 0] + links[node, 1]):
            tr = triangles[k]
            facing = tr[9] * dx + tr[10] * dy + tr[11] * dz
            if (facing > 0.0) != outward:
                continue
            hx = dy * tr[8] - dz * tr[7]
            hy = dz * tr[6] - dx * tr[8]
            hz = dx * tr[7] - dy * tr[6]
            determinant = tr[3] * hx + tr[4] * hy + tr[5] * hz
            if determinant == 0.0:
                continue
            sx = px - tr[0]
            sy = py - tr[1]
            sz = pz - tr[2]
            u = (sx * hx + sy * hy + sz * hz) / determinant
            if u < -1e-12 or u > 1.0 + 1e-12:
                continue
            qx = sy * tr[5] - sz * tr[4]
            qy = sz * tr[3] - sx * tr[5]
            qz = sx * tr[4] - sy * tr[3]
            v = (dx * qx + dy * qy + dz * qz) / determinant
            if v < -1e-12 or u + v > 1.0 + 1e-12:
                continue
            t = (tr[6] * qx + tr[7] * qy + tr[8] * qz) / determinant
            if t_min < t < best:
                best = t
                found = k
    return best, found
