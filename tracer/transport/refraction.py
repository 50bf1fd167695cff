"""Refraction at a bare or evenly coated lens face, many rays at a time.

Every function is a loop or a few over the columns of a stream of rays (`tracer.transport.streams`),
with the arithmetic and the random numbers that `tracer.surfaces.surface_hit` has for a single ray.
Each loop writes one row: the compiler vectorises what it can prove not to overlap.
"""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inner_kernel, unsigned
from raymap.jit.types import F64, I64, Integer
from raymap.optics.frames import unit_factor
from raymap.optics.fresnel import cos2_refracted, partial_reflectance
from tracer.compiled import M_DISPERSIVE, S_MODEL, SURFACE_ROW
from tracer.geometry.kinds import SPHERE
from tracer.geometry.nearest import DISTANCE
from tracer.rays.random import advance, uniform

__all__ = ["choose", "look_up", "meet_face", "reflectance", "turn"]

# Rows of stream_f: origin 0-2, direction 3-5, distances 6-7 (as in a bundle), then what a hit
# needs: indices before and beyond, random number, normal, point, direction after, what happens,
# cosine of incidence, ratio of indices, cosine² of refraction, scratch, factor of the normal
_N1, _N2, _U, NORMAL, POINT, AFTER, OUTCOME = 8, 9, 10, 11, 14, 17, 20
_COSINE, _ETA, _COS2, _SCRATCH, _ALONG = 21, 22, 23, 24, 25
# Rows of stream_i that are needed here
STREAM_RNG, STREAM_CODE = 4, 5
# What happens to a ray: it meets the face from the other side than most, crosses it, is reflected,
# is reflected totally
OTHER_SIDE, CROSSES, TURNS, TOTAL = 0.0, 1.0, 2.0, 3.0


@inner_kernel
def look_up(
    medium_i: I64,
    medium_f: F64,
    f: F64,
    g: I64,
    n_channels: int,
    medium: int,
    other: int,
    size: int,
) -> None:
    """Indices on both sides and the next random number of each ray."""
    if medium_i[medium, M_DISPERSIVE] == 0 and medium_i[other, M_DISPERSIVE] == 0:
        n1, n2 = medium_f[medium, 0], medium_f[other, 0]
        for j in range(size):
            f[_N1, j] = n1
        for j in range(size):
            f[_N2, j] = n2
    else:
        for j in range(size):
            code = g[STREAM_CODE, j]
            channel = unsigned(code if code < n_channels else 0)
            f[_N1, j] = medium_f[medium, channel]
            f[_N2, j] = medium_f[other, channel]
    for j in range(size):
        f[_U, j] = uniform(advance(np.uint64(g[STREAM_RNG, j])))


@inner_kernel
def meet_face(table: F64, face: int, kind: int, f: F64, row: Integer, size: int) -> None:
    """Points on the face, normals and angles there."""
    for k in range(3):
        for j in range(size):
            f[POINT + k, j] = f[k, j] + f[DISTANCE + row, j] * f[3 + k, j]
    if kind == SPHERE:
        scale, radius = table[face, 8], table[face, 6]
        for k in range(3):
            vertex, offset = table[face, k], radius * table[face, 3 + k]
            for j in range(size):
                f[NORMAL + k, j] = scale * (f[POINT + k, j] - vertex - offset)
    else:
        for k in range(3):
            component = table[face, 3 + k]
            for j in range(size):
                f[NORMAL + k, j] = component
    for j in range(size):
        f[_COSINE, j] = f[3, j] * f[NORMAL, j] + f[4, j] * f[NORMAL + 1, j] + f[5, j] * f[NORMAL + 2, j]  # noqa: E501  # fmt: skip
    for j in range(size):
        f[_ETA, j] = f[_N1, j] / f[_N2, j]
    for j in range(size):
        eta, cos_i = f[_ETA, j], min(1.0, abs(f[_COSINE, j]))
        f[_COS2, j] = cos2_refracted(eta, cos_i)


@inner_kernel
def reflectance(surface_i: I64, surface_f: F64, surface: int, f: F64, size: int) -> None:
    if surface_i[surface, S_MODEL] != 0:
        even = surface_f[surface, SURFACE_ROW]
        for j in range(size):
            f[_SCRATCH, j] = even
        return
    for j in range(size):
        n1, n2 = f[_N1, j], f[_N2, j]
        cos_i, cos_t = min(1.0, abs(f[_COSINE, j])), math.sqrt(max(f[_COS2, j], 0.0))
        f[_SCRATCH, j] = partial_reflectance(n1, n2, cos_i, cos_t)


@inner_kernel
def choose(f: F64, size: int, inward: bool) -> None:
    """Refraction or reflection, and the factors of direction and normal in the new direction."""
    for j in range(size):
        crosses = (f[_COS2, j] > 0.0) & (f[_U, j] >= f[_SCRATCH, j])
        outcome = CROSSES if crosses else (TURNS if f[_COS2, j] > 0.0 else TOTAL)
        f[OUTCOME, j] = outcome if (f[_COSINE, j] < 0.0) == inward else OTHER_SIDE
    for j in range(size):
        cosine = f[_COSINE, j]
        cos_i = min(1.0, abs(cosine))
        through = f[_ETA, j] * cos_i - math.sqrt(max(f[_COS2, j], 0.0))
        along = through if f[OUTCOME, j] == CROSSES else 2.0 * cos_i
        f[_ALONG, j] = -along if cosine > 0.0 else along
    for j in range(size):
        f[_SCRATCH, j] = f[_ETA, j] if f[OUTCOME, j] == CROSSES else 1.0


@inner_kernel
def turn(f: F64, size: int) -> None:
    """Turn the directions and keep them of unit length."""
    for k in range(3):
        for j in range(size):
            f[AFTER + k, j] = f[_SCRATCH, j] * f[3 + k, j] + f[_ALONG, j] * f[NORMAL + k, j]
    for j in range(size):
        ex, ey, ez = f[AFTER, j], f[AFTER + 1, j], f[AFTER + 2, j]
        f[_SCRATCH, j] = unit_factor(ex, ey, ez)
    for k in range(3):
        for j in range(size):
            f[AFTER + k, j] *= f[_SCRATCH, j]
