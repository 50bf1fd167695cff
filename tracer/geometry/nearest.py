"""Nearest hit of many rays with one analytic face: loops that the compiler vectorises.

A bundle holds ``m`` rays. Every function improves the nearest hit found so far: it reads distance
and face from one row and writes them to another, those of face ``f`` where that is nearer. Reading
and writing different rows keeps the stores unconditional, and so the loops fast; arithmetic is
branch-free (a missing root is nan, every comparison with nan is false).

The surface that a ray has just left is excluded by its root t = 0, not as a whole: a ray may meet
the same curved surface again. For the own face the constant term of the quadratic is exactly zero,
so that one root is exactly zero and fails ``t > 0``.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64, I64, Integer
from tracer.geometry.doors import HIT
from tracer.geometry.kinds import (
    ANNULUS,
    ASPHERE,
    CONE,
    CONIC,
    CYLINDER,
    HIT_ADDRESS,
    POLYGON,
    RECTANGLE,
    SPHERE,
)

__all__ = ["DISTANCE", "OWN", "nearest_on_face"]

_hit = HIT.call

OWN = 0
DISTANCE = 6


@inner_kernel
def _annulus(table: F64, f: int, r: F64, h: I64, row: Integer, m: int) -> None:
    s = table[f]
    ox, oy, oz, nx, ny, nz, inner, outer = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
    b_in, b_out = 1 + row, 2 - row
    for i in range(m):
        wx = r[0, i] - ox
        wy = r[1, i] - oy
        wz = r[2, i] - oz
        t1 = -(wx * nx + wy * ny + wz * nz) / (r[3, i] * nx + r[4, i] * ny + r[5, i] * nz)
        px = wx + t1 * r[3, i]
        py = wy + t1 * r[4, i]
        pz = wz + t1 * r[5, i]
        r2 = px * px + py * py + pz * pz
        best = r[DISTANCE + row, i]
        take = (t1 > 0.0) & (t1 < best) & (r2 >= inner) & (r2 <= outer) & (h[OWN, i] != f)
        r[DISTANCE + 1 - row, i] = t1 if take else best
        h[b_out, i] = f if take else h[b_in, i]


@inner_kernel
def _rectangle(table: F64, f: int, r: F64, h: I64, row: Integer, m: int) -> None:
    s = table[f]
    ox, oy, oz, nx, ny, nz = s[0], s[1], s[2], s[3], s[4], s[5]
    ux, uy, uz, vx, vy, vz, width, height = s[6], s[7], s[8], s[9], s[10], s[11], s[12], s[13]
    b_in, b_out = 1 + row, 2 - row
    for i in range(m):
        wx = r[0, i] - ox
        wy = r[1, i] - oy
        wz = r[2, i] - oz
        t1 = -(wx * nx + wy * ny + wz * nz) / (r[3, i] * nx + r[4, i] * ny + r[5, i] * nz)
        px = wx + t1 * r[3, i]
        py = wy + t1 * r[4, i]
        pz = wz + t1 * r[5, i]
        u = abs(px * ux + py * uy + pz * uz)
        v = abs(px * vx + py * vy + pz * vz)
        best = r[DISTANCE + row, i]
        take = (t1 > 0.0) & (t1 < best) & (u <= width) & (v <= height) & (h[OWN, i] != f)
        r[DISTANCE + 1 - row, i] = t1 if take else best
        h[b_out, i] = f if take else h[b_in, i]


@inner_kernel
def _polygon(table: F64, f: int, pool: F64, r: F64, h: I64, row: Integer, m: int) -> None:
    s = table[f]
    ox, oy, oz, nx, ny, nz = s[0], s[1], s[2], s[3], s[4], s[5]
    first, count = int(s[6]), int(s[7])
    b_in, b_out = 1 + row, 2 - row
    for i in range(m):
        w_n = (r[0, i] - ox) * nx + (r[1, i] - oy) * ny + (r[2, i] - oz) * nz
        t1 = -w_n / (r[3, i] * nx + r[4, i] * ny + r[5, i] * nz)
        take = (t1 > 0.0) & (t1 < r[DISTANCE + row, i]) & (h[OWN, i] != f)
        if take:
            px = r[0, i] + t1 * r[3, i]
            py = r[1, i] + t1 * r[4, i]
            pz = r[2, i] + t1 * r[5, i]
            for k in range(4 * first, 4 * (first + count), 4):
                edge = pool[k] * px + pool[k + 1] * py + pool[k + 2] * pz
                if edge > pool[k + 3]:
                    take = False
                    break
        r[DISTANCE + 1 - row, i] = t1 if take else r[DISTANCE + row, i]
        h[b_out, i] = f if take else h[b_in, i]


@inner_kernel
def _sphere(table: F64, f: int, r: F64, h: I64, row: Integer, m: int) -> None:
    s = table[f]
    vx, vy, vz, ax, ay, az, radius, sag = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
    b_in, b_out, leaving = 1 + row, 2 - row, f + len(table)
    for i in range(m):
        # Solve t² + 2 b t + c = 0 in coordinates of the vertex: nothing large cancels
        wx = r[0, i] - vx
        wy = r[1, i] - vy
        wz = r[2, i] - vz
        w_a = wx * ax + wy * ay + wz * az
        d_a = r[3, i] * ax + r[4, i] * ay + r[5, i] * az
        b = wx * r[3, i] + wy * r[4, i] + wz * r[5, i] - radius * d_a
        c = wx * wx + wy * wy + wz * wz - 2.0 * radius * w_a
        c = 0.0 if h[OWN, i] == f else c
        root = math.sqrt(b * b - c)
        near = -b - root
        far = -b + root
        # Accept roots on the cap, the nearer one last
        best = r[DISTANCE + row, i]
        take_far = (far > 0.0) & (far < best) & (w_a + far * d_a <= sag)
        best = far if take_far else best
        take_near = (near > 0.0) & (near < best) & (w_a + near * d_a <= sag)
        r[DISTANCE + 1 - row, i] = near if take_near else best
        old = leaving if take_far else h[b_in, i]
        h[b_out, i] = f if take_near else old


@inner_kernel
def _cylinder(table: F64, f: int, r: F64, h: I64, row: Integer, m: int) -> None:
    s = table[f]
    ox, oy, oz, ax, ay, az = s[0], s[1], s[2], s[3], s[4], s[5]
    radius, low, high = s[6], s[7], s[8]
    b_in, b_out = 1 + row, 2 - row
    for i in range(m):
        wx = r[0, i] - ox
        wy = r[1, i] - oy
        wz = r[2, i] - oz
        w_a = wx * ax + wy * ay + wz * az
        d_a = r[3, i] * ax + r[4, i] * ay + r[5, i] * az
        # Project on the plane across the axis
        qx = wx - w_a * ax
        qy = wy - w_a * ay
        qz = wz - w_a * az
        ex = r[3, i] - d_a * ax
        ey = r[4, i] - d_a * ay
        ez = r[5, i] - d_a * az
        a = ex * ex + ey * ey + ez * ez
        b = qx * ex + qy * ey + qz * ez
        c = qx * qx + qy * qy + qz * qz - radius * radius
        c = 0.0 if h[OWN, i] == f else c
        root = math.sqrt(b * b - a * c)
        near = (-b - root) / a
        far = (-b + root) / a
        best = r[DISTANCE + row, i]
        height = w_a + far * d_a
        take_far = (far > 0.0) & (far < best) & (height >= low) & (height <= high)
        best = far if take_far else best
        height = w_a + near * d_a
        take_near = (near > 0.0) & (near < best) & (height >= low) & (height <= high)
        r[DISTANCE + 1 - row, i] = near if take_near else best
        h[b_out, i] = f if take_far | take_near else h[b_in, i]


@inner_kernel
def _cone(table: F64, f: int, r: F64, h: I64, row: Integer, m: int) -> None:
    s = table[f]
    ox, oy, oz, ax, ay, az = s[0], s[1], s[2], s[3], s[4], s[5]
    radius, slope, low, high = s[6], s[7], s[8], s[9]
    b_in, b_out = 1 + row, 2 - row
    for i in range(m):
        wx = r[0, i] - ox
        wy = r[1, i] - oy
        wz = r[2, i] - oz
        w_a = wx * ax + wy * ay + wz * az
        d_a = r[3, i] * ax + r[4, i] * ay + r[5, i] * az
        w_r = radius + slope * w_a
        # |w_perp + t d_perp|² = (w_r + t slope d_a)²
        a = 1.0 - d_a * d_a * (1.0 + slope * slope)
        b = wx * r[3, i] + wy * r[4, i] + wz * r[5, i] - w_a * d_a - w_r * slope * d_a
        c = wx * wx + wy * wy + wz * wz - w_a * w_a - w_r * w_r
        c = 0.0 if h[OWN, i] == f else c
        root = math.sqrt(b * b - a * c)
        q = -b - root if b > 0.0 else -b + root
        t1 = q / a
        t2 = c / q
        best = r[DISTANCE + row, i]
        height = w_a + t1 * d_a
        take1 = (t1 > 0.0) & (t1 < best) & (height >= low) & (height <= high)
        best = t1 if take1 else best
        height = w_a + t2 * d_a
        take2 = (t2 > 0.0) & (t2 < best) & (height >= low) & (height <= high)
        r[DISTANCE + 1 - row, i] = t2 if take2 else best
        h[b_out, i] = f if take1 | take2 else h[b_in, i]


@inner_kernel
def _conic(table: F64, f: int, r: F64, h: I64, row: Integer, m: int) -> None:
    s = table[f]
    vx, vy, vz, ax, ay, az = s[0], s[1], s[2], s[3], s[4], s[5]
    curvature, shape, outer, inner = s[6], s[7], s[8], s[10]
    b_in, b_out = 1 + row, 2 - row
    for i in range(m):
        wx = r[0, i] - vx
        wy = r[1, i] - vy
        wz = r[2, i] - vz
        w_a = wx * ax + wy * ay + wz * az
        d_a = r[3, i] * ax + r[4, i] * ay + r[5, i] * az
        w_w = wx * wx + wy * wy + wz * wz
        w_d = wx * r[3, i] + wy * r[4, i] + wz * r[5, i]
        # curvature (r² + shape h²) - 2 h = 0 with h along the axis and r across it
        a = curvature * (1.0 + (shape - 1.0) * d_a * d_a)
        b = curvature * (w_d + (shape - 1.0) * w_a * d_a) - d_a
        c = curvature * (w_w + (shape - 1.0) * w_a * w_a) - 2.0 * w_a
        c = 0.0 if h[OWN, i] == f else c
        root = math.sqrt(b * b - a * c)
        q = -b - root if b > 0.0 else -b + root
        t1 = q / a
        t2 = c / q
        # Keep the sheet through the vertex, inside the aperture
        best = r[DISTANCE + row, i]
        height = w_a + t1 * d_a
        across = w_w + t1 * (2.0 * w_d + t1) - height * height
        sheet = curvature * shape * height < 1.0
        take1 = (t1 > 0.0) & (t1 < best) & (across <= outer) & (across >= inner) & sheet
        best = t1 if take1 else best
        height = w_a + t2 * d_a
        across = w_w + t2 * (2.0 * w_d + t2) - height * height
        sheet = curvature * shape * height < 1.0
        take2 = (t2 > 0.0) & (t2 < best) & (across <= outer) & (across >= inner) & sheet
        r[DISTANCE + 1 - row, i] = t2 if take2 else best
        h[b_out, i] = f if take1 | take2 else h[b_in, i]


@inner_kernel
def nearest_on_face(
    kind: int, table: F64, f: int, pool: F64 | None, r: F64, h: I64, row: Integer, m: int
) -> None:
    """Improve the nearest hit of ``m`` rays by face ``f``.

    Parameters
    ----------
    kind : of the face (`tracer.geometry.kinds`)
    table : (n_faces, ROW) parameter rows of all faces
    pool : half-planes of polygons, numbers of other shapes; None says that only the four common
        kinds occur
    r : (8, >= m) origin x, y, z, direction x, y, z, and two rows of distances
    h : (3, >= m) face on which each ray starts (-1 none), and two rows of faces met; n_faces more
        where the ray leaves a sphere through the face
    row : which of the two rows holds the nearest hit so far; the other one is written
    """
    if kind == SPHERE:
        _sphere(table, f, r, h, row, m)
    elif kind == ANNULUS:
        _annulus(table, f, r, h, row, m)
    elif kind == CYLINDER:
        _cylinder(table, f, r, h, row, m)
    elif kind == RECTANGLE:
        _rectangle(table, f, r, h, row, m)
    elif pool is not None:
        _nearest_on_rare_face(kind, table, f, pool, r, h, row, m)


@inner_kernel
def _nearest_on_rare_face(
    kind: int, table: F64, f: int, pool: F64, r: F64, h: I64, row: Integer, m: int
) -> None:
    """Faces that many scenes do without."""
    if kind == POLYGON:
        _polygon(table, f, pool, r, h, row, m)
    elif kind == CONE:
        _cone(table, f, r, h, row, m)
    elif kind == CONIC:
        _conic(table, f, r, h, row, m)
    elif kind == ASPHERE:
        asphere_nearest(table, f, r, h, row, m)
    else:
        _other_nearest(table, f, pool, r, h, row, m)


@inner_kernel
def _other_nearest(table: F64, f: int, pool: F64, r: F64, h: I64, row: Integer, m: int) -> None:
    """A shape of another distribution, asked ray by ray in its own frame."""
    s = table[f]
    ux, uy, uz, vx, vy, vz = s[3], s[4], s[5], s[6], s[7], s[8]
    tx, ty, tz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    own, address = pool[int(s[9]) : int(s[9]) + int(s[10])], int(s[HIT_ADDRESS])
    b_in, b_out = 1 + row, 2 - row
    for i in range(m):
        wx, wy, wz = r[0, i] - s[0], r[1, i] - s[1], r[2, i] - s[2]
        dx, dy, dz = r[3, i], r[4, i], r[5, i]
        t: float = _hit(
            address,
            (
                own, wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz,
                wx * tx + wy * ty + wz * tz, dx * ux + dy * uy + dz * uz,
                dx * vx + dy * vy + dz * vz, dx * tx + dy * ty + dz * tz, h[OWN, i] == f,
            ),
        )  # fmt: skip
        best = r[DISTANCE + row, i]
        take = (t > 0.0) & (t < best)
        r[DISTANCE + 1 - row, i] = t if take else best
        h[b_out, i] = f if take else h[b_in, i]


@inner_kernel
def asphere_sag(s: F64, r2: float) -> tuple[float, float]:
    """Sag of an even asphere at radius² ``r2`` and its derivative by ``r2``; nan outside it."""
    curvature, shape = s[6], s[7]
    root = math.sqrt(1.0 - shape * curvature * curvature * r2)
    sag = curvature * r2 / (1.0 + root)
    slope = 0.5 * curvature / root
    power = r2
    for k in range(6):
        slope += (k + 2) * s[10 + k] * power
        power *= r2
        sag += s[10 + k] * power
    return sag, slope


@inner_kernel
def asphere_nearest(table: F64, f: int, r: F64, h: I64, row: Integer, m: int) -> None:
    """Walk along each ray through the slab of the surface, then close in on the first hit."""
    s = table[f]
    vx, vy, vz, ax, ay, az, outer = (
        table[f, 0],
        table[f, 1],
        table[f, 2],
        table[f, 3],
        table[f, 4],
        table[f, 5],
        table[f, 8],
    )
    b_in, b_out = 1 + row, 2 - row
    low, high = asphere_range(s)
    for i in range(m):
        r[DISTANCE + 1 - row, i] = r[DISTANCE + row, i]
        h[b_out, i] = h[b_in, i]
        wx = r[0, i] - vx
        wy = r[1, i] - vy
        wz = r[2, i] - vz
        w_a = wx * ax + wy * ay + wz * az
        d_a = r[3, i] * ax + r[4, i] * ay + r[5, i] * az
        w_w = wx * wx + wy * wy + wz * wz
        w_d = wx * r[3, i] + wy * r[4, i] + wz * r[5, i]
        # Clip the ray to the cylinder of the aperture and the slab of the sag
        a = 1.0 - d_a * d_a
        b = w_d - w_a * d_a
        c = w_w - w_a * w_a - outer
        start, stop = 0.0, r[DISTANCE + row, i]
        if a > 1e-24:
            discriminant = b * b - a * c
            if discriminant < 0.0:
                continue
            root = math.sqrt(discriminant)
            start = max(start, (-b - root) / a)
            stop = min(stop, (-b + root) / a)
        elif c > 0.0:
            continue
        if d_a != 0.0:
            t1, t2 = (low - w_a) / d_a, (high - w_a) / d_a
            start = max(start, min(t1, t2))
            stop = min(stop, max(t1, t2))
        elif w_a < low or w_a > high:
            continue
        if not start < stop:
            continue
        # Step through the interval; a change of sign brackets a crossing
        steps = 16
        width = (stop - start) / steps
        left = start
        skip = h[OWN, i] == f and start == 0.0
        value_left = _asphere_value(s, w_a, d_a, w_w, w_d, left)
        if skip:
            # The root at t = 0 is where the ray starts; its side follows the slope there
            left = 1e-7 * width
            value_left = _asphere_value(s, w_a, d_a, w_w, w_d, left)
        for k in range(1, steps + 1):
            right = start + k * width
            value_right = _asphere_value(s, w_a, d_a, w_w, w_d, right)
            if (value_left < 0.0) != (value_right < 0.0):
                hit = _asphere_bracket(s, w_a, d_a, w_w, w_d, left, right, value_left)
                if 0.0 < hit < r[DISTANCE + row, i]:
                    r[DISTANCE + 1 - row, i] = hit
                    h[b_out, i] = f
                break
            left, value_left = right, value_right


@inner_kernel
def asphere_range(s: F64) -> tuple[float, float]:
    """Lowest and highest sag within the aperture, a little enlarged."""
    low, high = 0.0, 0.0
    for k in range(65):
        sag, _ = asphere_sag(s, s[8] * (k / 64.0) ** 2)
        low = min(low, sag)
        high = max(high, sag)
    margin = 1e-3 * (high - low) + 1e-9
    return low - margin, high + margin


@inner_kernel
def _asphere_value(s: F64, w_a: float, d_a: float, w_w: float, w_d: float, t: float) -> float:
    height = w_a + t * d_a
    r2 = w_w + t * (2.0 * w_d + t) - height * height
    sag, _ = asphere_sag(s, max(r2, 0.0))
    return height - sag


@inner_kernel
def _asphere_bracket(
    s: F64, w_a: float, d_a: float, w_w: float, w_d: float, left: float, right: float,
    value_left: float,
) -> float:  # fmt: skip
    t = 0.5 * (left + right)
    for _ in range(60):
        # Newton's step where it stays in the bracket, bisection elsewhere
        height = w_a + t * d_a
        r2 = w_w + t * (2.0 * w_d + t) - height * height
        sag, slope = asphere_sag(s, max(r2, 0.0))
        value = height - sag
        if (value < 0.0) == (value_left < 0.0):
            left = t
        else:
            right = t
        rate = d_a - slope * 2.0 * (w_d + t - height * d_a)
        step = value / rate
        guess = t - step
        if not (left < guess < right):
            guess = 0.5 * (left + right)
        if abs(guess - t) <= 4e-16 * abs(t) or guess == t:
            return guess
        t = guess
    return t
