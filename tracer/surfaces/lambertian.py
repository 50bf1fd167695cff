"""Lambertian surfaces: diffuse reflection and transmission."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64, I64
from raymap.laws.lambertian import LambertianLaw
from raymap.laws.law import Law as StoredLaw
from raymap.model.events import Event
from tracer.compiled import LAMBERTIAN, SURFACE_ROW
from tracer.description.fields import Spectral
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost
from tracer.rays.directions import about
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import ABSORBED
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = ["Lambertian", "diffuse", "meet_lambertian", "recolor_diffuse_lost"]


_DIFFUSE_REFLECTION = int(Event.DIFFUSE_REFLECTION)
_DIFFUSE_TRANSMISSION = int(Event.DIFFUSE_TRANSMISSION)


@inner_kernel
def meet_lambertian(
    surface_f: F64, surface: int, dx: float, dy: float, dz: float, nx: float, ny: float,
    nz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> tuple[int, bool, float, float, float, int, np.uint64]:  # fmt: skip
    """Diffuse reflection, diffuse transmission or absorption."""
    reflectance = np.int64(SURFACE_ROW)
    transmittance = reflectance + colors.shape[1]
    state = advance(state)
    u = uniform(state)
    back = mean_of(colors, code, surface_f, surface, reflectance)
    if u < back:
        code = recolor(colors, code, surface_f, surface, reflectance, counters)
        dx, dy, dz, state = diffuse(nx, ny, nz, state)
        return _DIFFUSE_REFLECTION, False, dx, dy, dz, code, state
    if u < back + mean_of(colors, code, surface_f, surface, transmittance):
        code = recolor(colors, code, surface_f, surface, transmittance, counters)
        dx, dy, dz, state = diffuse(-nx, -ny, -nz, state)
        return _DIFFUSE_TRANSMISSION, True, dx, dy, dz, code, state
    code = recolor_diffuse_lost(colors, code, surface_f, surface, counters)
    return ABSORBED, False, dx, dy, dz, code, state


@inner_kernel
def recolor_diffuse_lost(
    colors: F64, code: int, surface_f: F64, surface: int, counters: I64
) -> int:
    """Colour of what a diffuse surface neither reflects nor transmits."""
    n_channels: int = colors.shape[1]
    if code < n_channels:
        return code
    spare = counters[COLORS] + 1
    for k in range(n_channels):
        back = surface_f[surface, SURFACE_ROW + k]
        colors[spare, k] = back + surface_f[surface, SURFACE_ROW + n_channels + k]
    return recolor_lost(colors, code, colors, spare, np.int64(0), counters)


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
