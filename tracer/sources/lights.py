"""Emission of measured light: intensity tables, pictures, rings, lists of rays.

Scenes without such sources hand over None for the pool of light, and all of this is left out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64, I64
from tracer.compiled import (
    BY_TABLE,
    COLLIMATED,
    FROM_BOX,
    FROM_DISC,
    FROM_ELLIPSE,
    FROM_KIND,
    FROM_LIST,
    FROM_PICTURE,
    FROM_POINT,
    FROM_RECTANGLE,
    FROM_RING,
    L_AREA,
    L_CODE,
    L_DIRECTIONS,
    L_EMIT,
    LAMBERTIAN_CONE,
)
from tracer.rays.colors import COLORS
from tracer.rays.directions import about, sample_cosine_cone, sample_uniform_cone, sine_of
from tracer.rays.random import advance, five_uniform, stream_state, uniform
from tracer.sources.emission import emit_ray, place_on_area
from tracer.sources.openings import place_on_body
from tracer.sources.source import EMIT

__all__ = ["emit_light", "sample_intensity"]

F32 = NDArray[np.float32]
Emission = tuple[int, float, float, float, float, float, float, float, float, float, int, np.uint64]

_emit = EMIT.call

_SALT = 0x5EED_11
_MOST_TRIES = 100_000


@inline_kernel
def emit_light(
    source_i: I64, source_f: F64, pattern: I64, pool: F64 | None, rays: F32 | None, colors: F64,
    counters: I64, seed: int, ray_id: int,
) -> Emission:  # fmt: skip
    """Source, origin, direction, normal in the record, colour code and random state of a ray."""
    if pool is None or rays is None:
        source, x, y, z, dx, dy, dz, state = emit_ray(source_i, source_f, pattern, seed, ray_id)
        return (
            source, x, y, z, dx, dy, dz, source_f[source, 18], source_f[source, 19],
            source_f[source, 20], source_i[source, L_CODE], state,
        )  # fmt: skip
    return _emit_measured(source_i, source_f, pattern, pool, rays, colors, counters, seed, ray_id)


@inner_kernel
def _emit_measured(
    source_i: I64, source_f: F64, pattern: I64, pool: F64, rays: F32, colors: F64, counters: I64,
    seed: int, ray_id: int,
) -> Emission:  # fmt: skip
    turn = ray_id % len(pattern)
    source = pattern[turn]
    state = stream_state(seed, ray_id)
    s = source_f[source]
    area, kind = source_i[source, L_AREA], source_i[source, L_DIRECTIONS]
    code = source_i[source, L_CODE]
    first = int(s[21])
    if area == FROM_LIST:
        return _emit_listed(
            s, pool, rays, first, source, turn, code, colors, counters, seed, ray_id, state
        )
    if area == FROM_KIND:
        return _emit_by_kind(source_i, s, pool, first, source, code, state)
    # Choose a place
    x, y, z = s[0], s[1], s[2]
    nx, ny, nz = s[3], s[4], s[5]
    rx, ry, rz = s[18], s[19], s[20]
    a, b = 0.0, 0.0
    if area == FROM_PICTURE:
        a, b, code, state = _place_in_picture(s, pool, first, code, colors, counters, state)
    elif area != FROM_POINT and area < FROM_BOX:
        state = advance(state)
        u1 = uniform(state)
        state = advance(state)
        u2 = uniform(state)
        if area == FROM_ELLIPSE:
            a, b = place_on_area(FROM_DISC, 0.0, 1.0, u1, u2)
            a, b = a * s[12], b * s[13]
        else:
            flat = FROM_RECTANGLE if area == FROM_RECTANGLE else FROM_DISC
            a, b = place_on_area(flat, s[12], s[13], u1, u2)
    x += a * s[6] + b * s[9]
    y += a * s[7] + b * s[10]
    z += a * s[8] + b * s[11]
    if area == FROM_RING:
        # Lean the normal towards the axis
        radius = math.sqrt(a * a + b * b)
        along, across = math.cos(s[22]), -math.sin(s[22]) / radius
        nx = along * s[3] + across * (a * s[6] + b * s[9])
        ny = along * s[4] + across * (a * s[7] + b * s[10])
        nz = along * s[5] + across * (a * s[8] + b * s[11])
        rx, ry, rz = nx, ny, nz
    # Choose a direction
    if kind == COLLIMATED:
        return source, x, y, z, s[15], s[16], s[17], rx, ry, rz, code, state
    if kind == BY_TABLE:
        cosine, azimuth, state = sample_intensity(pool, first, state)
        sine = sine_of(cosine)
        p, q = sine * math.cos(azimuth), sine * math.sin(azimuth)
        dx = cosine * nx + p * s[6] + q * s[9]
        dy = cosine * ny + p * s[7] + q * s[10]
        dz = cosine * nz + p * s[8] + q * s[11]
        if area >= FROM_BOX:
            state = advance(state)
            u1 = uniform(state)
            state = advance(state)
            u2 = uniform(state)
            state = advance(state)
            u3 = uniform(state)
            a, b, c = place_on_body(area, s[12], s[13], s[22], p, q, cosine, u1, u2, u3)
            x += a * s[6] + b * s[9] + c * s[3]
            y += a * s[7] + b * s[10] + c * s[4]
            z += a * s[8] + b * s[11] + c * s[5]
        return source, x, y, z, dx, dy, dz, rx, ry, rz, code, state
    state = advance(state)
    u1 = uniform(state)
    state = advance(state)
    u2 = uniform(state)
    if kind == LAMBERTIAN_CONE:
        cosine = sample_cosine_cone(u1, s[14])
    else:
        cosine = sample_uniform_cone(u1, s[14])
    dx, dy, dz = about(nx, ny, nz, cosine, sine_of(cosine), u2)
    return source, x, y, z, dx, dy, dz, rx, ry, rz, code, state


@inner_kernel
def _emit_by_kind(
    source_i: I64, s: F64, pool: F64, first: int, source: int, code: int, state: np.uint64
) -> Emission:
    """Ask the kind of the source."""
    u, state = five_uniform(state)
    own = pool[first + 1 : first + 1 + int(pool[first])]
    a, b, c, p, q, r = _emit(source_i[source, L_EMIT], (own, u[0], u[1], u[2], u[3], u[4]))
    # Turn from the frame of the source
    x = s[0] + a * s[6] + b * s[9] + c * s[3]
    y = s[1] + a * s[7] + b * s[10] + c * s[4]
    z = s[2] + a * s[8] + b * s[11] + c * s[5]
    dx = p * s[6] + q * s[9] + r * s[3]
    dy = p * s[7] + q * s[10] + r * s[4]
    dz = p * s[8] + q * s[11] + r * s[5]
    scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
    return (
        source, x, y, z, dx * scale, dy * scale, dz * scale, s[18], s[19], s[20], code, state
    )  # fmt: skip


@inner_kernel
def sample_intensity(pool: F64, first: int, state: np.uint64) -> tuple[float, float, np.uint64]:
    """Cosine from the axis and azimuth about it, density I / flux per solid angle.

    I is linear in gamma and azimuth between the values of the table. A cell is chosen by its flux,
    then a direction in it is drawn evenly per solid angle and kept with I over its highest value
    there.
    """
    n, m = int(pool[first]), int(pool[first + 1])
    gammas = first + 2
    planes = gammas + n + 1
    running = planes + m + 1
    values = running + n * m
    state = advance(state)
    cell = _find(pool, running, n * m, uniform(state))
    i, j = cell // m, cell % m
    corner = values + i * (m + 1) + j
    i00, i01 = pool[corner], pool[corner + 1]
    i10, i11 = pool[corner + m + 1], pool[corner + m + 2]
    highest = max(max(i00, i01), max(i10, i11))
    low, high = pool[gammas + i], pool[gammas + i + 1]
    top, bottom = math.cos(low), math.cos(high)
    start, width = pool[planes + j], pool[planes + j + 1] - pool[planes + j]
    cosine, v = top, 0.0
    for _ in range(_MOST_TRIES):
        state = advance(state)
        cosine = top + uniform(state) * (bottom - top)
        state = advance(state)
        v = uniform(state)
        u = (math.acos(cosine) - low) / (high - low)
        here = (1.0 - u) * ((1.0 - v) * i00 + v * i01) + u * ((1.0 - v) * i10 + v * i11)
        state = advance(state)
        if uniform(state) * highest <= here:
            break
    return cosine, start + v * width, state


@inner_kernel
def _place_in_picture(
    s: F64, pool: F64, first: int, code: int, colors: F64, counters: I64, state: np.uint64
) -> tuple[float, float, int, np.uint64]:
    """Place in a picture by its light, and the colour of the pixel."""
    n, m = int(pool[first]), int(pool[first + 1])
    state = advance(state)
    pixel = _find(pool, first + 2, n * m, uniform(state))
    state = advance(state)
    u = (pixel % n + uniform(state)) / n
    state = advance(state)
    v = (pixel // n + uniform(state)) / m
    row = first + 2 + n * m + pixel * colors.shape[1]
    code = _color_of(pool, row, colors, counters)
    return (2.0 * u - 1.0) * s[12], (2.0 * v - 1.0) * s[13], code, state


@inner_kernel
def _emit_listed(
    s: F64, pool: F64, rays: F32, first: int, source: int, turn: int, code: int, colors: F64,
    counters: I64, seed: int, ray_id: int, state: np.uint64,
) -> Emission:  # fmt: skip
    """A ray of a list: drawn by its flux, or the next one.

    In order, the k-th ray of the source takes the place (k mod n + v) / n in the running sum of
    fluxes, v being one random number for each round through the list: rays of equal flux come one
    after the other, others as often as their flux says.
    """
    n = int(pool[first + 1])
    if pool[first + 3] > 0.0:
        length = int(pool[first + 5])
        k = (ray_id // length) * int(pool[first + 4]) + int(pool[first + 7 + turn])
        shift = uniform(advance(stream_state(seed ^ (_SALT + source), k // n)))
        place = (k % n + shift) / n
    else:
        state = advance(state)
        place = uniform(state)
    if pool[first + 2] > 0.0:
        chosen = min(n - 1, int(place * n))
    else:
        chosen = _find(pool, first + 7 + int(pool[first + 5]), n, place)
    row = rays[int(pool[first]) + chosen]
    color = int(row[6])
    if color >= 0:
        code = color
    elif color <= -2:
        palette = int(pool[first + 6]) + (-2 - color) * colors.shape[1]
        code = _color_of(pool, palette, colors, counters)
    # Turn from the frame of the source
    a, b, c = np.float64(row[0]), np.float64(row[1]), np.float64(row[2])
    x = s[0] + a * s[6] + b * s[9] + c * s[3]
    y = s[1] + a * s[7] + b * s[10] + c * s[4]
    z = s[2] + a * s[8] + b * s[11] + c * s[5]
    p, q, r = np.float64(row[3]), np.float64(row[4]), np.float64(row[5])
    scale = 1.0 / math.sqrt(p * p + q * q + r * r)
    p, q, r = p * scale, q * scale, r * scale
    dx = p * s[6] + q * s[9] + r * s[3]
    dy = p * s[7] + q * s[10] + r * s[4]
    dz = p * s[8] + q * s[11] + r * s[5]
    return source, x, y, z, dx, dy, dz, 0.0, 0.0, 0.0, code, state


@inner_kernel
def _color_of(pool: F64, first: int, colors: F64, counters: I64) -> int:
    """Code of a colour that stands in the pool: its only channel, or a new row."""
    n_channels: int = colors.shape[1]
    new = int(counters[COLORS])
    for k in range(n_channels):
        if pool[first + k] == 1.0:
            return k
        colors[new, k] = pool[first + k]
    counters[COLORS] = new + 1
    return n_channels + new


@inner_kernel
def _find(pool: F64, first: int, n: int, u: float) -> int:
    """The entry of a running sum (from ``first`` on, the last one 1) in whose share ``u`` falls."""
    low, high = 0, n - 1
    while low < high:
        middle = (low + high) // 2
        if u < pool[first + middle]:
            high = middle
        else:
            low = middle + 1
    return low
