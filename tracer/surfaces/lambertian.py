"""Lambertian surfaces: diffuse reflection and transmission."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.laws.lambertian import LambertianLaw
from raymap.laws.law import Law as StoredLaw
from tracer.compiled import LAMBERTIAN, SURFACE_ROW
from tracer.description.fields import Spectral
from tracer.optics.bsdf import pdf_lambert, sample_lambert
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost
from tracer.rays.directions import about
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import (
    ABSORBED,
    DIFFUSE_REFLECTION,
    DIFFUSE_TRANSMISSION,
    Hit,
    Interaction,
    Light,
    Optics,
    Outcome,
    Way,
)
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = ["Lambertian", "diffuse", "draw_lambertian", "meet_lambertian", "weigh_lambertian"]


@inner_kernel
def meet_lambertian(optics: Optics, surface: int, way: Way, light: Light) -> Interaction:
    """Diffuse reflection, diffuse transmission or absorption."""
    surface_f, colors, counters, code = optics.surface_f, light.colors, light.counters, light.code
    reflectance = np.int64(SURFACE_ROW)
    transmittance = reflectance + colors.shape[1]
    state = advance(light.state)
    u = uniform(state)
    back = mean_of(colors, code, surface_f, surface, reflectance)
    if u < back:
        code = recolor(colors, code, surface_f, surface, reflectance, counters)
        dx, dy, dz, state = diffuse(way.nx, way.ny, way.nz, state)
        return DIFFUSE_REFLECTION, False, dx, dy, dz, code, state
    if u < back + mean_of(colors, code, surface_f, surface, transmittance):
        code = recolor(colors, code, surface_f, surface, transmittance, counters)
        dx, dy, dz, state = diffuse(-way.nx, -way.ny, -way.nz, state)
        return DIFFUSE_TRANSMISSION, True, dx, dy, dz, code, state
    code = _recolor_lost(optics, surface, light)
    return ABSORBED, False, way.dx, way.dy, way.dz, code, state


@inner_kernel
def _recolor_lost(optics: Optics, surface: int, light: Light) -> int:
    """Colour of what a diffuse surface neither reflects nor transmits."""
    colors, code = light.colors, light.code
    n_channels: int = colors.shape[1]
    if code < n_channels:
        return code
    spare = light.counters[COLORS] + 1
    for k in range(n_channels):
        back = optics.surface_f[surface, SURFACE_ROW + k]
        colors[spare, k] = back + optics.surface_f[surface, SURFACE_ROW + n_channels + k]
    return recolor_lost(colors, code, colors, spare, np.int64(0), light.counters)


@inner_kernel
def _sides(optics: Optics, surface: int, light: Light) -> tuple[float, float]:
    """What is reflected of the light, and what is transmitted."""
    column = np.int64(SURFACE_ROW)
    beyond = column + light.colors.shape[1]
    return (
        mean_of(light.colors, light.code, optics.surface_f, surface, column),
        mean_of(light.colors, light.code, optics.surface_f, surface, beyond),
    )


@inline_kernel
def draw_lambertian(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """`tracer.surfaces.interaction.DRAW`: sides in the proportion of their light."""
    back, through = _sides(optics, hit.surface, light)
    first = advance(light.state)
    state = advance(first)
    if not back + through > 0.0:
        return ABSORBED, 0.0, 0.0, 1.0, light.code, light.state
    x, y, z = sample_lambert(uniform(first), uniform(state), 1.0)
    if through <= 0.0:
        return DIFFUSE_REFLECTION, x, y, z, light.code, state
    state = advance(state)
    if uniform(state) * (back + through) < back:
        return DIFFUSE_REFLECTION, x, y, z, light.code, state
    return DIFFUSE_TRANSMISSION, x, y, -z, light.code, state


@inline_kernel
def weigh_lambertian(optics: Optics, hit: Hit, light: Light, z: float, row: int) -> float:
    """`tracer.surfaces.interaction.WEIGH`."""
    back, through = _sides(optics, hit.surface, light)
    column = SURFACE_ROW if z > 0.0 else SURFACE_ROW + light.colors.shape[1]
    side = (back if z > 0.0 else through) / (back + through)
    if not side > 0.0:
        return 0.0
    for k in range(light.colors.shape[1]):
        light.colors[row, k] = optics.surface_f[hit.surface, column + k] / side
    return side * pdf_lambert(abs(z), 1.0)


@inner_kernel
def diffuse(
    nx: float, ny: float, nz: float, state: np.uint64
) -> tuple[float, float, float, np.uint64]:
    """A direction about n with density cos / pi per solid angle, and the state of the stream."""
    state = advance(state)
    u = uniform(state)
    state = advance(state)
    # The square of the sine is uniform
    dx, dy, dz = about(nx, ny, nz, math.sqrt(1.0 - u), math.sqrt(u), uniform(state))
    return dx, dy, dz, state


class Lambertian(Surface):
    """Diffuse ``reflectance`` and ``transmittance``; the rest is absorbed."""

    kind: Literal["lambertian"] = "lambertian"
    reflectance: Spectral | None = None
    transmittance: Spectral | None = None
    number = LAMBERTIAN

    def model_post_init(self, context: Any) -> None:
        if not (self.reflectance or self.transmittance):
            raise ValueError("a lambertian surface needs a reflectance or a transmittance")

    def compile(self, row: SurfaceRow) -> None:
        row.set_shares(self.reflectance, self.transmittance)

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        return LambertianLaw(
            reflectance=tuple(row.reflectance.tolist()),
            transmittance=row.listed(self.transmittance),
        )

    def transmits(self) -> bool:
        return bool(self.transmittance)


KINDS = (Lambertian,)
