"""Orthonormal frames about a direction, and the step that keeps directions of unit length.

There are two frames: any one about a direction (`frame_about`), and the one whose first axis is the
part of a given vector across the direction (`frame_towards`), of which the plane of incidence is a
case (`s_vector`). Frames are right-handed: y = n x x.

References
----------
T. Duff et al., Building an orthonormal basis, revisited, J. Comput. Graph. Tech. 6(1) (2017).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inline_kernel, inner_kernel, kernel, lean_kernel

__all__ = [
    "frame_about",
    "frame_of",
    "frame_towards",
    "s_vector",
    "transverse_axes",
    "turn_to",
    "unit_factor",
]

Real = NDArray[np.float64]
Frame = tuple[float, float, float, float, float, float]
LongFrame = tuple[float, float, float, float, float, float, float]

_WIDE = 0.1
"""Squared sine between two directions from which on rounding of a projection needs no second."""

_ALONG = 1e-14
"""Sine between two directions below which they count as one: rounding alone."""


@inline_kernel
def unit_factor(x: float, y: float, z: float) -> float:
    """What brings a vector that is a unit vector but for rounding back to length 1.

    A step of Newton's for the root. Without it the error of a direction grows fivefold at each
    reflection of a strongly curved face.
    """
    return 1.5 - 0.5 * (x * x + y * y + z * z)


@inline_kernel
def frame_about(nx: float, ny: float, nz: float) -> Frame:
    """Two unit vectors x, y across a unit vector n."""
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@inner_kernel
def frame_towards(
    nx: float, ny: float, nz: float, tx: float, ty: float, tz: float, sx: float, sy: float,
    sz: float,
) -> LongFrame:  # fmt: skip
    """Axes across a direction, the first towards a given vector.

    Parameters
    ----------
    n : unit vector
    t : vector towards which x points
    s : stands in for it where t lies along n

    Returns
    -------
    length : of the part of t across n, 0 where s stands in
    x, y : unit vectors, y = n x x
    """
    whole = tx * tx + ty * ty + tz * tz
    tx, ty, tz = _across(nx, ny, nz, tx, ty, tz)
    square = tx * tx + ty * ty + tz * tz
    length = math.sqrt(square)
    if square <= _ALONG * _ALONG * whole:
        length = 0.0
        tx, ty, tz = _across(nx, ny, nz, sx, sy, sz)
        square = tx * tx + ty * ty + tz * tz
    scale = 1.0 / math.sqrt(square)
    tx, ty, tz = tx * scale, ty * scale, tz * scale
    return length, tx, ty, tz, ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx


@inner_kernel
def _across(
    nx: float, ny: float, nz: float, tx: float, ty: float, tz: float
) -> tuple[float, float, float]:
    """Part of t across n; a second projection takes away what cancellation left along n."""
    along = tx * nx + ty * ny + tz * nz
    square = tx * tx + ty * ty + tz * tz
    tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
    if square - along * along < _WIDE * square:
        along = tx * nx + ty * ny + tz * nz
        tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
    return tx, ty, tz


@kernel
def s_vector(
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float
) -> tuple[float, float, float]:
    """Unit vector s = d x n / |d x n| perpendicular to the plane of incidence.

    At normal incidence any one across d: of the coordinate axis that is least parallel to it.
    """
    ax, ay, az = _least_parallel(dx, dy, dz)
    _, _, _, _, sx, sy, sz = frame_towards(dx, dy, dz, nx, ny, nz, ax, ay, az)
    scale = unit_factor(sx, sy, sz)
    return sx * scale, sy * scale, sz * scale


@inner_kernel
def _least_parallel(x: float, y: float, z: float) -> tuple[float, float, float]:
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        return 1.0, 0.0, 0.0
    if abs(y) <= abs(z):
        return 0.0, 1.0, 0.0
    return 0.0, 0.0, 1.0


def transverse_axes(direction: ArrayLike, reference: ArrayLike | None = None) -> tuple[Real, Real]:
    """Two unit vectors x, y perpendicular to a direction, with d x x = y.

    Parameters
    ----------
    direction : (..., 3) unit vectors
    reference : (..., 3), x is its part perpendicular to d; without it, and where it is parallel to
        d, the coordinate axis that is least parallel to d

    Returns
    -------
    x, y : (..., 3) float64
    """
    d = np.asarray(direction, np.float64)
    wanted = np.zeros(3) if reference is None else np.asarray(reference, np.float64)
    shape = np.broadcast_shapes(d.shape, wanted.shape)
    d, wanted = (np.array(np.broadcast_to(item, shape)).reshape(-1, 3) for item in (d, wanted))
    x, y = np.empty((2, *d.shape))
    _fill_axes(d, wanted, x, y)
    return x.reshape(shape), y.reshape(shape)


@lean_kernel
def _fill_axes(direction: Real, wanted: Real, x: Real, y: Real) -> None:
    for i in range(len(direction)):
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        ax, ay, az = _least_parallel(dx, dy, dz)
        _, x[i, 0], x[i, 1], x[i, 2], y[i, 0], y[i, 1], y[i, 2] = frame_towards(
            dx, dy, dz, wanted[i, 0], wanted[i, 1], wanted[i, 2], ax, ay, az
        )


def frame_of(axis: ArrayLike) -> Real:
    """(3, 3) orthonormal rows (u, v, axis) with u along +x where that is possible, else along +y.

    Parameters
    ----------
    axis : (3,) of any length but 0
    """
    w = np.asarray(axis, np.float64)
    w = w / np.linalg.norm(w)
    u, v = transverse_axes(w, (1.0, 0.0, 0.0) if abs(w[0]) < 0.9 else (0.0, 1.0, 0.0))
    return np.array([u, v, w])


def turn_to(axis: ArrayLike) -> Real:
    """(3, 3) the least rotation that takes +z to an axis; its columns are the turned axes.

    The opposite direction, to which many rotations are equally near, is reached about x.
    """
    w = np.asarray(axis, np.float64)
    w = w / np.linalg.norm(w)
    if w[2] < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    skew = np.array([[0.0, 0.0, w[0]], [0.0, 0.0, w[1]], [-w[0], -w[1], 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + w[2]))
