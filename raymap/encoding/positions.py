"""Positions against the shape of the face: a coordinate that the shape implies is not stored.

All arithmetic is float64 with + - x / and square root in the order written here, so that any
reader gets the same integers. (Compilers must not fuse multiplications and additions.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.pathstreams import Reader
from raymap.encoding.shapes import LEFT, ShapedRecords
from raymap.jit.kernels import inner_kernel, kernel, lean_kernel
from raymap.model.errors import FormatError

__all__ = [
    "rebuild_positions",
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


def rebuild_positions(
    records: ShapedRecords, read: Reader, *, solve_faces: bool, solve_sphere: bool
) -> NDArray[np.float32]:
    """Positions of which a coordinate was left out where the shape implies it.

    Parameters
    ----------
    read : (name, rows, dtype) -> column
    solve_faces, solve_sphere : left out on faces, on the bounding sphere

    Returns
    -------
    position : (n_records, 3) float32

    Raises
    ------
    FormatError
        The streams do not fit the records.
    """
    shapes = records.shapes
    x, y, z = (read(f"position.{name}", None, np.float32) for name in "xyz")
    position = np.empty((len(records), 3), np.float32)
    bits = position.view(np.int32)
    solved = np.empty(len(records), np.int32)
    n = _join_coordinates(
        records.codes,
        shapes.axis,
        solve_faces,
        solve_sphere,
        x.view(np.int32),
        y.view(np.int32),
        z.view(np.int32),
        bits,
        solved,
    )
    if n < 0:
        raise FormatError("positions do not fit the paths")
    residual, roots = (
        read("position.residual", n, np.uint32), read("position.root", n, np.uint8)
    )  # fmt: skip
    if not len(residual) == len(roots) == n:
        raise FormatError("residuals of positions do not fit the paths")
    _solve_positions(
        solved[:n], records.codes, shapes.solve, shapes.axis, residual, roots, position, bits
    )
    return position


@inner_kernel
def _solved_axis(code: int, axis: NDArray[np.int8], solve_faces: bool, solve_sphere: bool) -> int:
    """Coordinate that is not stored for a record of this code, -1 none."""
    if code >= 0:
        return int(axis[code]) if solve_faces else -1
    if code == LEFT and solve_sphere:
        return int(axis[axis.size - 1])
    return -1


@lean_kernel
def _join_coordinates(
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
def _solve_positions(
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
