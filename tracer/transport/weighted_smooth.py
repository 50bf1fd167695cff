"""Smooth interfaces in the weighted mode.

A reflection is chosen with at least the set probability, or both parts of the light go on, each as
a ray of its own.
"""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from raymap.optics.fresnel import cos2_refracted, fresnel_reflectance
from tracer.compiled import (
    M_DISPERSIVE,
    R_LEAST,
    S_COATING,
    S_COATING_STEP,
    S_MODEL,
    SURFACE_ROW,
    RareLight,
)
from tracer.rays.colors import COLORS, pick_channel, recolor
from tracer.rays.random import advance, uniform
from tracer.surfaces.dielectric import coating
from tracer.transport.splitting import T_CODE, T_EVENT, T_PENDING, Twins, keep_twin
from tracer.transport.weighted_aim import likely_enough, thin_out
from tracer.transport.weighted_law import scatter

__all__ = ["meet_smooth"]

Weighted = tuple[int, bool, float, float, float, int, np.uint64, float]

_ABSORBED = int(Event.SURFACE_ABSORPTION)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_SELECT = int(Event.DISPERSIVE_SELECT)
_GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
_GLOSSY_TRANSMISSION = int(Event.GLOSSY_TRANSMISSION)

_TOTAL = 1.0 - 1e-9
"""A reflectance of all channels that is summed up to this is total but for rounding."""


@inner_kernel
def meet_smooth(
    rare: RareLight, twins: Twins | None, ray: int, deep: bool, x: float, y: float, z: float,
    weight: float, surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64,
    tables: F64 | None, surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64, counters: I64,
    state: np.uint64,
) -> Weighted:  # fmt: skip
    """Smooth interface: reflection with at least the set probability, or both parts."""
    n_channels = colors.shape[1]
    select = code >= n_channels and (
        medium_i[medium, M_DISPERSIVE] | medium_i[other, M_DISPERSIVE] != 0
        or surface_i[surface, S_MODEL] >= 2
    )
    least = rare.settings[R_LEAST]
    # Sum up over the channels what is reflected, and with which probability that is chosen
    first, last = (0, n_channels) if select else (code, code + 1)
    if not select and code >= n_channels:
        first, last = 0, 1
    back, chance = 0.0, 0.0
    for j in range(first, last):
        share = colors[code - n_channels, j] if select else 1.0
        r, _ = _shares(surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, j)
        back += share * r
        chance += share * likely_enough(r, least)
    splits = not deep and 0.0 < back < _TOTAL and keep_twin(rare, twins, ray)
    # Draw the channel in which light would cross: all that crosses where the ray splits
    state = advance(state)
    u = uniform(state)
    k = first
    if select:
        if splits:
            u *= 1.0 - back
            for j in range(n_channels):
                r, _ = _shares(
                    surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, j
                )
                u -= colors[code - n_channels, j] * (1.0 - r)
                k = j
                if u < 0.0:
                    break
        else:
            k = pick_channel(colors, code, u)
    r, t = _shares(surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, k)
    n1, n2 = medium_f[medium, k], medium_f[other, k]
    eta = n1 / n2
    cos2_t = cos2_refracted(eta, cos_i)
    state = advance(state)
    reflects = not splits and uniform(state) < likely_enough(r, least)
    turned = 2.0 * cos_i
    if splits and twins is not None:
        # The reflected part becomes a ray of its own
        twin_code = code
        if select:
            twin_code = _recolor(
                surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, code,
                colors, counters,
            )  # fmt: skip
        scattered, rx, ry, rz, twin_code, state, twin_weight = scatter(
            rare, x, y, z, weight * back, surface_i, surface_f, medium_f, tables, surface, medium,
            other, cos_i, False, nx, ny, nz, dx + turned * nx, dy + turned * ny, dz + turned * nz,
            twin_code, colors, counters, state,
        )  # fmt: skip
        happened, twin_weight, state = thin_out(rare, 0, twin_weight, state)
        if happened == 0:
            state = advance(state)
            twins.direction[0], twins.direction[1], twins.direction[2] = rx, ry, rz
            twins.direction[3] = twin_weight
            twins.outcome[T_PENDING] = 1
            twins.outcome[T_EVENT] = _GLOSSY_REFLECTION if scattered else _REFLECTED
            twins.outcome[T_CODE] = twin_code
    if reflects:
        event = _REFLECTED
        if cos2_t <= 0.0:
            event = _TIR
        if select:
            code = _recolor(
                surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, code,
                colors, counters,
            )  # fmt: skip
        weight *= back / chance
        scattered, dx, dy, dz, code, state, weight = scatter(
            rare, x, y, z, weight, surface_i, surface_f, medium_f, tables, surface, medium, other,
            cos_i, False, nx, ny, nz, dx + turned * nx, dy + turned * ny, dz + turned * nz, code,
            colors, counters, state,
        )  # fmt: skip
        return _GLOSSY_REFLECTION if scattered else event, False, dx, dy, dz, code, state, weight
    weight *= 1.0 - back if splits else (1.0 - r) / (1.0 - likely_enough(r, least))
    # What neither goes back nor through is absorbed
    state = advance(state)
    if uniform(state) * (1.0 - r) >= t or cos2_t <= 0.0:
        return _ABSORBED, False, dx, dy, dz, k if select else code, state, weight
    event = _REFRACTED
    if select:
        event |= _SELECT
        code = k
    along = eta * cos_i - math.sqrt(cos2_t)
    scattered, dx, dy, dz, code, state, weight = scatter(
        rare, x, y, z, weight, surface_i, surface_f, medium_f, tables, surface, medium, other,
        cos_i, True, -nx, -ny, -nz, eta * dx + along * nx, eta * dy + along * ny,
        eta * dz + along * nz, code, colors, counters, state,
    )  # fmt: skip
    if scattered:
        event = (event & _SELECT) | _GLOSSY_TRANSMISSION
    return event, True, dx, dy, dz, code, state, weight


@inner_kernel
def _shares(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    other: int, cos_i: float, k: int,
) -> tuple[float, float]:  # fmt: skip
    """Reflectance and transmittance of a smooth interface in channel k; total stays total."""
    n1, n2 = medium_f[medium, k], medium_f[other, k]
    if surface_i[surface, S_MODEL] == 2:
        place = surface_i[surface, S_COATING] + k * surface_i[surface, S_COATING_STEP]
        return coating(tables, place, n1, n2, cos_i)
    reflectance = fresnel_reflectance(n1, n2, cos_i)
    if reflectance < 1.0 and surface_i[surface, S_MODEL] != 0:
        reflectance = float(surface_f[surface, SURFACE_ROW + k])
    return reflectance, 1.0 - reflectance


@inner_kernel
def _recolor(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    other: int, cos_i: float, code: int, colors: F64, counters: I64,
) -> int:  # fmt: skip
    """Colour after reflection where each channel has its own reflectance."""
    spare = counters[COLORS] + 1
    for j in range(colors.shape[1]):
        colors[spare, j], _ = _shares(
            surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, j
        )
    return recolor(colors, code, colors, spare, np.int64(0), counters)
