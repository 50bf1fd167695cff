"""Scatter about the specular light of mirrors and smooth interfaces.

What a law scatters is taken from the specular light, in each channel.
"""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.types import F64, I64
from raymap.laws.radial import eval_radial, scatter_share
from raymap.laws.table import coating_share
from raymap.optics.frames import frame_about, frame_towards
from raymap.optics.fresnel import fresnel_reflectance
from tracer.compiled import (
    MIRROR,
    S_COATING,
    S_COATING_STEP,
    S_KIND,
    S_MODEL,
    S_SCATTER,
    S_STRIDE,
    SURFACE_ROW,
)
from tracer.optics.radial import sample_radial
from tracer.rays.colors import COLORS, mean_of, pick_channel, recolor
from tracer.rays.random import advance, uniform
from tracer.surfaces.metals import metal_reflectance

__all__ = ["around_specular", "scatter_specular", "scattered_parts", "specular_share"]


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
    table = surface_i[surface, S_SCATTER]
    if surface_i[surface, S_STRIDE] > 0:
        # The law has another shape in each channel: go on in one
        state = advance(state)
        code = pick_channel(colors, code, uniform(state))
        table += code * surface_i[surface, S_STRIDE]
    # Frame with x along the projection of the specular direction
    sx, sy, sz, _, _, _ = frame_about(nx, ny, nz)
    _, ux, uy, uz, vx, vy, vz = frame_towards(nx, ny, nz, dx, dy, dz, sx, sy, sz)
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
    first, stride = surface_i[surface, S_SCATTER], surface_i[surface, S_STRIDE]
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
        place = surface_i[surface, S_COATING] + channel * surface_i[surface, S_COATING_STEP]
        reflectance, transmittance = coating_share(tables, place, n1, n2, cos_i)
        return transmittance if crosses else reflectance
    reflectance = fresnel_reflectance(n1, n2, cos_i)
    if reflectance < 1.0 and model != 0:
        reflectance = float(surface_f[surface, SURFACE_ROW + channel])
    return 1.0 - reflectance if crosses else reflectance


@inner_kernel
def around_specular(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    world: int, ix: float, iy: float, cos_i: float, px: float, py: float, cos_o: float, out: F64,
) -> bool:  # fmt: skip
    """Scatter about the light that a mirror or a smooth interface reflects or refracts."""
    kind = surface_i[surface, S_KIND]
    if kind == MIRROR and cos_o < 0.0:
        return False
    first, stride = surface_i[surface, S_SCATTER], surface_i[surface, S_STRIDE]
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
