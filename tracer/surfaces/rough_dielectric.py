"""Rough interfaces of two media: GGX facets."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from raymap.jit.kernels import inner_kernel, stage_kernel
from raymap.jit.types import F64
from raymap.laws import microfacet_losses
from raymap.laws.law import Law as StoredLaw
from raymap.laws.microfacet import eval_rough_dielectric
from raymap.laws.rough import RoughLaw
from raymap.optics.fresnel import fresnel_reflectance
from tracer.compiled import ROUGH_DIELECTRIC, S_FACETS
from tracer.description.fields import Finite
from tracer.optics.microfacet import pdf_rough_dielectric, sample_rough_dielectric
from tracer.rays.colors import COLORS, pick_channel, recolor
from tracer.rays.random import advance, five_uniform, uniform
from tracer.surfaces.interaction import (
    GLOSSY_REFLECTION,
    GLOSSY_TRANSMISSION,
    SELECT,
    Hit,
    Light,
    Optics,
    Outcome,
)
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = [
    "RoughDielectric",
    "draw_rough_dielectric",
    "meet_rough_dielectric",
    "towards_rough_dielectric",
    "weigh_rough_dielectric",
]


@stage_kernel
def meet_rough_dielectric(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Reflection or refraction at facets.

    Where the index depends on the channel, light that is refracted goes on in one channel.
    """
    medium_f, colors, code = optics.medium_f, light.colors, light.code
    medium, other = hit.medium, hit.other
    n_channels = colors.shape[1]
    k, select, x, y, z, cos_m, state = _draw(optics, hit, light)
    event = GLOSSY_REFLECTION if z > 0.0 else GLOSSY_TRANSMISSION
    if select:
        if z > 0.0 and cos_m >= 0.0:
            # All channels reflect at the same facets, each with its reflectance
            spare = light.counters[COLORS] + 1
            for j in range(n_channels):
                colors[spare, j] = fresnel_reflectance(
                    medium_f[medium, j], medium_f[other, j], cos_m
                )
            code = recolor(colors, code, colors, spare, np.int64(0), light.counters)
        else:
            code = k
            event |= SELECT
    return event, x, y, z, code, state


@inner_kernel
def _draw(
    optics: Optics, hit: Hit, light: Light
) -> tuple[int, bool, float, float, float, float, np.uint64]:
    """A channel, whether it was chosen of several unlike ones, a direction in that channel, the
    cosine at the facet (-1: there were several), state."""
    medium_f, code, state = optics.medium_f, light.code, light.state
    n_channels = light.colors.shape[1]
    k = code if code < n_channels else 0
    select = False
    if code >= n_channels:
        for j in range(1, n_channels):
            select = select or medium_f[hit.medium, j] != medium_f[hit.medium, 0]
            select = select or medium_f[hit.other, j] != medium_f[hit.other, 0]
        if select:
            state = advance(state)
            k = pick_channel(light.colors, code, uniform(state))
    u, state = five_uniform(state)
    x, y, z, cos_m = sample_rough_dielectric(
        optics.tables, optics.surface_i[hit.surface, S_FACETS], hit.wx, hit.wy, hit.wz,
        optics.surface_f[hit.surface, 0], medium_f[hit.medium, k], medium_f[hit.other, k],
        u,
    )  # fmt: skip
    return k, select, x, y, z, cos_m, state


@stage_kernel
def draw_rough_dielectric(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """A direction in one channel, where the index depends on the channel."""
    k, select, x, y, z, _, state = _draw(optics, hit, light)
    event = GLOSSY_REFLECTION if z > 0.0 else GLOSSY_TRANSMISSION
    return event | SELECT if select else event, x, y, z, k if select else light.code, state


@stage_kernel
def weigh_rough_dielectric(
    optics: Optics, hit: Hit, light: Light, x: float, y: float, z: float, row: int
) -> float:
    """All light goes on: nothing is lost, and light of several channels is treated alike."""
    n_channels = light.colors.shape[1]
    for k in range(n_channels):
        light.colors[row, k] = 1.0
    k = light.code if light.code < n_channels else 0
    return pdf_rough_dielectric(
        optics.tables, optics.surface_i[hit.surface, S_FACETS], hit.wx, hit.wy, hit.wz, x, y, z,
        optics.surface_f[hit.surface, 0], optics.medium_f[hit.medium, k],
        optics.medium_f[hit.other, k],
    )  # fmt: skip


@stage_kernel
def towards_rough_dielectric(
    optics: Optics, hit: Hit, x: float, y: float, z: float, out: F64
) -> bool:
    """Light that facets send from w to a direction."""
    for k in range(len(out)):
        out[k] = abs(z) * eval_rough_dielectric(
            optics.tables, optics.surface_i[hit.surface, S_FACETS], hit.wx, hit.wy, hit.wz, x, y,
            z, optics.surface_f[hit.surface, 0], optics.medium_f[hit.medium, k],
            optics.medium_f[hit.other, k],
        )  # fmt: skip
    return True


class RoughDielectric(Surface):
    """GGX facets of ``roughness`` 0 .. 1 (alpha) between two media."""

    kind: Literal["rough_dielectric"] = "rough_dielectric"
    roughness: Finite | None = None
    number = ROUGH_DIELECTRIC
    meet = meet_rough_dielectric
    towards = towards_rough_dielectric
    draw = draw_rough_dielectric
    weigh = weigh_rough_dielectric

    def model_post_init(self, context: Any) -> None:
        if self.roughness is None:
            raise ValueError("a rough_dielectric surface needs a roughness (alpha of GGX)")

    def compile(self, row: SurfaceRow) -> None:
        assert self.roughness is not None
        row.numbers[0] = self.roughness
        row.integers[S_FACETS] = row.pool.add(microfacet_losses.dielectric_table(self.roughness))

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        assert self.roughness is not None
        return RoughLaw(roughness=self.roughness)

    def transmits(self) -> bool:
        return True


KINDS = (RoughDielectric,)
