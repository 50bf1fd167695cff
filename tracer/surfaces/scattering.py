"""Surfaces beyond the plain interface: metals, rough surfaces, measured scatter, filters.

The samplers stand in `tracer.optics`; here they meet a ray: local frame, random numbers, colours,
events. What depends on the channel is drawn for one channel of the ray; where the outcome has the
same density for all channels but for a factor, the colour takes that factor, else the ray goes on
in that channel alone.
"""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from tracer.compiled import (
    FILTER,
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
)
from tracer.optics.abg import sample_radial, scatter_share
from tracer.optics.bsdf import (
    filter_transmittance,
    sample_retro,
    sample_tabulated,
    tabulated_share,
)
from tracer.optics.coatings import coating_share
from tracer.optics.fresnel import fresnel_conductor, fresnel_reflectance
from tracer.optics.microfacet import sample_rough_conductor, sample_rough_dielectric
from tracer.rays.colors import COLORS, mean_of, pick_channel, recolor, recolor_lost
from tracer.rays.random import advance, uniform

__all__ = [
    "Outcome",
    "meet_filter",
    "meet_scatterer",
    "metal_reflectance",
    "sample_measured",
    "sample_retroreflector",
    "scatter_specular",
    "scattered_parts",
    "specular_share",
    "survive_metal",
]

Outcome = tuple[int, bool, float, float, float, int, np.uint64]

_ABSORBED = int(Event.SURFACE_ABSORPTION)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
_GLOSSY_TRANSMISSION = int(Event.GLOSSY_TRANSMISSION)
_SELECT = int(Event.DISPERSIVE_SELECT)


@inner_kernel
def meet_scatterer(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float,
    code: int, colors: F64, counters: I64, state: np.uint64,
) -> Outcome:  # fmt: skip
    """Meet a mirror, a rough or measured surface, a filter; the normal stands against the ray."""
    kind = surface_i[surface, S_KIND]
    if kind == MIRROR:
        return _meet_mirror(
            surface_i, surface_f, medium_f, tables, surface, medium, dx, dy, dz, nx, ny, nz, cos_i,
            code, colors, counters, state,
        )  # fmt: skip
    if kind == FILTER:
        return meet_filter(
            surface_f, medium_f, surface, medium, dx, dy, dz, cos_i, code, colors, counters, state
        )
    # Local frame: z along the normal on the side of the incident ray
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    ux, uy, uz = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
    vx, vy, vz = b, sign + ny * ny * a, -ny
    wi_x = -(dx * ux + dy * uy + dz * uz)
    wi_y = -(dx * vx + dy * vy + dz * vz)
    if kind == ROUGH_DIELECTRIC:
        happened, x, y, z, code, state = _rough_dielectric(
            surface_i, surface_f, medium_f, tables, surface, medium, other, wi_x, wi_y, cos_i,
            code, colors, counters, state,
        )  # fmt: skip
    elif kind == ROUGH_MIRROR:
        happened, x, y, z, code, state = _rough_mirror(
            surface_i, surface_f, medium_f, tables, surface, medium, wi_x, wi_y, cos_i, code,
            colors, counters, state,
        )  # fmt: skip
    elif kind == RETROREFLECTOR:
        happened, x, y, z, code, state = sample_retroreflector(
            surface_f, surface, wi_x, wi_y, cos_i, code, colors, counters, state
        )
    else:
        happened, x, y, z, code, state = sample_measured(
            surface_i, tables, surface, wi_x, wi_y, cos_i, code, colors, state
        )
    if happened == _ABSORBED:
        return happened, False, dx, dy, dz, code, state
    dx, dy, dz = x * ux + y * vx + z * nx, x * uy + y * vy + z * ny, x * uz + y * vz + z * nz
    return happened, z < 0.0, dx, dy, dz, code, state


@inner_kernel
def scatter_specular(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, cos_i: float, crosses: bool, nx: float, ny: float, nz: float, dx: float, dy: float,
    dz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> tuple[bool, float, float, float, int, np.uint64]:  # fmt: skip
    """Scatter the part of specular light about its direction that the surface's law takes.

    The normal stands on the side to which the light goes.
    """
    along = dx * nx + dy * ny + dz * nz
    beta = math.sqrt(max(0.0, 1.0 - along * along))
    parts = counters[COLORS] + 1
    part = scattered_parts(
        surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, crosses, beta, code,
        colors, parts,
    )  # fmt: skip
    state = advance(state)
    if uniform(state) >= part:
        for j in range(colors.shape[1]):
            colors[parts, j] = 1.0 - colors[parts, j]
        code = recolor(colors, code, colors, parts, np.int64(0), counters)
        return False, dx, dy, dz, code, state
    code = recolor(colors, code, colors, parts, np.int64(0), counters)
    table = surface_i[surface, S_TABLE]
    if surface_i[surface, S_STRIDE] > 0:
        # The law has another shape in each channel: go on in one
        state = advance(state)
        code = pick_channel(colors, code, uniform(state))
        table += code * surface_i[surface, S_STRIDE]
    # Frame with x along the projection of the specular direction
    if beta > 1e-12:
        ux, uy, uz = (dx - along * nx) / beta, (dy - along * ny) / beta, (dz - along * nz) / beta
    else:
        sign = 1.0 if nz >= 0.0 else -1.0
        a = -1.0 / (sign + nz)
        ux, uy, uz = 1.0 + sign * nx * nx * a, sign * nx * ny * a, -sign * nx
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    state = advance(state)
    u1 = uniform(state)
    state = advance(state)
    x, y, z = sample_radial(tables, table, beta, 0.0, u1, uniform(state))
    return (
        True,
        x * ux + y * vx + z * nx,
        x * uy + y * vy + z * ny,
        x * uz + y * vz + z * nz,
        code,
        state,
    )


@inner_kernel
def scattered_parts(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, cos_i: float, crosses: bool, beta: float, code: int, colors: F64, parts: int,
) -> float:  # fmt: skip
    """Part of the reflected (refracted) light that the law scatters: TIS over R (over T).

    ``beta`` is the length of the specular direction's projection on the surface. Row ``parts`` of
    the colours takes the part in each channel; returned is that of the ray's light.
    """
    first, stride = surface_i[surface, S_TABLE], surface_i[surface, S_STRIDE]
    for j in range(colors.shape[1]):
        specular = specular_share(
            surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, crosses, j
        )
        scattered = scatter_share(tables, first + j * stride, beta)
        # Where a stack of nested media leaves less than the law asks for, all is scattered
        colors[parts, j] = scattered / specular if specular > scattered else 1.0
    return mean_of(colors, code, colors, parts, np.int64(0))


@lean_kernel
def specular_share(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, cos_i: float, crosses: bool, channel: int,
) -> float:  # fmt: skip
    """Specular reflectance, or transmittance, of a mirror or smooth interface in one channel."""
    if surface_i[surface, S_KIND] == MIRROR:
        return metal_reflectance(
            surface_i, surface_f, medium_f, tables, surface, medium, channel, cos_i
        )
    n1, n2 = medium_f[medium, channel], medium_f[other, channel]
    model = surface_i[surface, S_MODEL]
    if model == 2:
        place = surface_i[surface, S_METAL] + channel * surface_i[surface, S_TRANSMITTED]
        reflectance, transmittance = coating_share(tables, place, n1, n2, cos_i)
        return transmittance if crosses else reflectance
    reflectance = fresnel_reflectance(n1, n2, cos_i)
    if reflectance < 1.0 and model != 0:
        reflectance = float(surface_f[surface, SURFACE_ROW + channel])
    return 1.0 - reflectance if crosses else reflectance


@inner_kernel
def metal_reflectance(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    channel: int, cosine: float,
) -> float:  # fmt: skip
    """Reflectance of a mirror in one channel: constant, or Fresnel's of a metal."""
    metal = surface_i[surface, S_METAL]
    if metal < 0:
        return float(surface_f[surface, SURFACE_ROW + channel])
    place = metal + 2 * channel
    return fresnel_conductor(medium_f[medium, channel], tables[place], tables[place + 1], cosine)


@inner_kernel
def survive_metal(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    cosine: float, code: int, colors: F64, counters: I64, u: float,
) -> tuple[bool, int]:  # fmt: skip
    """Whether light is reflected by the metal, and its colour, or that of what is absorbed."""
    n_channels = colors.shape[1]
    if code < n_channels:
        reflectance = metal_reflectance(
            surface_i, surface_f, medium_f, tables, surface, medium, code, cosine
        )
        return u < reflectance, code
    spare = counters[COLORS] + 1
    for j in range(n_channels):
        colors[spare, j] = metal_reflectance(
            surface_i, surface_f, medium_f, tables, surface, medium, j, cosine
        )
    if u >= mean_of(colors, code, colors, spare, np.int64(0)):
        return False, recolor_lost(colors, code, colors, spare, np.int64(0), counters)
    return True, recolor(colors, code, colors, spare, np.int64(0), counters)


@inner_kernel
def _meet_mirror(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int,
    colors: F64, counters: I64, state: np.uint64,
) -> Outcome:  # fmt: skip
    state = advance(state)
    reflected, code = survive_metal(
        surface_i, surface_f, medium_f, tables, surface, medium, cos_i, code, colors, counters,
        uniform(state),
    )  # fmt: skip
    if not reflected:
        return _ABSORBED, False, dx, dy, dz, code, state
    along = 2.0 * cos_i
    dx, dy, dz = dx + along * nx, dy + along * ny, dz + along * nz
    event = _REFLECTED
    if surface_i[surface, S_TABLE] >= 0:
        scattered, dx, dy, dz, code, state = scatter_specular(
            surface_i, surface_f, medium_f, tables, surface, medium, medium, cos_i, False, nx, ny,
            nz, dx, dy, dz, code, colors, counters, state,
        )  # fmt: skip
        event = _GLOSSY_REFLECTION if scattered else _REFLECTED
    return event, False, dx, dy, dz, code, state


@inner_kernel
def meet_filter(
    surface_f: F64, medium_f: F64, surface: int, medium: int, dx: float, dy: float, dz: float,
    cos_i: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> Outcome:  # fmt: skip
    """A thin absorbing sheet: light goes straight on or is absorbed."""
    n_channels = colors.shape[1]
    spare = counters[COLORS] + 1
    for j in range(n_channels):
        normal = surface_f[surface, SURFACE_ROW + n_channels + j]
        colors[spare, j] = filter_transmittance(
            normal, cos_i, medium_f[medium, j], surface_f[surface, 0]
        )
    state = advance(state)
    if uniform(state) >= mean_of(colors, code, colors, spare, np.int64(0)):
        code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
        return _ABSORBED, False, dx, dy, dz, code, state
    code = recolor(colors, code, colors, spare, np.int64(0), counters)
    return _REFRACTED, True, dx, dy, dz, code, state


@inner_kernel
def _rough_dielectric(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, wi_x: float, wi_y: float, wi_z: float, code: int, colors: F64, counters: I64,
    state: np.uint64,
) -> tuple[int, float, float, float, int, np.uint64]:  # fmt: skip
    n_channels = colors.shape[1]
    k = code if code < n_channels else 0
    select = False
    if code >= n_channels:
        for j in range(1, n_channels):
            select = select or medium_f[medium, j] != medium_f[medium, 0]
            select = select or medium_f[other, j] != medium_f[other, 0]
        if select:
            state = advance(state)
            k = pick_channel(colors, code, uniform(state))
    u, state = _five(state)
    x, y, z, cos_m = sample_rough_dielectric(
        tables, surface_i[surface, S_METAL], wi_x, wi_y, wi_z, surface_f[surface, 0],
        medium_f[medium, k], medium_f[other, k], u[0], u[1], u[2], u[3], u[4],
    )  # fmt: skip
    event = _GLOSSY_REFLECTION if z > 0.0 else _GLOSSY_TRANSMISSION
    if select:
        if z > 0.0 and cos_m >= 0.0:
            # All channels reflect at the same facets, each with its reflectance
            spare = counters[COLORS] + 1
            for j in range(n_channels):
                colors[spare, j] = fresnel_reflectance(
                    medium_f[medium, j], medium_f[other, j], cos_m
                )
            code = recolor(colors, code, colors, spare, np.int64(0), counters)
        else:
            code = k
            event |= _SELECT
    return event, x, y, z, code, state


@inner_kernel
def _rough_mirror(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    wi_x: float, wi_y: float, wi_z: float, code: int, colors: F64, counters: I64,
    state: np.uint64,
) -> tuple[int, float, float, float, int, np.uint64]:  # fmt: skip
    u, state = _five(state)
    x, y, z, cos_m = sample_rough_conductor(
        tables, surface_i[surface, S_MODEL], wi_x, wi_y, wi_z, surface_f[surface, 0],
        u[0], u[1], u[2], u[3], u[4],
    )  # fmt: skip
    state = advance(state)
    if cos_m >= 0.0:
        reflected, code = survive_metal(
            surface_i, surface_f, medium_f, tables, surface, medium, cos_m, code, colors, counters,
            uniform(state),
        )  # fmt: skip
    else:
        # Several facets were met: each channel survives with its reflectance of that
        spare = counters[COLORS] + 1
        multiple = SURFACE_ROW + colors.shape[1]
        for j in range(colors.shape[1]):
            colors[spare, j] = surface_f[surface, multiple + j]
        reflected = uniform(state) < mean_of(colors, code, colors, spare, np.int64(0))
        if reflected:
            code = recolor(colors, code, colors, spare, np.int64(0), counters)
        else:
            code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
    if not reflected:
        return _ABSORBED, x, y, z, code, state
    return _GLOSSY_REFLECTION, x, y, z, code, state


@inner_kernel
def sample_retroreflector(
    surface_f: F64, surface: int, wi_x: float, wi_y: float, wi_z: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> tuple[int, float, float, float, int, np.uint64]:  # fmt: skip
    state = advance(state)
    if uniform(state) >= mean_of(colors, code, surface_f, surface, np.int64(SURFACE_ROW)):
        code = recolor_lost(colors, code, surface_f, surface, np.int64(SURFACE_ROW), counters)
        return _ABSORBED, 0.0, 0.0, 1.0, code, state
    code = recolor(colors, code, surface_f, surface, np.int64(SURFACE_ROW), counters)
    state = advance(state)
    u1 = uniform(state)
    state = advance(state)
    x, y, z = sample_retro(wi_x, wi_y, wi_z, surface_f[surface, 0], u1, uniform(state))
    return _GLOSSY_REFLECTION, x, y, z, code, state


@inner_kernel
def sample_measured(
    surface_i: I64, tables: F64, surface: int, wi_x: float, wi_y: float, wi_z: float, code: int,
    colors: F64, state: np.uint64,
) -> tuple[int, float, float, float, int, np.uint64]:  # fmt: skip
    """Measured scatter to either side; the same table for all channels."""
    back, through = surface_i[surface, S_TABLE], surface_i[surface, S_TRANSMITTED]
    reflected = tabulated_share(tables, back, wi_z) if back >= 0 else 0.0
    transmitted = tabulated_share(tables, through, wi_z) if through >= 0 else 0.0
    u, state = _five(state)
    if u[0] < reflected:
        x, y, z = sample_tabulated(tables, back, wi_x, wi_y, wi_z, u[1], u[2], u[3], 1.0)
        return _GLOSSY_REFLECTION, x, y, z, code, state
    if u[0] < reflected + transmitted:
        x, y, z = sample_tabulated(tables, through, wi_x, wi_y, wi_z, u[1], u[2], u[3], -1.0)
        return _GLOSSY_TRANSMISSION, x, y, z, code, state
    return _ABSORBED, 0.0, 0.0, 1.0, code, state


@inner_kernel
def _five(
    state: np.uint64,
) -> tuple[tuple[float, float, float, float, float], np.uint64]:
    """Five uniform numbers."""
    a = advance(state)
    b = advance(a)
    c = advance(b)
    d = advance(c)
    e = advance(d)
    return (uniform(a), uniform(b), uniform(c), uniform(d), uniform(e)), e
