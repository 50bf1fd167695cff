"""Scatter about the specular direction by a law of ABg or Harvey-Shack, in the weighted mode."""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64, I64
from raymap.optics.frames import frame_about, frame_towards
from tracer.compiled import R_LEAST, S_SCATTER, S_STRIDE, RareLight
from tracer.optics.radial import pdf_radial, sample_radial
from tracer.rays.colors import COLORS, pick_channel, recolor
from tracer.rays.random import advance, uniform
from tracer.surfaces.specular import scattered_parts
from tracer.transport.weighted_aim import aim_or_keep, balance, likely_enough

__all__ = ["scatter"]


@inline_kernel
def scatter(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_f: F64, tables: F64 | None, surface: int, medium: int, other: int, cos_i: float,
    crosses: bool, nx: float, ny: float, nz: float, dx: float, dy: float, dz: float, code: int,
    colors: F64, counters: I64, state: np.uint64,
) -> tuple[bool, float, float, float, int, np.uint64, float]:  # fmt: skip
    """Scatter specular light (direction d, normal on its side) by the surface's law, if any."""
    if tables is None or surface_i[surface, S_SCATTER] < 0:
        return False, dx, dy, dz, code, state, weight
    return _scatter_by_law(
        rare, x, y, z, weight, surface_i, surface_f, medium_f, tables, surface, medium, other,
        cos_i, crosses, nx, ny, nz, dx, dy, dz, code, colors, counters, state,
    )  # fmt: skip


@inner_kernel
def _scatter_by_law(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_f: F64, tables: F64, surface: int, medium: int, other: int, cos_i: float, crosses: bool,
    nx: float, ny: float, nz: float, dx: float, dy: float, dz: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> tuple[bool, float, float, float, int, np.uint64, float]:  # fmt: skip
    along = dx * nx + dy * ny + dz * nz
    beta = math.sqrt(max(0.0, 1.0 - along * along))
    parts = counters[COLORS] + 1
    part = scattered_parts(
        surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, crosses, beta, code,
        colors, parts,
    )  # fmt: skip
    chance = likely_enough(part, rare.settings[R_LEAST])
    state = advance(state)
    if uniform(state) >= chance:
        # Unscattered: every channel keeps what the law leaves
        for j in range(colors.shape[1]):
            colors[parts, j] = 1.0 - colors[parts, j]
        code = recolor(colors, code, colors, parts, np.int64(0), counters)
        return False, dx, dy, dz, code, state, weight * (1.0 - part) / (1.0 - chance)
    weight *= part / chance
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
    a = advance(state)
    state = advance(a)
    px, py, pz = sample_radial(tables, table, beta, 0.0, uniform(a), uniform(state))
    dx, dy, dz = px * ux + py * vx + pz * nx, px * uy + py * vy + pz * ny, px * uz + py * vz + pz * nz  # fmt: skip # noqa: E501
    dx, dy, dz, q, count, state = aim_or_keep(
        rare, x, y, z, nx, ny, nz, True, dx, dy, dz, weight, state
    )
    if count > 0:
        px, py = dx * ux + dy * uy + dz * uz, dx * vx + dy * vy + dz * vz
        pz = dx * nx + dy * ny + dz * nz
        density = pdf_radial(tables, table, beta, 0.0, px, py, pz)
        weight *= balance(rare, x, y, z, nx, ny, nz, True, dx, dy, dz, q, count, density)
    return True, dx, dy, dz, code, state, weight
