"""Reflection at metals and at mirrors of a given reflectance."""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inner_kernel
from raymap.optics.fresnel import fresnel_conductor
from tracer.compiled import S_METAL, SURFACE_ROW
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost
from tracer.surfaces.interaction import Light, Optics

__all__ = ["metal_reflectance", "survive_metal"]


@inner_kernel
def metal_reflectance(
    optics: Optics, surface: int, medium: int, channel: int, cosine: float
) -> float:
    """Reflectance of a mirror in one channel: constant, or Fresnel's of a metal."""
    metal = optics.surface_i[surface, S_METAL]
    if metal < 0:
        return float(optics.surface_f[surface, SURFACE_ROW + channel])
    first = metal + 2 * channel
    n, k = optics.tables[first], optics.tables[first + 1]
    return fresnel_conductor(optics.medium_f[medium, channel], n, k, cosine)


@inner_kernel
def survive_metal(
    optics: Optics, surface: int, medium: int, cosine: float, light: Light, u: float
) -> tuple[bool, int]:
    """Whether light is reflected by the metal, and its colour, or that of what is absorbed."""
    colors, counters, code = light.colors, light.counters, light.code
    n_channels = colors.shape[1]
    if code < n_channels:
        return u < metal_reflectance(optics, surface, medium, code, cosine), code
    spare = counters[COLORS] + 1
    for j in range(n_channels):
        colors[spare, j] = metal_reflectance(optics, surface, medium, j, cosine)
    if u >= mean_of(colors, code, colors, spare, np.int64(0)):
        return False, recolor_lost(colors, code, colors, spare, np.int64(0), counters)
    return True, recolor(colors, code, colors, spare, np.int64(0), counters)
