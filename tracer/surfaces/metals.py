"""Reflection at metals and at mirrors of a given reflectance."""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64, I64
from raymap.optics.fresnel import fresnel_conductor
from tracer.compiled import S_METAL, SURFACE_ROW
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost

__all__ = ["metal_reflectance", "survive_metal"]


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
