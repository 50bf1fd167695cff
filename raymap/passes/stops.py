"""Where recorded light meets stops that were not there: rings, rectangles, meshes of triangles.

A segment meets a flat stop where the signs of its ends differ, 0 being one of the positive numbers,
as it does a detector (`raymap.passes.crossings`). Light that leaves the scene goes on beyond its
last point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.model.errors import FormatError, RayMapError

__all__ = ["FlatStop", "MeshStop", "Stop", "StopTable", "Stopped"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
_LEAF = 4
"""Triangles of a box at the end of the tree."""
_DEEPEST = 64


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatStop:
    """A ring or rectangle that absorbs all light that meets it.

    Attributes
    ----------
    name : what it is called
    center, axis_u, axis_v : (3,) of its plane, unit vectors along it
    size : inner and outer radius of a ring; half width and half height of a rectangle
    is_ring : which of the two
    """

    name: str
    center: F64
    axis_u: F64
    axis_v: F64
    size: tuple[float, float]
    is_ring: bool

    @property
    def normal(self) -> F64:
        """(3,) its axis."""
        return np.cross(self.axis_u, self.axis_v)

    @property
    def count(self) -> int:
        """Primitives."""
        return 1

    def drawn(self) -> tuple[F64, I64]:
        """Vertices (n, 3) and triangles (m, 3) for pictures."""
        if not self.is_ring:
            w, h = self.size
            flat = np.array([[-w, -h], [w, -h], [w, h], [-w, h]])
            triangles = np.array([[0, 1, 2], [0, 2, 3]])
        else:
            angle = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
            circle = np.stack((np.cos(angle), np.sin(angle)), axis=1)
            flat = np.concatenate((self.size[0] * circle, self.size[1] * circle))
            k = np.arange(96)
            n = (k + 1) % 96
            triangles = np.concatenate(
                (np.stack((k, k + 96, n + 96), 1), np.stack((k, n + 96, n), 1))
            )
        return self.center + flat[:, :1] * self.axis_u + flat[:, 1:] * self.axis_v, triangles


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshStop:
    """Triangles that absorb all light that meets them, from either side.

    Attributes
    ----------
    name : what it is called
    vertices : (n, 3) [scene units]; triangles : (m, 3) rows of them
    """

    name: str
    vertices: F64
    triangles: I64

    @property
    def count(self) -> int:
        """Primitives."""
        return len(self.triangles)

    def drawn(self) -> tuple[F64, I64]:
        """Vertices (n, 3) and triangles (m, 3) for pictures."""
        return self.vertices, self.triangles


Stop = FlatStop | MeshStop


class Stopped(NamedTuple):
    """Where rays end, in the order of the rays; of those that meet a stop.

    Attributes
    ----------
    ray : (n,) in the portion
    record : (n,) that the segment starts at
    reach : (n,) where along it, 0 to 1, or beyond where light left the scene
    stop, primitive : (n,) which
    normal : (n, 3) unit vectors
    """

    ray: I64
    record: I64
    reach: F64
    stop: I64
    primitive: I64
    normal: F64


class _Tree(NamedTuple):
    """Boxes about triangles, each box holding two others or a run of triangles.

    Attributes
    ----------
    boxes : (n, 6) lowest and highest corner
    links : (n, 2) the two boxes; or -1 - first triangle and how many, negative and positive
    corners : (m, 3, 3) of the triangles
    owner : (m, 2) stop and primitive
    """

    boxes: F64
    links: I64
    corners: F64
    owner: I64


class StopTable:
    """Stops as compiled loops take them.

    Raises
    ------
    RayMapError
        A stop whose place and size are no numbers.
    """

    def __init__(self, stops: tuple[Stop, ...]) -> None:
        self.stops = stops
        rows, owners, corners = [], [], []
        for number, stop in enumerate(stops):
            if isinstance(stop, FlatStop):
                frame = (*stop.center, *stop.axis_u, *stop.axis_v, *stop.normal)
                rows.append((*frame, *stop.size, float(stop.is_ring), float(number)))
            else:
                corners.append(stop.vertices[stop.triangles])
                own = np.arange(stop.count)
                owners.append(np.stack((np.full(stop.count, number), own), axis=1))
        self.flat = np.array(rows, np.float64).reshape(-1, 16)
        triangles = np.concatenate(corners) if corners else np.empty((0, 3, 3))
        owner = np.concatenate(owners) if owners else np.empty((0, 2), np.int64)
        if not (np.isfinite(self.flat).all() and np.isfinite(triangles).all()):
            raise RayMapError("the places and sizes of stops are numbers")
        self.tree = _tree_of(np.asarray(triangles, np.float64), owner.astype(np.int64))

    def meet(self, position: Any, offsets: I64, left: NDArray[np.bool_]) -> Stopped:
        """The first stop on the way of each ray of a portion.

        Parameters
        ----------
        position : (n_records, 3)
        offsets : (n_rays + 1,) records of each ray
        left : (n_rays,) whether it left the scene, going on beyond its last point
        """
        n = len(offsets) - 1
        sound = n >= 0 and not offsets[0] and not (np.diff(offsets) < 0).any()
        if not sound or position.shape != (int(offsets[-1]), 3) or left.shape != (n,):
            raise FormatError(f"positions {position.shape} are not those of the rays")
        record, stop, primitive = np.empty((3, n), np.int64)
        every = Stopped(np.arange(n), record, np.empty(n), stop, primitive, np.empty((n, 3)))
        stack = np.empty(_DEEPEST, np.int64)
        _meet_stops(self.flat, self.tree, position, offsets, left, every, stack)
        ray = np.flatnonzero(stop >= 0)
        return Stopped(
            ray, record[ray], every.reach[ray], stop[ray], primitive[ray], every.normal[ray]
        )


def _tree_of(corners: F64, owner: I64) -> _Tree:
    """Boxes about triangles, halved along their longest side."""
    if not len(corners):
        return _Tree(np.empty((0, 6)), np.empty((0, 2), np.int64), corners, owner)
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = 0.5 * (low + high)
    order = np.arange(len(corners))
    boxes: list[Any] = []
    links: list[list[int]] = []
    waiting = [(0, len(corners), -1, 0)]
    while waiting:
        first, end, parent, side = waiting.pop()
        own = order[first:end]
        if parent >= 0:
            links[parent][side] = len(boxes)
        boxes.append((*low[own].min(axis=0), *high[own].max(axis=0)))
        if end - first <= _LEAF:
            links.append([-1 - first, end - first])
            continue
        spread = np.ptp(middle[own], axis=0)
        half = (end - first) // 2
        order[first:end] = own[np.argpartition(middle[own, int(spread.argmax())], half)]
        number = len(links)
        links.append([0, 0])
        waiting.append((first + half, end, number, 1))
        waiting.append((first, first + half, number, 0))
    return _Tree(
        np.array(boxes), np.array(links, np.int64), corners[order].copy(), owner[order].copy()
    )


@lean_kernel
def _meet_stops(
    flat: F64, tree: _Tree, position: NDArray[np.float32], offsets: I64, left: NDArray[np.bool_],
    out: Stopped, stack: I64,
) -> None:  # fmt: skip
    """Fill ``out`` for every ray; its stop is -1 where there is none."""
    boxes, links, corners, owner = tree.boxes, tree.links, tree.corners, tree.owner
    record, reach, stop, primitive, normal = (
        out.record, out.reach, out.stop, out.primitive, out.normal
    )  # fmt: skip
    for ray in range(len(offsets) - 1):
        stop[ray] = -1
        last = offsets[ray + 1] - 1
        for i in range(offsets[ray], last):
            px = np.float64(position[i, 0])
            py = np.float64(position[i, 1])
            pz = np.float64(position[i, 2])
            dx = np.float64(position[i + 1, 0]) - px
            dy = np.float64(position[i + 1, 1]) - py
            dz = np.float64(position[i + 1, 2]) - pz
            if dx == 0.0 and dy == 0.0 and dz == 0.0:
                continue
            leaves = left[ray] and i == last - 1
            nearest = math.inf if leaves else 1.0
            found = -1
            for k in range(len(flat)):
                t = _reach_flat(flat[k], px, py, pz, dx, dy, dz, leaves)
                if t >= 0.0 and (t < nearest or (found < 0 and t <= nearest)):
                    nearest, found = t, k
            if found >= 0:
                stop[ray], primitive[ray] = int(flat[found, 15]), 0
                normal[ray, 0], normal[ray, 1] = flat[found, 9], flat[found, 10]
                normal[ray, 2] = flat[found, 11]
            if len(boxes):
                t, k = _reach_mesh(boxes, links, corners, px, py, pz, dx, dy, dz, nearest, stack)
                if k >= 0:
                    nearest, found = t, k
                    stop[ray], primitive[ray] = owner[k, 0], owner[k, 1]
                    _normal_of(corners[k], normal[ray])
            if found >= 0:
                record[ray], reach[ray] = i, nearest
                break


@inner_kernel
def _reach_flat(
    f: F64, px: float, py: float, pz: float, dx: float, dy: float, dz: float, leaves: bool
) -> float:
    """Where along the segment, -1 nowhere."""
    px, py, pz = px - f[0], py - f[1], pz - f[2]
    height = px * f[9] + py * f[10] + pz * f[11]
    d_n = dx * f[9] + dy * f[10] + dz * f[11]
    other = height + d_n
    if leaves:
        other = d_n * math.inf if d_n != 0.0 else height
    if (height < 0.0) == (other < 0.0):
        return -1.0
    t = -height / d_n
    qx, qy, qz = px + t * dx, py + t * dy, pz + t * dz
    u = qx * f[3] + qy * f[4] + qz * f[5]
    v = qx * f[6] + qy * f[7] + qz * f[8]
    if f[14] > 0.0:
        square = u * u + v * v
        inside = f[12] * f[12] <= square <= f[13] * f[13]
    else:
        inside = abs(u) <= f[12] and abs(v) <= f[13]
    return max(t, 0.0) if inside else -1.0


@inner_kernel
def _reach_mesh(
    boxes: F64, links: I64, corners: F64, px: float, py: float, pz: float, dx: float, dy: float,
    dz: float, most: float, stack: I64,
) -> tuple[float, int]:  # fmt: skip
    """The nearest triangle before ``most``: where along the segment, and its row, -1 none."""
    nearest, found = most, -1
    depth = 1
    stack[0] = 0
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if not _meets_box(boxes[node], px, py, pz, dx, dy, dz, nearest):
            continue
        first, second = links[node, 0], links[node, 1]
        if first >= 0:
            stack[depth], stack[depth + 1] = second, first
            depth += 2
            continue
        for k in range(-1 - first, -1 - first + second):
            t = _reach_triangle(corners[k], px, py, pz, dx, dy, dz)
            if 0.0 < t <= nearest and (t < nearest or found < 0):
                nearest, found = t, k
    return nearest, found


@inner_kernel
def _meets_box(
    box: F64, px: float, py: float, pz: float, dx: float, dy: float, dz: float, most: float
) -> bool:
    # A little wider, as a triangle may lie in a side of its box
    near, far = -1e-9, most
    for axis in range(3):
        p = px if axis == 0 else py if axis == 1 else pz
        d = dx if axis == 0 else dy if axis == 1 else dz
        low, high = box[axis], box[axis + 3]
        wider = 1e-9 * (abs(low) + abs(high) + abs(p))
        low, high = low - wider, high + wider
        if d == 0.0:
            if p < low or p > high:
                return False
            continue
        one, other = (low - p) / d, (high - p) / d
        if one > other:
            one, other = other, one
        near, far = max(near, one), min(far, other)
    return near <= far


@inner_kernel
def _reach_triangle(
    c: F64, px: float, py: float, pz: float, dx: float, dy: float, dz: float
) -> float:
    """Where along the segment, -1 nowhere (T. Möller, B. Trumbore, J. Graphics Tools 2, 21)."""
    ax, ay, az = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    bx, by, bz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    qx, qy, qz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    size = ax * qx + ay * qy + az * qz
    if size == 0.0:
        return -1.0
    sx, sy, sz = px - c[0, 0], py - c[0, 1], pz - c[0, 2]
    u = (sx * qx + sy * qy + sz * qz) / size
    rx, ry, rz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * rx + dy * ry + dz * rz) / size
    # Light must not slip through between neighbours
    if u < -1e-12 or v < -1e-12 or u + v > 1.0 + 1e-12:
        return -1.0
    return float((bx * rx + by * ry + bz * rz) / size)


@inner_kernel
def _normal_of(c: F64, normal: F64) -> None:
    ax, ay, az = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    bx, by, bz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    length = length if length > 0.0 else 1.0
    normal[0], normal[1], normal[2] = nx / length, ny / length, nz / length
