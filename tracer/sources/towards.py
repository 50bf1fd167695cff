"""How much light a source sends in a given direction.

Where the engine draws a direction, this gives the density of all directions. Parallel beams, whose
directions have no width, give nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64, I64
from tracer.compiled import (
    BY_TABLE,
    COLLIMATED,
    FROM_KIND,
    FROM_LIST,
    L_AREA,
    L_DIRECTIONS,
    L_TOWARDS,
    LAMBERTIAN_CONE,
)
from tracer.sources.source import EMITS_TOWARDS

__all__ = ["Place", "emitted_towards"]

_towards = EMITS_TOWARDS.call


class Place(NamedTuple):
    """A place on a source, and the unit normal there."""

    x: float
    y: float
    z: float
    nx: float
    ny: float
    nz: float


@inner_kernel
def emitted_towards(
    source_i: I64, source_f: F64, pool: F64 | None, source: int, place: Place, ox: float,
    oy: float, oz: float,
) -> float:  # fmt: skip
    """Share of a source's light per solid angle in the direction o from a place."""
    if source_i[source, L_AREA] == FROM_KIND:
        if pool is None or source_i[source, L_TOWARDS] == 0:
            return 0.0
        return _by_kind(source_i, source_f[source], pool, source, place, ox, oy, oz)
    kind = source_i[source, L_DIRECTIONS]
    if kind == COLLIMATED or source_i[source, L_AREA] == FROM_LIST:
        return 0.0
    s = source_f[source]
    cosine = ox * place.nx + oy * place.ny + oz * place.nz
    if kind == BY_TABLE:
        if pool is None:
            return 0.0
        across_u = ox * s[6] + oy * s[7] + oz * s[8]
        across_v = ox * s[9] + oy * s[10] + oz * s[11]
        return _table_density(pool, int(s[21]), cosine, math.atan2(across_v, across_u))
    if cosine < s[14]:
        return 0.0
    if kind == LAMBERTIAN_CONE:
        return float(max(0.0, cosine) / (math.pi * (1.0 - s[14] * s[14])))
    return float(1.0 / (2.0 * math.pi * (1.0 - s[14])))


@inner_kernel
def _by_kind(
    source_i: I64, s: F64, pool: F64, source: int, place: Place, ox: float, oy: float, oz: float
) -> float:
    first = int(s[21])
    own = pool[first + 1 : first + 1 + int(pool[first])]
    x, y, z = place.x - s[0], place.y - s[1], place.z - s[2]
    density: float = _towards(
        source_i[source, L_TOWARDS],
        (
            own,
            x * s[6] + y * s[7] + z * s[8],
            x * s[9] + y * s[10] + z * s[11],
            x * s[3] + y * s[4] + z * s[5],
            ox * s[6] + oy * s[7] + oz * s[8],
            ox * s[9] + oy * s[10] + oz * s[11],
            ox * s[3] + oy * s[4] + oz * s[5],
        ),
    )
    return density


@inner_kernel
def _table_density(pool: F64, first: int, cosine: float, azimuth: float) -> float:
    """Intensity over flux of a table in the pool of light (see `tracer.sources.light_pool`)."""
    n, m = int(pool[first]), int(pool[first + 1])
    gammas = first + 2
    planes = gammas + n + 1
    values = planes + m + 1 + n * m
    gamma = math.acos(min(1.0, max(-1.0, cosine)))
    if gamma < pool[gammas] or gamma > pool[gammas + n]:
        return 0.0
    turn = 2.0 * math.pi
    around = azimuth - pool[planes]
    around = pool[planes] + around - turn * math.floor(around / turn)
    i, j = 0, 0
    while i < n - 1 and pool[gammas + i + 1] < gamma:
        i += 1
    while j < m - 1 and pool[planes + j + 1] < around:
        j += 1
    u = (gamma - pool[gammas + i]) / (pool[gammas + i + 1] - pool[gammas + i])
    v = (around - pool[planes + j]) / (pool[planes + j + 1] - pool[planes + j])
    corner = values + i * (m + 1) + j
    here = (1.0 - u) * ((1.0 - v) * pool[corner] + v * pool[corner + 1])
    here += u * ((1.0 - v) * pool[corner + m + 1] + v * pool[corner + m + 2])
    return float(here / pool[values + (n + 1) * (m + 1)])
