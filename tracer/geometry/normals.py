"""Outward unit normals of analytic faces."""

from __future__ import annotations

import math

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64
from tracer.geometry.doors import NORMAL
from tracer.geometry.kinds import CONE, CONIC, CYLINDER, FIRST_OTHER, NORMAL_ADDRESS, SPHERE
from tracer.geometry.nearest import asphere_sag

__all__ = ["face_normal"]

_normal = NORMAL.call


@inline_kernel
def face_normal(
    kind: int, table: F64, f: int, pool: F64 | None, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Outward unit normal of a face at a point on it.

    Parameters
    ----------
    kind : of the face (`tracer.geometry.kinds`)
    table : (n_faces, ROW) parameter rows of all faces
    f : number of the face
    pool : numbers of other shapes; None says that there are none
    x, y, z : the point [scene units]
    """
    if kind == SPHERE:
        radius, scale = table[f, 6], table[f, 8]
        return (
            scale * (x - table[f, 0] - radius * table[f, 3]),
            scale * (y - table[f, 1] - radius * table[f, 4]),
            scale * (z - table[f, 2] - radius * table[f, 5]),
        )
    if kind < SPHERE:
        return table[f, 3], table[f, 4], table[f, 5]
    if pool is not None and kind >= FIRST_OTHER:
        return _other_normal(table, f, pool, x, y, z)
    return _normal_about_axis(kind, table, f, x, y, z)


@inner_kernel
def _other_normal(
    table: F64, f: int, pool: F64, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Normal of a shape of another distribution, asked in its own frame."""
    s = table[f]
    ux, uy, uz, vx, vy, vz = s[3], s[4], s[5], s[6], s[7], s[8]
    tx, ty, tz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    wx, wy, wz = x - s[0], y - s[1], z - s[2]
    a, b, c = _normal(
        int(s[NORMAL_ADDRESS]),
        (
            pool[int(s[9]) : int(s[9]) + int(s[10])], wx * ux + wy * uy + wz * uz,
            wx * vx + wy * vy + wz * vz, wx * tx + wy * ty + wz * tz,
        ),
    )  # fmt: skip
    return a * ux + b * vx + c * tx, a * uy + b * vy + c * ty, a * uz + b * vz + c * tz


@inner_kernel
def _normal_about_axis(
    kind: int, table: F64, f: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Normal of a surface of revolution."""
    wx, wy, wz = x - table[f, 0], y - table[f, 1], z - table[f, 2]
    ax, ay, az = table[f, 3], table[f, 4], table[f, 5]
    height = wx * ax + wy * ay + wz * az
    qx, qy, qz = wx - height * ax, wy - height * ay, wz - height * az
    if kind == CYLINDER:
        scale = table[f, 9] / math.sqrt(qx * qx + qy * qy + qz * qz)
        return scale * qx, scale * qy, scale * qz
    # Gradient of F(r², height): along = dF/dheight, across = 2 dF/d(r²)
    if kind == CONE:
        across = 1.0
        along = -table[f, 7] * (table[f, 6] + table[f, 7] * height)
        side = table[f, 10]
    elif kind == CONIC:
        across = table[f, 6]
        along = table[f, 6] * table[f, 7] * height - 1.0
        side = table[f, 9]
    else:
        _, slope = asphere_sag(table[f], qx * qx + qy * qy + qz * qz)
        across = 2.0 * slope
        along = -1.0
        side = table[f, 9]
    gx = across * qx + along * ax
    gy = across * qy + along * ay
    gz = across * qz + along * az
    scale = side / math.sqrt(gx * gx + gy * gy + gz * gz)
    return scale * gx, scale * gy, scale * gz
