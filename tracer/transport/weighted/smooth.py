"""Smooth interfaces in the weighted mode.

A reflection is chosen with at least the set probability, or both parts of the light go on, each as
a ray of its own.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inline_kernel
from raymap.jit.types import F64
from raymap.optics.fresnel import cos2_refracted
from tracer.compiled import R_LEAST, VarianceReduction
from tracer.rays.colors import pick_channel
from tracer.rays.random import advance, uniform
from tracer.surfaces.dielectric import changes_by_channel, recolor_reflected
from tracer.surfaces.interaction import (
    ABSORBED,
    GLOSSY_REFLECTION,
    GLOSSY_TRANSMISSION,
    SELECT,
    SPECULAR_REFLECTION,
    SPECULAR_REFRACTION,
    TIR,
    Interface,
    Light,
    Optics,
    Way,
    reflected_way,
)
from tracer.surfaces.specular import smooth_shares
from tracer.transport.splitting import T_CODE, T_EVENT, T_PENDING, SplitRays, may_split
from tracer.transport.weighted.balance import likely_enough, roulette
from tracer.transport.weighted.ray import Weighted, WeightedRay, with_weight
from tracer.transport.weighted.scattered import scatter_if_any

__all__ = ["meet_smooth"]

_TOTAL = 1.0 - 1e-9
"""A reflectance of all channels that is summed up to this is total but for rounding."""


@inline_kernel
def meet_smooth(
    reduction: VarianceReduction, split: SplitRays | None, ray: WeightedRay, optics: Optics,
    tables: F64 | None, at: Interface, way: Way, light: Light,
) -> Weighted:  # fmt: skip
    """Smooth interface: reflection with at least the set probability, or both parts.

    Part of the loop over rays: handing over all arrays took longer than what is done with them.
    """
    code, colors, counters, weight = light.code, light.colors, light.counters, ray.weight
    n_channels = colors.shape[1]
    select = code >= n_channels and changes_by_channel(optics, at)
    least = reduction.settings[R_LEAST]
    # Sum up over the channels what is reflected, and with which probability that is chosen
    first, last = (0, n_channels) if select else (code, code + 1)
    if not select and code >= n_channels:
        first, last = 0, 1
    back, chance = 0.0, 0.0
    for j in range(first, last):
        share = colors[code - n_channels, j] if select else 1.0
        r, _ = smooth_shares(optics, at, j)
        back += share * r
        chance += share * likely_enough(r, least)
    splits = not ray.deep and 0.0 < back < _TOTAL and may_split(reduction, split, ray.number)
    # Draw the channel in which light would cross: all that crosses where the ray splits
    state = advance(light.state)
    u = uniform(state)
    k = first
    if select:
        if splits:
            u *= 1.0 - back
            for j in range(n_channels):
                r, _ = smooth_shares(optics, at, j)
                u -= colors[code - n_channels, j] * (1.0 - r)
                k = j
                if u < 0.0:
                    break
        else:
            k = pick_channel(colors, code, u)
    r, t = smooth_shares(optics, at, k)
    eta = optics.medium_f[at.medium, k] / optics.medium_f[at.other, k]
    cos2_t = cos2_refracted(eta, at.cos_i)
    state = advance(state)
    reflects = not splits and uniform(state) < likely_enough(r, least)
    turned = reflected_way(at, way)
    if splits and split is not None:
        # The reflected part becomes a ray of its own
        split_code = recolor_reflected(optics, at, light) if select else code
        part = with_weight(ray, weight * back)
        off = Light(split_code, colors, counters, state)
        scattered, rx, ry, rz, split_code, state, split_weight = scatter_if_any(
            reduction, part, optics, tables, at, False, turned, off
        )
        happened, split_weight, state = roulette(reduction, 0, split_weight, state)
        if happened == 0:
            state = advance(state)
            split.direction[0], split.direction[1], split.direction[2] = rx, ry, rz
            split.direction[3] = split_weight
            split.outcome[T_PENDING] = 1
            split.outcome[T_EVENT] = GLOSSY_REFLECTION if scattered else SPECULAR_REFLECTION
            split.outcome[T_CODE] = split_code
    if reflects:
        event = SPECULAR_REFLECTION
        if cos2_t <= 0.0:
            event = TIR
        if select:
            code = recolor_reflected(optics, at, light)
        part = with_weight(ray, weight * (back / chance))
        scattered, dx, dy, dz, code, state, weight = scatter_if_any(
            reduction, part, optics, tables, at, False, turned, Light(code, colors, counters, state)
        )
        return GLOSSY_REFLECTION if scattered else event, False, dx, dy, dz, code, state, weight
    weight *= 1.0 - back if splits else (1.0 - r) / (1.0 - likely_enough(r, least))
    # What neither goes back nor through is absorbed
    state = advance(state)
    if uniform(state) * (1.0 - r) >= t or cos2_t <= 0.0:
        return ABSORBED, False, way.dx, way.dy, way.dz, k if select else code, state, weight
    event = SPECULAR_REFRACTION
    if select:
        event |= SELECT
        code = k
    along = eta * at.cos_i - math.sqrt(cos2_t)
    through = Way(
        eta * way.dx + along * way.nx, eta * way.dy + along * way.ny, eta * way.dz + along * way.nz,
        -way.nx, -way.ny, -way.nz,
    )  # fmt: skip
    part = with_weight(ray, weight)
    scattered, dx, dy, dz, code, state, weight = scatter_if_any(
        reduction, part, optics, tables, at, True, through, Light(code, colors, counters, state)
    )
    if scattered:
        event = (event & SELECT) | GLOSSY_TRANSMISSION
    return event, True, dx, dy, dz, code, state, weight
