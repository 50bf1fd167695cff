"""How much light a point sends in a given direction: emission, surfaces, media.

Where the engine draws a direction, this gives the density of all directions: light of unit flux
that arrives (or starts) becomes ``out[k]`` per solid angle in channel k. Directions without width
(mirrors, smooth interfaces, parallel beams) give nothing.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64, I64
from tracer.compiled import (
    BY_TABLE,
    COLLIMATED,
    DIELECTRIC,
    FROM_LIST,
    L_AREA,
    L_DIRECTIONS,
    LAMBERTIAN,
    LAMBERTIAN_CONE,
    MIRROR,
    RETROREFLECTOR,
    ROUGH_DIELECTRIC,
    ROUGH_MIRROR,
    S_KIND,
    S_METAL,
    S_MODEL,
    S_STRIDE,
    S_TABLE,
    S_TRANSMITTED,
    SURFACE_ROW,
    TABULATED,
)
from tracer.optics.abg import eval_radial, scatter_share
from tracer.optics.bsdf import eval_tabulated, pdf_retro
from tracer.optics.microfacet import eval_rough_conductor, eval_rough_dielectric
from tracer.surfaces.scattering import metal_reflectance, specular_share

__all__ = ["emitted_towards", "scattered_towards"]


@inner_kernel
def emitted_towards(
    source_i: I64, source_f: F64, pool: F64 | None, source: int, nx: float, ny: float, nz: float,
    ox: float, oy: float, oz: float,
) -> float:  # fmt: skip
    """Share of a source's light per solid angle in the direction o, from a place with normal n."""
    kind = source_i[source, L_DIRECTIONS]
    if kind == COLLIMATED or source_i[source, L_AREA] == FROM_LIST:
        return 0.0
    s = source_f[source]
    cosine = ox * nx + oy * ny + oz * nz
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


@inner_kernel
def scattered_towards(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    world: int, dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, ox: float,
    oy: float, oz: float, out: F64,
) -> bool:  # fmt: skip
    """Light that goes from d to o at a surface, per solid angle; False where there is none.

    The normal stands outward. Light that crosses is taken to come out into the world's medium:
    elsewhere another face hides the point.
    """
    cosine = dx * nx + dy * ny + dz * nz
    if cosine > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    cos_i = min(1.0, abs(cosine))
    cos_o = ox * nx + oy * ny + oz * nz
    kind = surface_i[surface, S_KIND]
    n_channels = len(out)
    if kind == LAMBERTIAN:
        share = SURFACE_ROW if cos_o > 0.0 else SURFACE_ROW + n_channels
        for k in range(n_channels):
            out[k] = surface_f[surface, share + k] * abs(cos_o) / math.pi
        return True
    if tables is None or cos_i <= 0.0 or cos_o == 0.0:
        return False
    # Local frame: z along the normal on the side of the incident ray
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    ux, uy, uz = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
    vx, vy, vz = b, sign + ny * ny * a, -ny
    ix, iy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    px, py = ox * ux + oy * uy + oz * uz, ox * vx + oy * vy + oz * vz
    if kind == TABULATED:
        table = surface_i[surface, S_TABLE] if cos_o > 0.0 else surface_i[surface, S_TRANSMITTED]
        if table < 0:
            return False
        side = 1.0 if cos_o > 0.0 else -1.0
        value = eval_tabulated(tables, table, ix, iy, cos_i, px, py, cos_o, side) * abs(cos_o)
        for k in range(n_channels):
            out[k] = value
        return value > 0.0
    if kind == RETROREFLECTOR:
        if surface_f[surface, 0] >= 1.0:
            return False
        value = pdf_retro(ix, iy, cos_i, px, py, cos_o, surface_f[surface, 0])
        for k in range(n_channels):
            out[k] = value * surface_f[surface, SURFACE_ROW + k]
        return value > 0.0
    if kind == ROUGH_MIRROR:
        single, multiple, cos_m = eval_rough_conductor(
            tables, surface_i[surface, S_MODEL], ix, iy, cos_i, px, py, cos_o,
            surface_f[surface, 0],
        )  # fmt: skip
        for k in range(n_channels):
            reflected = metal_reflectance(
                surface_i, surface_f, medium_f, tables, surface, medium, k, cos_m
            )
            again = surface_f[surface, SURFACE_ROW + n_channels + k]
            out[k] = (single * reflected + multiple * again) * max(0.0, cos_o)
        return single + multiple > 0.0
    if kind == ROUGH_DIELECTRIC:
        for k in range(n_channels):
            out[k] = abs(cos_o) * eval_rough_dielectric(
                tables, surface_i[surface, S_METAL], ix, iy, cos_i, px, py, cos_o,
                surface_f[surface, 0], medium_f[medium, k], medium_f[world, k],
            )  # fmt: skip
        return True
    if surface_i[surface, S_TABLE] < 0 or (kind != MIRROR and kind != DIELECTRIC):
        return False
    return _around_specular(
        surface_i, surface_f, medium_f, tables, surface, medium, world, ix, iy, cos_i, px, py,
        cos_o, out,
    )  # fmt: skip


@inner_kernel
def _around_specular(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    world: int, ix: float, iy: float, cos_i: float, px: float, py: float, cos_o: float, out: F64,
) -> bool:  # fmt: skip
    """Scatter about the light that a mirror or a smooth interface reflects or refracts."""
    kind = surface_i[surface, S_KIND]
    if kind == MIRROR and cos_o < 0.0:
        return False
    first, stride = surface_i[surface, S_TABLE], surface_i[surface, S_STRIDE]
    for k in range(len(out)):
        n1, n2 = medium_f[medium, k], medium_f[world, k]
        # Specular light keeps its projection on the surface, times the ratio of indices
        eta = 1.0 if cos_o > 0.0 else n1 / n2
        a, b = -eta * ix, -eta * iy
        if a * a + b * b >= 1.0:
            out[k] = 0.0
            continue
        rho = math.sqrt((px - a) * (px - a) + (py - b) * (py - b))
        out[k] = eval_radial(tables, first + k * stride, rho) * abs(cos_o)
        # No more is scattered than the specular light holds
        specular = specular_share(
            surface_i, surface_f, medium_f, tables, surface, medium, world, cos_i, cos_o < 0.0, k
        )
        out[k] *= min(1.0, specular / scatter_share(tables, first + k * stride, math.hypot(a, b)))
    return True
