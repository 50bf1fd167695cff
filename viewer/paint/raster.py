"""Draw very many line segments into a picture, without a graphics library.

Software OpenGL needs seconds for a million translucent lines; this draws them in a fraction of one
on every machine alike, antialiased, with any width, and the same to the last bit whatever the
number of threads: each thread owns a band of rows and goes through all segments in order.
"""

from __future__ import annotations

import itertools
import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from raymap.model.errors import RayMapError

__all__ = ["NEAR", "WIDEST", "draw_segments"]

WIDEST = 1000.0
"""Width of a line [pixels] at most."""

NEAR = 1e-3
"""Points nearer to a perspective camera than this part of its distance are cut away."""


@kernel
def _draw_band(
    segments: NDArray[np.float32],
    rgba: NDArray[np.uint8],
    matrix: NDArray[np.float64],
    line_width: float,
    depth: NDArray[np.float32],
    image: NDArray[np.float32],
    first_row: int,
    last_row: int,
) -> None:
    """Blend segments over rows ``first_row:last_row``; colours are premultiplied by alpha."""
    columns = depth.shape[1]
    depth_of = depth.reshape(-1)
    pixels = image.reshape(-1, 4)
    margin = line_width + 2.0
    low_x, high_x = -margin, columns + margin
    low_y, high_y = first_row - margin, last_row + margin
    # Scalars, so that the loop over segments keeps the matrix in registers
    m00, m01, m02, m03 = matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[0, 3]
    m10, m11, m12, m13 = matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[1, 3]
    m20, m21, m22, m23 = matrix[2, 0], matrix[2, 1], matrix[2, 2], matrix[2, 3]
    m30, m31, m32, m33 = matrix[3, 0], matrix[3, 1], matrix[3, 2], matrix[3, 3]
    for i in range(segments.shape[0]):
        if rgba[i, 3] == 0:
            continue

        # Transform both ends to homogeneous pixels
        ax, ay, az = segments[i, 0, 0], segments[i, 0, 1], segments[i, 0, 2]
        bx, by, bz = segments[i, 1, 0], segments[i, 1, 1], segments[i, 1, 2]
        wa = m30 * ax + m31 * ay + m32 * az + m33
        wb = m30 * bx + m31 * by + m32 * bz + m33
        if not (wa >= NEAR or wb >= NEAR):
            continue
        xa = m00 * ax + m01 * ay + m02 * az + m03
        xb = m00 * bx + m01 * by + m02 * bz + m03
        ya = m10 * ax + m11 * ay + m12 * az + m13
        yb = m10 * bx + m11 * by + m12 * bz + m13
        za = m20 * ax + m21 * ay + m22 * az + m23
        zb = m20 * bx + m21 * by + m22 * bz + m23

        # Cut what is behind the camera, then divide
        if wa < NEAR:
            t = (NEAR - wa) / (wb - wa)
            xa, ya, za, wa = xa + t * (xb - xa), ya + t * (yb - ya), za + t * (zb - za), NEAR
        elif wb < NEAR:
            t = (NEAR - wb) / (wa - wb)
            xb, yb, zb, wb = xb + t * (xa - xb), yb + t * (ya - yb), zb + t * (za - zb), NEAR
        xa, ya, za = xa / wa, ya / wa, za / wa
        xb, yb, zb = xb / wb, yb / wb, zb / wb

        # Clip to the band (Liang and Barsky)
        dx, dy, dz = xb - xa, yb - ya, zb - za
        t0, t1 = 0.0, 1.0
        for side in range(4):
            if side == 0:
                p, q = -dx, xa - low_x
            elif side == 1:
                p, q = dx, high_x - xa
            elif side == 2:
                p, q = -dy, ya - low_y
            else:
                p, q = dy, high_y - ya
            if p < 0.0:
                t0 = max(t0, q / p)
            elif p > 0.0:
                t1 = min(t1, q / p)
            elif not q >= 0.0:
                t1 = -1.0
        if not t0 <= t1:
            continue
        xa, ya, za, xb, yb, zb = (
            xa + t0 * dx, ya + t0 * dy, za + t0 * dz,
            xa + t1 * dx, ya + t1 * dy, za + t1 * dz,
        )  # fmt: skip

        # Walk along the longer axis: u along it, v across
        steep = abs(dy) > abs(dx)
        if steep:
            ua, va, ub, vb, size_u0, size_u1, size_v0, size_v1 = (
                ya, xa, yb, xb, first_row, last_row, 0, columns,
            )  # fmt: skip
        else:
            ua, va, ub, vb, size_u0, size_u1, size_v0, size_v1 = (
                xa, ya, xb, yb, 0, columns, first_row, last_row,
            )  # fmt: skip
        if ua > ub:
            ua, va, za, ub, vb, zb = ub, vb, zb, ua, va, za
        span = ub - ua
        slope = (vb - va) / span if span > 0.0 else 0.0
        slope_z = (zb - za) / span if span > 0.0 else 0.0
        half = 0.5 * line_width * math.sqrt(1.0 + slope * slope)
        alpha = rgba[i, 3] / 255.0
        red, green = np.float32(rgba[i, 0] / 255.0), np.float32(rgba[i, 1] / 255.0)
        blue, one = np.float32(rgba[i, 2] / 255.0), np.float32(1.0)
        stride_u, stride_v = (columns, 1) if steep else (1, columns)
        u_first, u_last = max(size_u0, math.floor(ua)), min(size_u1 - 1, math.floor(ub))
        for u in range(u_first, u_last + 1):
            covered_u = min(ub, u + 1.0) - max(ua, float(u))
            middle = min(max(u + 0.5, ua), ub) - ua
            low = va + slope * middle - half
            high = low + 2.0 * half
            z = np.float32(za + slope_z * middle)
            strength = alpha * covered_u
            v_first, v_last = max(size_v0, math.floor(low)), min(size_v1 - 1, math.floor(high))
            for v in range(v_first, v_last + 1):
                pixel = np.uint64(u * stride_u + v * stride_v)
                a = np.float32(strength * (min(high, v + 1.0) - max(low, float(v))))
                if z > depth_of[pixel]:
                    continue

                # Blend over
                keep = one - a
                pixels[pixel, np.uint64(0)] = a * red + keep * pixels[pixel, np.uint64(0)]
                pixels[pixel, np.uint64(1)] = a * green + keep * pixels[pixel, np.uint64(1)]
                pixels[pixel, np.uint64(2)] = a * blue + keep * pixels[pixel, np.uint64(2)]
                pixels[pixel, np.uint64(3)] = a + keep * pixels[pixel, np.uint64(3)]


def draw_segments(
    segments: NDArray[np.float32],
    rgba: NDArray[np.uint8],
    matrix: NDArray[np.float64],
    *,
    width: float,
    depth: NDArray[np.float32],
    image: NDArray[np.float32],
    threads: int | None = None,
) -> None:
    """Draw segments over a picture, in order.

    Parameters
    ----------
    segments : (n, 2, 3) float32, both ends [scene units]
    rgba : (n, 4) uint8, colour and opacity
    matrix : (4, 4) float64, world to pixels (`viewer.drawn.camera.view_matrix`)
    width : of the lines [pixels]
    depth : (height, width) float32, depth of opaque bodies; infinite where there is none
    image : (height, width, 4) float32, premultiplied, drawn over in place
    threads : bands of rows drawn at the same time; None takes the processors

    Raises
    ------
    RayMapError
        The width is no number of pixels above 0 and up to `WIDEST`, or arrays do not belong
        together.
    """
    if not 0.0 < width <= WIDEST:
        raise RayMapError(f"lines may be up to {WIDEST:g} pixels wide, not {width:g}")
    n = len(segments)
    shapes = (segments.shape, rgba.shape, matrix.shape, image.shape)
    if shapes != ((n, 2, 3), (n, 4), (4, 4), (*depth.shape, 4)) or depth.ndim != 2:
        raise RayMapError(f"segments, colours, matrix and picture do not fit together: {shapes}")
    rows = depth.shape[0]
    n_bands = max(1, min(threads or os.cpu_count() or 1, rows // 64 or 1))
    bounds = np.linspace(0, rows, n_bands + 1).astype(int)
    arguments = [
        (segments, rgba, matrix, float(width), depth, image, int(first), int(last))
        for first, last in itertools.pairwise(bounds)
    ]
    if len(segments) == 0:
        return
    if n_bands == 1 or len(segments) < 2000:
        for band in arguments:
            _draw_band(*band)
        return
    with ThreadPoolExecutor(n_bands) as pool:
        for done in [pool.submit(_draw_band, *band) for band in arguments]:
            done.result()
