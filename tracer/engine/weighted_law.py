"""Scatter about the specular direction by a law of ABg or Harvey-Shack, in the weighted mode."""

from __future__ import annotations

import math

import numpy as np

from raymap.kernels import inline_kernel, inner_kernel
from tracer.engine.buffers import COLORS
from tracer.engine.colors import pick_channel, recolor
from tracer.engine.random import advance, uniform
from tracer.engine.weighted_aim import aim_or_keep, balance, frame_about, likely_enough
from tracer.geometry.kinds import F64, I64
from tracer.optics.abg import pdf_radial, sample_radial, scatter_share
from tracer.scene.arrays import R_LEAST, S_STRIDE, S_TABLE, RareLight

__all__ = ["scatter"]


@inline_kernel
def scatter(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64,
    tables: F64 | None, surface: int, nx: float, ny: float, nz: float, dx: float, dy: float,
    dz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> tuple[bool, float, float, float, int, np.uint64, float]:  # fmt: skip
    """Scatter specular light (direction d, normal on its side) by the surface's law, if any."""
    if tables is None or surface_i[surface, S_TABLE] < 0:
        return False, dx, dy, dz, code, state, weight
    return _scatter_by_law(
        rare, x, y, z, weight, surface_i, tables, surface, nx, ny, nz, dx, dy, dz, code, colors,
        counters, state,
    )  # fmt: skip


@inner_kernel
def _scatter_by_law(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, tables: F64,
    surface: int, nx: float, ny: float, nz: float, dx: float, dy: float, dz: float, code: int,
    colors: F64, counters: I64, state: np.uint64,
) -> tuple[bool, float, float, float, int, np.uint64, float]:  # fmt: skip
    first, stride = surface_i[surface, S_TABLE], surface_i[surface, S_STRIDE]
    n_channels = colors.shape[1]
    mixed = stride > 0 and code >= n_channels
    k = 0
    if stride > 0:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
    along = dx * nx + dy * ny + dz * nz
    beta = math.sqrt(max(0.0, 1.0 - along * along))
    table = first + k * stride
    share = scatter_share(tables, table, beta)
    least = rare.settings[R_LEAST]
    state = advance(state)
    if uniform(state) >= likely_enough(share, least):
        # Unscattered: every channel keeps what its law leaves
        left, chance = 1.0 - share, 1.0 - likely_enough(share, least)
        if mixed:
            left, chance = 0.0, 0.0
            spare = counters[COLORS] + 1
            for j in range(n_channels):
                s = scatter_share(tables, first + j * stride, beta)
                colors[spare, j] = 1.0 - s
                left += colors[code - n_channels, j] * (1.0 - s)
                chance += colors[code - n_channels, j] * (1.0 - likely_enough(s, least))
            code = recolor(colors, code, colors, spare, np.int64(0), counters)
        return False, dx, dy, dz, code, state, weight * left / chance
    weight *= share / likely_enough(share, least)
    if stride > 0:
        code = k
    # Frame with x along the projection of the specular direction
    if beta > 1e-12:
        ux, uy, uz = (dx - along * nx) / beta, (dy - along * ny) / beta, (dz - along * nz) / beta
    else:
        ux, uy, uz, _, _, _ = frame_about(nx, ny, nz)
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
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
