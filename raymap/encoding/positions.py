"""Positions against the shape of the face: a coordinate that the shape implies is not stored.

All arithmetic is float64 with + - x / and square root in the order written here, so that any
reader gets the same integers. (Compilers must not fuse multiplications and additions.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.shapes import (
    LEFT,
    MANY,
    RayShapes,
    ShapeTable,
)
from raymap.jit.kernels import inner_kernel, kernel, lean_kernel

__all__ = [
    "join_coordinates",
    "resolve_codes",
    "solve_positions",
]

_LARGEST = 3.4e38


@inner_kernel
def _ordered(bits: np.int32) -> np.int32:
    """Order-preserving integer of a float32's bits (its own inverse)."""
    return np.int32(bits ^ ((bits >> 31) & 0x7FFFFFFF))


@inner_kernel
def _root(solve: NDArray[np.float64], q: int, u: float, v: float, second: int) -> np.float32:
    """One of the places where quadric q has the other two coordinates u and v."""
    # Compute the coefficients of the quadratic equation
    a = solve[q, 0]
    b = (solve[q, 1] * u + solve[q, 2] * v) + solve[q, 3]
    c = (((solve[q, 4] * u) * u + (solve[q, 5] * v) * v) + (solve[q, 6] * u) * v) + (
        (solve[q, 7] * u + solve[q, 8] * v) + solve[q, 9]
    )
    # Solve it without cancellation, and with one division
    discriminant = b * b - (4.0 * a) * c
    root = math.sqrt(discriminant if discriminant > 0.0 else 0.0)
    s = -0.5 * (b + (root if b >= 0.0 else -root))
    above = c if second else s
    below = s if second else a
    if a == 0.0:
        above = -c
        below = b
    t = above / below
    # Take 0 for what no float32 can hold, NaN included
    return np.float32(t if -_LARGEST <= t <= _LARGEST else 0.0)


@lean_kernel
def resolve_codes(rays: RayShapes, shapes: ShapeTable, codes: NDArray[np.int32]) -> None:
    """Shape code of each record; where its primitive has a quadric of its own, that one's row.

    Parameters
    ----------
    codes : (n_records,) out
    """
    many = rays.triangles.size > 0 and shapes.primitive_quadric.size > 0
    for ray in range(rays.numbers.size):
        row = rays.path_offsets[rays.numbers[ray]] - rays.record_offsets[ray]
        for i in range(rays.record_offsets[ray], rays.record_offsets[ray + 1]):
            code = rays.codes[row + i]
            if code <= MANY and many:
                face = MANY - code
                primitive = rays.triangles[i] - shapes.first_primitive[face]
                start = shapes.quadric_start[face]
                q = shapes.primitive_quadric[start + primitive] if start >= 0 else -1
                if q >= 0:
                    code = q
            codes[i] = code


@inner_kernel
def _solved_axis(code: int, axis: NDArray[np.int8], solve_faces: bool, solve_sphere: bool) -> int:
    """Coordinate that is not stored for a record of this code, -1 none."""
    if code >= 0:
        return int(axis[code]) if solve_faces else -1
    if code == LEFT and solve_sphere:
        return int(axis[axis.size - 1])
    return -1


@lean_kernel
def join_coordinates(
    codes: NDArray[np.int32],
    axis: NDArray[np.int8],
    solve_faces: bool,
    solve_sphere: bool,
    xs: NDArray[np.int32],
    ys: NDArray[np.int32],
    zs: NDArray[np.int32],
    bits: NDArray[np.int32],
    solved: NDArray[np.int32],
) -> int:
    """Put the stored coordinates in place, axis by axis.

    Returns
    -------
    n : records that have one to be solved for, into `solved`; -1 where the columns misfit
    """
    nx, ny, nz, n = 0, 0, 0, 0
    for i in range(codes.size):
        a = _solved_axis(codes[i], axis, solve_faces, solve_sphere)
        if a != 0:
            if nx == xs.size:
                return -1
            bits[i, 0] = xs[nx]
            nx += 1
        if a != 1:
            if ny == ys.size:
                return -1
            bits[i, 1] = ys[ny]
            ny += 1
        if a != 2:
            if nz == zs.size:
                return -1
            bits[i, 2] = zs[nz]
            nz += 1
        if a >= 0:
            solved[n] = i
            n += 1
    return n if nx == xs.size and ny == ys.size and nz == zs.size else -1


@kernel
def solve_positions(
    solved: NDArray[np.int32],
    codes: NDArray[np.int32],
    solve: NDArray[np.float64],
    axis: NDArray[np.int8],
    residual: NDArray[np.uint32],
    roots: NDArray[np.uint8],
    position: NDArray[np.float32],
    bits: NDArray[np.int32],
) -> None:
    """Fill in the coordinates solved for: root of the quadric, then steps of float32 from it."""
    last_root = np.zeros(axis.size, np.uint8)
    for k in range(solved.size):
        i = solved[k]
        q = codes[i] if codes[i] >= 0 else axis.size - 1
        a = axis[q]
        u = np.float64(position[i, 1 if a == 0 else 0])
        v = np.float64(position[i, 1 if a == 2 else 2])
        last_root[q] ^= roots[k] & 1
        t = np.float32(_root(solve, q, u, v, last_root[q]))
        code = np.int64(residual[k])
        r = (code >> 1) ^ -(code & 1)
        bits[i, a] = _ordered(np.int32(_ordered(t.view(np.int32)) + r))
