"""Scattered light in the weighted mode: drawn or aimed, weighed, and sent on often enough.

Written once, over what a kind of surface says of itself (`tracer.surfaces.drawing`).
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel, number
from raymap.jit.types import F64
from raymap.optics.frames import frame_about
from tracer.compiled import R_LEAST, S_AIMED, S_SCATTER, VarianceReduction
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost
from tracer.rays.random import advance, uniform
from tracer.surfaces.drawing import draw_scattered, event_towards, weigh_scattered
from tracer.surfaces.interaction import ABSORBED, Hit, Interface, Light, Optics, Way
from tracer.surfaces.specular import (
    draw_from_lobe,
    leave_specular,
    lobe_about,
    pdf_of_lobe,
    scattered_parts,
)
from tracer.transport.weighted.aiming import Start
from tracer.transport.weighted.balance import aim_or_keep, balance, likely_enough
from tracer.transport.weighted.ray import Weighted, WeightedRay

__all__ = ["scatter_aimed", "scatter_if_any"]


@inline_kernel
def scatter_aimed(
    reduction: VarianceReduction, ray: WeightedRay, optics: Optics, tables: F64 | None,
    at: Interface, way: Way, light: Light,
) -> Weighted:  # fmt: skip
    """Scatter light by the law of the surface, with the least probability at least."""
    nx, ny, nz = way.nx, way.ny, way.nz
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    wx = -(way.dx * ux + way.dy * uy + way.dz * uz)
    wy = -(way.dx * vx + way.dy * vy + way.dz * vz)
    hit = Hit(number(at.surface), number(at.medium), number(at.other), wx, wy, at.cos_i)
    light = Light(number(light.code), light.colors, light.counters, light.state)
    happened, x, y, z, code, state = draw_scattered(optics, tables, hit, light)
    weight = ray.weight
    if happened == ABSORBED:
        return happened, False, way.dx, way.dy, way.dz, code, state, weight
    dx, dy, dz = x * ux + y * vx + z * nx, x * uy + y * vy + z * ny, x * uz + y * vz + z * nz
    # Keep the direction, or aim at something on a side to which the law sends light
    colors, counters = light.colors, light.counters
    light = Light(number(code), colors, counters, state)
    row = counters[COLORS] + 1
    sides = optics.surface_i[at.surface, S_AIMED]
    if sides > 0:
        start = Start(ray.x, ray.y, ray.z, nx, ny, nz, sides == 1)
        dx, dy, dz, aim, state = aim_or_keep(reduction, start, dx, dy, dz, weight, state)
        if aim.candidates > 0:
            x, y, z = (
                dx * ux + dy * uy + dz * uz,
                dx * vx + dy * vy + dz * vz,
                dx * nx + dy * ny + dz * nz,
            )
        density = weigh_scattered(optics, tables, hit, light, x, y, z, row)
        weight *= balance(reduction, start, aim, dx, dy, dz, density)
    else:
        weigh_scattered(optics, tables, hit, light, x, y, z, row)
    if not weight > 0.0:
        # Aimed to where the law sends no light
        return event_towards(happened, z), z < 0.0, dx, dy, dz, code, state, 0.0
    # Send on what the law leaves
    share = mean_of(colors, code, colors, row, np.int64(0))
    chance = likely_enough(share, reduction.settings[R_LEAST])
    if chance < 1.0:
        state = advance(state)
        if uniform(state) >= chance:
            code = recolor_lost(colors, code, colors, row, np.int64(0), counters)
            lost = weight * (1.0 - share) / (1.0 - chance)
            return ABSORBED, False, way.dx, way.dy, way.dz, code, state, lost
    code = recolor(colors, code, colors, row, np.int64(0), counters)
    weight *= share / chance
    return event_towards(happened, z), z < 0.0, dx, dy, dz, code, state, weight


Scattered = tuple[bool, float, float, float, int, np.uint64, float]


@inline_kernel
def scatter_if_any(
    reduction: VarianceReduction, ray: WeightedRay, optics: Optics, tables: F64 | None,
    at: Interface, crosses: bool, way: Way, light: Light,
) -> Scattered:  # fmt: skip
    """Scatter the part of specular light that the surface's law takes, if it has one; the normal
    stands on the side to which the light goes."""
    if tables is None or optics.surface_i[at.surface, S_SCATTER] < 0:
        return False, way.dx, way.dy, way.dz, light.code, light.state, ray.weight
    return _scatter(reduction, ray, optics, at, crosses, way, light)


@inner_kernel
def _scatter(
    reduction: VarianceReduction, ray: WeightedRay, optics: Optics, at: Interface, crosses: bool,
    way: Way, light: Light,
) -> Scattered:  # fmt: skip
    weight = ray.weight
    part = scattered_parts(optics, at, crosses, way, light)
    chance = likely_enough(part, reduction.settings[R_LEAST])
    state = advance(light.state)
    if uniform(state) >= chance:
        # Unscattered: every channel keeps what the law leaves
        weight *= (1.0 - part) / (1.0 - chance)
        return False, way.dx, way.dy, way.dz, leave_specular(light), state, weight
    weight *= part / chance
    lobe, code, state = lobe_about(optics, at, way, light, state)
    dx, dy, dz, state = draw_from_lobe(optics.tables, lobe, state)
    start = Start(ray.x, ray.y, ray.z, way.nx, way.ny, way.nz, True)
    dx, dy, dz, aim, state = aim_or_keep(reduction, start, dx, dy, dz, weight, state)
    if aim.candidates > 0:
        density = pdf_of_lobe(optics.tables, lobe, dx, dy, dz)
        weight *= balance(reduction, start, aim, dx, dy, dz, density)
    return True, dx, dy, dz, code, state, weight
