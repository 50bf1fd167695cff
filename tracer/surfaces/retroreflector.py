"""Retroreflectors: light goes back where it came from."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from raymap.jit.kernels import inner_kernel, stage_kernel
from raymap.jit.types import F64
from raymap.laws.law import Law as StoredLaw
from raymap.laws.retroreflector import RetroreflectorLaw, pdf_retro
from tracer.compiled import RETROREFLECTOR, SURFACE_ROW
from tracer.description.fields import Spectral
from tracer.optics.bsdf import sample_retro
from tracer.rays.colors import mean_of, recolor, recolor_lost
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import ABSORBED, GLOSSY_REFLECTION, Hit, Light, Optics, Outcome
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = [
    "Retroreflector",
    "draw_retroreflector",
    "meet_retroreflector",
    "towards_retroreflector",
    "weigh_retroreflector",
]


@stage_kernel
def meet_retroreflector(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Reflection about the way back."""
    surface_f, surface = optics.surface_f, hit.surface
    colors, counters, code = light.colors, light.counters, light.code
    state = advance(light.state)
    if uniform(state) >= mean_of(colors, code, surface_f, surface, np.int64(SURFACE_ROW)):
        code = recolor_lost(colors, code, surface_f, surface, np.int64(SURFACE_ROW), counters)
        return ABSORBED, 0.0, 0.0, 1.0, code, state
    code = recolor(colors, code, surface_f, surface, np.int64(SURFACE_ROW), counters)
    x, y, z, state = _way_back(optics, hit, state)
    return GLOSSY_REFLECTION, x, y, z, code, state


@stage_kernel
def draw_retroreflector(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """A direction about the way back."""
    x, y, z, state = _way_back(optics, hit, light.state)
    return GLOSSY_REFLECTION, x, y, z, light.code, state


@stage_kernel
def weigh_retroreflector(
    optics: Optics, hit: Hit, light: Light, x: float, y: float, z: float, row: int
) -> float:
    """What is reflected goes on."""
    for k in range(light.colors.shape[1]):
        light.colors[row, k] = optics.surface_f[hit.surface, SURFACE_ROW + k]
    cos_spread = optics.surface_f[hit.surface, 0]
    return pdf_retro(hit.wx, hit.wy, hit.wz, x, y, z, cos_spread) if cos_spread < 1.0 else 0.0


@inner_kernel
def _way_back(optics: Optics, hit: Hit, state: np.uint64) -> tuple[float, float, float, np.uint64]:
    state = advance(state)
    u1 = uniform(state)
    state = advance(state)
    cos_spread = optics.surface_f[hit.surface, 0]
    x, y, z = sample_retro(hit.wx, hit.wy, hit.wz, cos_spread, u1, uniform(state))
    return x, y, z, state


@stage_kernel
def towards_retroreflector(
    optics: Optics, hit: Hit, x: float, y: float, z: float, out: F64
) -> bool:
    """Light sent back towards a direction; none where the way back has no width."""
    if optics.surface_f[hit.surface, 0] >= 1.0:
        return False
    value = pdf_retro(hit.wx, hit.wy, hit.wz, x, y, z, optics.surface_f[hit.surface, 0])
    for k in range(len(out)):
        out[k] = value * optics.surface_f[hit.surface, SURFACE_ROW + k]
    return bool(value > 0.0)


class Retroreflector(Surface):
    """``reflectance`` within ``spread_deg`` of the way back."""

    kind: Literal["retroreflector"] = "retroreflector"
    reflectance: Spectral | None = None
    spread_deg: Annotated[float, Field(ge=0, le=90)] | None = None
    number = RETROREFLECTOR
    meet = meet_retroreflector
    towards = towards_retroreflector
    draw = draw_retroreflector
    weigh = weigh_retroreflector

    def model_post_init(self, context: Any) -> None:
        if self.reflectance is None:
            raise ValueError("a retroreflector needs a reflectance")

    def compile(self, row: SurfaceRow) -> None:
        row.set_shares(self.reflectance, None)
        row.numbers[0] = math.cos(math.radians(self.spread_deg or 0.0))

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        back = row.listed(self.reflectance)
        return RetroreflectorLaw(reflectance=back, spread_deg=self.spread_deg or 0.0)

    def aimed_sides(self) -> int:
        return 0


KINDS = (Retroreflector,)
