"""Scatter about the specular light of mirrors and smooth interfaces.

What a law scatters is taken from the specular light, in each channel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel, lean_kernel
from raymap.jit.types import F64
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
from tracer.optics.radial import pdf_radial, sample_radial
from tracer.rays.colors import COLORS, mean_of, pick_channel, recolor
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import Hit, Interface, Light, Optics, Way
from tracer.surfaces.metals import metal_reflectance

__all__ = [
    "Lobe",
    "around_specular",
    "draw_from_lobe",
    "leave_specular",
    "lobe_about",
    "pdf_of_lobe",
    "scatter_specular",
    "scattered_parts",
    "smooth_shares",
    "specular_share",
]


class Lobe(NamedTuple):
    """A scatter law about a specular direction: place of its table, length of the direction's
    projection on the surface, and the frame u, v, n with u along that projection."""

    table: int
    beta: float
    ux: float
    uy: float
    uz: float
    vx: float
    vy: float
    vz: float
    nx: float
    ny: float
    nz: float


@inner_kernel
def scatter_specular(
    optics: Optics, at: Interface, crosses: bool, way: Way, light: Light
) -> tuple[bool, float, float, float, int, np.uint64]:
    """Scatter the part of specular light about its direction that the surface's law takes.

    The normal stands on the side to which the light goes.
    """
    part = scattered_parts(optics, at, crosses, way, light)
    state = advance(light.state)
    if uniform(state) >= part:
        return False, way.dx, way.dy, way.dz, leave_specular(light), state
    lobe, code, state = lobe_about(optics, at, way, light, state)
    x, y, z, state = draw_from_lobe(optics.tables, lobe, state)
    return True, x, y, z, code, state


@inner_kernel
def scattered_parts(optics: Optics, at: Interface, crosses: bool, way: Way, light: Light) -> float:
    """Part of the reflected (refracted) light that the law scatters: TIS over R (over T).

    The row of the colours after the next one takes the part in each channel; returned is that of
    the ray's light.
    """
    parts = light.counters[COLORS] + 1
    beta = _length_on_surface(way)
    first, stride = optics.surface_i[at.surface, S_SCATTER], optics.surface_i[at.surface, S_STRIDE]
    for j in range(light.colors.shape[1]):
        specular = specular_share(optics, at, crosses, j)
        scattered = scatter_share(optics.tables, first + j * stride, beta)
        # Where a stack of nested media leaves less than the law asks for, all is scattered
        light.colors[parts, j] = scattered / specular if specular > scattered else 1.0
    return mean_of(light.colors, light.code, light.colors, parts, np.int64(0))


@inner_kernel
def leave_specular(light: Light) -> int:
    """Colour of what a law leaves in the specular direction, after `scattered_parts`."""
    parts = light.counters[COLORS] + 1
    for j in range(light.colors.shape[1]):
        light.colors[parts, j] = 1.0 - light.colors[parts, j]
    return recolor(light.colors, light.code, light.colors, parts, np.int64(0), light.counters)


@inner_kernel
def lobe_about(
    optics: Optics, at: Interface, way: Way, light: Light, state: np.uint64
) -> tuple[Lobe, int, np.uint64]:
    """The law about a specular direction, and the colour of what it scatters."""
    parts = light.counters[COLORS] + 1
    code = recolor(light.colors, light.code, light.colors, parts, np.int64(0), light.counters)
    table = optics.surface_i[at.surface, S_SCATTER]
    if optics.surface_i[at.surface, S_STRIDE] > 0:
        # The law has another shape in each channel: go on in one
        state = advance(state)
        code = pick_channel(light.colors, code, uniform(state))
        table += code * optics.surface_i[at.surface, S_STRIDE]
    # Frame with x along the projection of the specular direction
    sx, sy, sz, _, _, _ = frame_about(way.nx, way.ny, way.nz)
    _, ux, uy, uz, vx, vy, vz = frame_towards(
        way.nx, way.ny, way.nz, way.dx, way.dy, way.dz, sx, sy, sz
    )
    beta = _length_on_surface(way)
    return Lobe(table, beta, ux, uy, uz, vx, vy, vz, way.nx, way.ny, way.nz), code, state


@inner_kernel
def _length_on_surface(way: Way) -> float:
    along = way.dx * way.nx + way.dy * way.ny + way.dz * way.nz
    return math.sqrt(max(0.0, 1.0 - along * along))


@inner_kernel
def draw_from_lobe(tables: F64, s: Lobe, state: np.uint64) -> tuple[float, float, float, np.uint64]:
    """A scattered direction."""
    state = advance(state)
    u1 = uniform(state)
    state = advance(state)
    x, y, z = sample_radial(tables, s.table, s.beta, 0.0, u1, uniform(state))
    return (
        x * s.ux + y * s.vx + z * s.nx,
        x * s.uy + y * s.vy + z * s.ny,
        x * s.uz + y * s.vz + z * s.nz,
        state,
    )


@inner_kernel
def pdf_of_lobe(tables: F64, s: Lobe, x: float, y: float, z: float) -> float:
    """Density of `draw_from_lobe` per solid angle."""
    return pdf_radial(
        tables,
        s.table,
        s.beta,
        0.0,
        x * s.ux + y * s.uy + z * s.uz,
        x * s.vx + y * s.vy + z * s.vz,
        x * s.nx + y * s.ny + z * s.nz,
    )


@inline_kernel
def _coating(
    tables: F64 | None, index: int, n1: float, n2: float, cos_i: float
) -> tuple[float, float]:
    """Reflectance and transmittance from a coating's table."""
    if tables is None:
        return 0.0, 1.0
    return coating_share(tables, index, n1, n2, cos_i)


@inner_kernel
def smooth_shares(optics: Optics, at: Interface, channel: int) -> tuple[float, float]:
    """Reflectance and transmittance of a smooth interface in a channel; total stays total."""
    n1, n2 = optics.medium_f[at.medium, channel], optics.medium_f[at.other, channel]
    model = optics.surface_i[at.surface, S_MODEL]
    if model == 2:
        first = optics.surface_i[at.surface, S_COATING]
        first += channel * optics.surface_i[at.surface, S_COATING_STEP]
        return _coating(optics.tables, first, n1, n2, at.cos_i)
    reflectance = fresnel_reflectance(n1, n2, at.cos_i)
    if reflectance < 1.0 and model != 0:
        reflectance = float(optics.surface_f[at.surface, SURFACE_ROW + channel])
    return reflectance, 1.0 - reflectance


@lean_kernel
def specular_share(optics: Optics, at: Interface, crosses: bool, channel: int) -> float:
    """Specular reflectance, or transmittance, of a mirror or smooth interface in one channel."""
    if optics.surface_i[at.surface, S_KIND] == MIRROR:
        return metal_reflectance(optics, at.surface, at.medium, channel, at.cos_i)
    reflectance, transmittance = smooth_shares(optics, at, channel)
    return transmittance if crosses else reflectance


@inner_kernel
def around_specular(optics: Optics, hit: Hit, px: float, py: float, cos_o: float, out: F64) -> bool:
    """Scatter about the light that a mirror or a smooth interface reflects or refracts."""
    if optics.surface_i[hit.surface, S_KIND] == MIRROR and cos_o < 0.0:
        return False
    first = optics.surface_i[hit.surface, S_SCATTER]
    stride = optics.surface_i[hit.surface, S_STRIDE]
    at = Interface(hit.surface, hit.medium, hit.other, hit.wz)
    for k in range(len(out)):
        n1, n2 = optics.medium_f[hit.medium, k], optics.medium_f[hit.other, k]
        # Specular light keeps its projection on the surface, times the ratio of indices
        eta = 1.0 if cos_o > 0.0 else n1 / n2
        a, b = -eta * hit.wx, -eta * hit.wy
        if a * a + b * b >= 1.0:
            out[k] = 0.0
            continue
        rho = math.sqrt((px - a) * (px - a) + (py - b) * (py - b))
        out[k] = eval_radial(optics.tables, first + k * stride, rho) * abs(cos_o)
        # No more is scattered than the specular light holds
        specular = specular_share(optics, at, cos_o < 0.0, k)
        scattered = scatter_share(optics.tables, first + k * stride, math.hypot(a, b))
        out[k] *= min(1.0, specular / scattered)
    return True
