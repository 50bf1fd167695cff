"""Surfaces that scatter all their light, in the weighted mode: diffuse, measured, rough."""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inner_kernel, number
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from raymap.optics.frames import frame_about
from tracer.compiled import (
    M_DISPERSIVE,
    R_LEAST,
    ROUGH_DIELECTRIC,
    S_FACETS,
    S_KIND,
    S_REFLECTED,
    S_TRANSMITTED,
    SURFACE_ROW,
    TABULATED,
    RareLight,
)
from tracer.optics.bsdf import pdf_tabulated
from tracer.optics.microfacet import (
    eval_rough_conductor,
    pdf_rough_dielectric,
    sample_rough_conductor,
    sample_rough_dielectric,
)
from tracer.rays.colors import COLORS, mean_of, pick_channel, recolor, recolor_lost
from tracer.rays.random import advance, five_uniform, uniform
from tracer.surfaces.interaction import Hit, Light, Optics
from tracer.surfaces.lambertian import diffuse, recolor_diffuse_lost
from tracer.surfaces.law import density_by_law, draw_by_law, event_by_law, shares_by_law
from tracer.surfaces.metals import metal_reflectance
from tracer.surfaces.retroreflector import sample_retroreflector
from tracer.surfaces.tabulated import sample_measured
from tracer.transport.weighted_aim import aim_or_keep, balance, likely_enough

__all__ = ["meet_diffuse", "meet_law", "meet_measured", "meet_rough"]

Weighted = tuple[int, bool, float, float, float, int, np.uint64, float]

_ABSORBED = int(Event.SURFACE_ABSORPTION)
_SELECT = int(Event.DISPERSIVE_SELECT)
_DIFFUSE_REFLECTION = int(Event.DIFFUSE_REFLECTION)
_DIFFUSE_TRANSMISSION = int(Event.DIFFUSE_TRANSMISSION)
_GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
_GLOSSY_TRANSMISSION = int(Event.GLOSSY_TRANSMISSION)


@inner_kernel
def meet_diffuse(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_f: F64, surface: int,
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    """Diffuse reflection or transmission, chosen with at least the set probability."""
    column = np.int64(SURFACE_ROW)
    beyond = column + colors.shape[1]
    back = mean_of(colors, code, surface_f, surface, column)
    through = mean_of(colors, code, surface_f, surface, beyond)
    share = min(1.0, back + through)
    chance = likely_enough(share, rare.settings[R_LEAST])
    state = advance(state)
    u = uniform(state)
    if u >= chance:
        code = recolor_diffuse_lost(colors, code, surface_f, surface, counters)
        return _ABSORBED, False, dx, dy, dz, code, state, weight * (1.0 - share) / (1.0 - chance)
    weight *= share / chance
    crosses = u * share >= back * chance
    if crosses:
        nx, ny, nz = -nx, -ny, -nz
        column = beyond
    code = recolor(colors, code, surface_f, surface, column, counters)
    dx, dy, dz, state = diffuse(nx, ny, nz, state)
    dx, dy, dz, q, count, state = aim_or_keep(
        rare, x, y, z, nx, ny, nz, True, dx, dy, dz, weight, state
    )
    density = (dx * nx + dy * ny + dz * nz) / math.pi
    weight *= balance(rare, x, y, z, nx, ny, nz, True, dx, dy, dz, q, count, density)
    event = _DIFFUSE_TRANSMISSION if crosses else _DIFFUSE_REFLECTION
    return event, crosses, dx, dy, dz, code, state, weight


@inner_kernel
def meet_measured(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_f: F64, tables: F64, surface: int, medium: int, other: int, dx: float, dy: float,
    dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    """Measured scatter: its side and its losses by roulette, its direction aimed. Also a
    retroreflector, which nothing is aimed from."""
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    ix, iy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    measured = surface_i[surface, S_KIND] == TABULATED
    optics = Optics(surface_i, surface_f, medium_f, tables)
    hit = Hit(surface, medium, other, ix, iy, cos_i)
    light = Light(code, colors, counters, state)
    if measured:
        happened, px, py, pz, code, state = sample_measured(optics, hit, light)
    else:
        happened, px, py, pz, code, state = sample_retroreflector(optics, hit, light)
    if happened == _ABSORBED:
        return happened, False, dx, dy, dz, code, state, weight
    crosses = pz < 0.0
    ox, oy, oz = px * ux + py * vx + pz * nx, px * uy + py * vy + pz * ny, px * uz + py * vz + pz * nz  # fmt: skip # noqa: E501
    if not measured:
        return happened, crosses, ox, oy, oz, code, state, weight
    side = -1.0 if crosses else 1.0
    table = surface_i[surface, S_TRANSMITTED] if crosses else surface_i[surface, S_REFLECTED]
    hx, hy, hz = side * nx, side * ny, side * nz
    ox, oy, oz, q, count, state = aim_or_keep(
        rare, x, y, z, hx, hy, hz, True, ox, oy, oz, weight, state
    )
    if count > 0:
        density = pdf_tabulated(
            tables, table, ix, iy, cos_i, ox * ux + oy * uy + oz * uz,
            ox * vx + oy * vy + oz * vz, ox * nx + oy * ny + oz * nz, side,
        )  # fmt: skip
        weight *= balance(rare, x, y, z, hx, hy, hz, True, ox, oy, oz, q, count, density)
    return happened, crosses, ox, oy, oz, code, state, weight


@inner_kernel
def meet_rough(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_i: I64, medium_f: F64, tables: F64, surface: int, medium: int, other: int, dx: float,
    dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    """Facets of a rough interface or metal; both sides of an interface are aimed at together."""
    n_channels = colors.shape[1]
    interface = surface_i[surface, S_KIND] == ROUGH_DIELECTRIC
    event = _GLOSSY_REFLECTION
    k = code if code < n_channels else 0
    dispersive = medium_i[medium, M_DISPERSIVE] | medium_i[other, M_DISPERSIVE] != 0
    if interface and dispersive and code >= n_channels:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
        code = k
        event |= _SELECT
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    ix, iy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    alpha = surface_f[surface, 0]
    n1, n2 = medium_f[medium, k], medium_f[other, k]
    s1 = advance(state)
    s2 = advance(s1)
    s3 = advance(s2)
    s4 = advance(s3)
    state = advance(s4)
    if interface:
        px, py, pz, _ = sample_rough_dielectric(
            tables, surface_i[surface, S_FACETS], ix, iy, cos_i, alpha, n1, n2, uniform(s1),
            uniform(s2), uniform(s3), uniform(s4), uniform(state),
        )  # fmt: skip
    else:
        px, py, pz, _ = sample_rough_conductor(
            tables, surface_i[surface, S_FACETS], ix, iy, cos_i, alpha, uniform(s1), uniform(s2),
            uniform(s3), uniform(s4), uniform(state),
        )  # fmt: skip
    ox, oy, oz = px * ux + py * vx + pz * nx, px * uy + py * vy + pz * ny, px * uz + py * vz + pz * nz  # fmt: skip # noqa: E501
    horizon = not interface
    ox, oy, oz, q, count, state = aim_or_keep(
        rare, x, y, z, nx, ny, nz, horizon, ox, oy, oz, weight, state
    )
    if count > 0:
        px, py = ox * ux + oy * uy + oz * uz, ox * vx + oy * vy + oz * vz
        pz = ox * nx + oy * ny + oz * nz
    if interface:
        if count > 0:
            density = pdf_rough_dielectric(
                tables, surface_i[surface, S_FACETS], ix, iy, cos_i, px, py, pz, alpha, n1, n2
            )
            weight *= balance(rare, x, y, z, nx, ny, nz, horizon, ox, oy, oz, q, count, density)
        if pz < 0.0:
            event = (event & _SELECT) | _GLOSSY_TRANSMISSION
        return event, pz < 0.0, ox, oy, oz, code, state, weight
    # A metal: weigh by a law of reflectance 1, then survive with the reflectance there
    single, multiple, cos_m = eval_rough_conductor(
        tables, surface_i[surface, S_FACETS], ix, iy, cos_i, px, py, pz, alpha
    )
    density = (single + multiple) * max(0.0, pz)
    weight *= balance(rare, x, y, z, nx, ny, nz, horizon, ox, oy, oz, q, count, density)
    if density <= 0.0:
        return event, False, ox, oy, oz, code, state, weight
    state = advance(state)
    often = multiple / (single + multiple)
    spare = counters[COLORS] + 1
    for j in range(n_channels):
        colors[spare, j] = (1.0 - often) * metal_reflectance(
            surface_i, surface_f, medium_f, tables, surface, medium, j, cos_m
        ) + often * surface_f[surface, SURFACE_ROW + n_channels + j]
    if uniform(state) >= mean_of(colors, code, colors, spare, np.int64(0)):
        code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
        return _ABSORBED, False, dx, dy, dz, code, state, weight
    code = recolor(colors, code, colors, spare, np.int64(0), counters)
    return event, False, ox, oy, oz, code, state, weight


@inner_kernel
def meet_law(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_f: F64, tables: F64, surface: int, medium: int, other: int, dx: float, dy: float,
    dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    """A surface that is described by a law; both sides are aimed at together."""
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    wx, wy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    optics = Optics(surface_i, surface_f, medium_f, tables)
    hit = Hit(number(surface), number(medium), number(other), wx, wy, cos_i)
    u, state = five_uniform(state)
    px, py, pz = draw_by_law(optics, hit, u[0], u[1], u[2])
    ox, oy, oz = px * ux + py * vx + pz * nx, px * uy + py * vy + pz * ny, px * uz + py * vz + pz * nz  # fmt: skip # noqa: E501
    ox, oy, oz, q, count, state = aim_or_keep(
        rare, x, y, z, nx, ny, nz, False, ox, oy, oz, weight, state
    )
    if count > 0:
        px, py = ox * ux + oy * uy + oz * uz, ox * vx + oy * vy + oz * vz
        pz = ox * nx + oy * ny + oz * nz
    density = density_by_law(optics, hit, px, py, pz)
    weight *= balance(rare, x, y, z, nx, ny, nz, False, ox, oy, oz, q, count, density)
    spare = counters[COLORS] + 1
    shares_by_law(optics, hit, px, py, pz, density, colors, spare)
    share = mean_of(colors, code, colors, spare, np.int64(0))
    chance = likely_enough(share, rare.settings[R_LEAST])
    if u[3] >= chance:
        code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
        lost = weight * (1.0 - share) / (1.0 - chance) if chance < 1.0 else 0.0
        return _ABSORBED, False, dx, dy, dz, code, state, lost
    code = recolor(colors, code, colors, spare, np.int64(0), counters)
    weight *= share / chance
    return event_by_law(optics, hit, pz), pz < 0.0, ox, oy, oz, code, state, weight
