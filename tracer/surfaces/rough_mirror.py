"""Rough metals and mirrors: GGX facets."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from raymap.jit.kernels import stage_kernel
from raymap.jit.types import F64
from raymap.laws import microfacet_losses
from raymap.laws.law import Law as StoredLaw
from raymap.laws.microfacet import eval_rough_conductor
from raymap.laws.mirror import MirrorLaw
from tracer.compiled import ROUGH_MIRROR, S_FACETS, SURFACE_ROW
from tracer.description.fields import Finite, Spectral
from tracer.optics.microfacet import sample_rough_conductor
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost
from tracer.rays.random import advance, five_uniform, uniform
from tracer.surfaces.interaction import ABSORBED, GLOSSY_REFLECTION, Hit, Light, Optics, Outcome
from tracer.surfaces.metals import metal_reflectance, survive_metal
from tracer.surfaces.mirror import Metal
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = [
    "RoughMirror",
    "draw_rough_mirror",
    "meet_rough_mirror",
    "towards_rough_mirror",
    "weigh_rough_mirror",
]


@stage_kernel
def meet_rough_mirror(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Reflection at one facet with its reflectance, or at several."""
    colors, counters, code = light.colors, light.counters, light.code
    u, state = five_uniform(light.state)
    x, y, z, cos_m = sample_rough_conductor(
        optics.tables, optics.surface_i[hit.surface, S_FACETS], hit.wx, hit.wy, hit.wz,
        optics.surface_f[hit.surface, 0], u,
    )  # fmt: skip
    state = advance(state)
    if cos_m >= 0.0:
        reflected, code = survive_metal(
            optics, hit.surface, hit.medium, cos_m, light, uniform(state)
        )
    else:
        # Several facets were met: each channel survives with its reflectance of that
        spare = counters[COLORS] + 1
        multiple = SURFACE_ROW + colors.shape[1]
        for j in range(colors.shape[1]):
            colors[spare, j] = optics.surface_f[hit.surface, multiple + j]
        reflected = uniform(state) < mean_of(colors, code, colors, spare, np.int64(0))
        if reflected:
            code = recolor(colors, code, colors, spare, np.int64(0), counters)
        else:
            code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
    if not reflected:
        return ABSORBED, x, y, z, code, state
    return GLOSSY_REFLECTION, x, y, z, code, state


@stage_kernel
def draw_rough_mirror(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """A direction as of a metal of reflectance 1."""
    u, state = five_uniform(light.state)
    x, y, z, _ = sample_rough_conductor(
        optics.tables, optics.surface_i[hit.surface, S_FACETS], hit.wx, hit.wy, hit.wz,
        optics.surface_f[hit.surface, 0], u,
    )  # fmt: skip
    return GLOSSY_REFLECTION, x, y, z, light.code, state


@stage_kernel
def weigh_rough_mirror(
    optics: Optics, hit: Hit, light: Light, x: float, y: float, z: float, row: int
) -> float:
    """What goes on is the mean over light that met one facet and light that met several."""
    single, multiple, cos_m = eval_rough_conductor(
        optics.tables, optics.surface_i[hit.surface, S_FACETS], hit.wx, hit.wy, hit.wz, x, y, z,
        optics.surface_f[hit.surface, 0],
    )  # fmt: skip
    density = (single + multiple) * max(0.0, z)
    often = multiple / (single + multiple) if density > 0.0 else 0.0
    again = SURFACE_ROW + light.colors.shape[1]
    for k in range(light.colors.shape[1]):
        light.colors[row, k] = (1.0 - often) * metal_reflectance(
            optics, hit.surface, hit.medium, k, cos_m
        ) + often * optics.surface_f[hit.surface, again + k]
    return density


@stage_kernel
def towards_rough_mirror(optics: Optics, hit: Hit, x: float, y: float, z: float, out: F64) -> bool:
    """Light that facets send from w to a direction."""
    single, multiple, cos_m = eval_rough_conductor(
        optics.tables, optics.surface_i[hit.surface, S_FACETS], hit.wx, hit.wy, hit.wz, x, y, z,
        optics.surface_f[hit.surface, 0],
    )  # fmt: skip
    for k in range(len(out)):
        reflected = metal_reflectance(optics, hit.surface, hit.medium, k, cos_m)
        again = optics.surface_f[hit.surface, SURFACE_ROW + len(out) + k]
        out[k] = (single * reflected + multiple * again) * max(0.0, z)
    return bool(single + multiple > 0.0)


class RoughMirror(Surface):
    """GGX facets of ``roughness`` 0 .. 1 (alpha) with a ``reflectance`` or of a ``metal``."""

    kind: Literal["rough_mirror"] = "rough_mirror"
    roughness: Finite | None = None
    reflectance: Spectral | None = None
    metal: Metal | None = None
    number = ROUGH_MIRROR
    meet = meet_rough_mirror
    towards = towards_rough_mirror
    draw = draw_rough_mirror
    weigh = weigh_rough_mirror

    def model_post_init(self, context: Any) -> None:
        if (self.reflectance is None) == (self.metal is None):
            raise ValueError("a rough_mirror surface needs either a reflectance or a metal")
        if self.roughness is None:
            raise ValueError("a rough_mirror surface needs a roughness (alpha of GGX)")

    def compile(self, row: SurfaceRow) -> None:
        assert self.roughness is not None
        row.set_shares(self.reflectance, None)
        row.numbers[0] = self.roughness
        if self.metal is None:
            averages = row.reflectance
        else:
            self.metal.compile(row)
            averages = np.array(
                [
                    microfacet_losses.average_conductor_reflectance(1.0, float(n), float(k))
                    for n, k in zip(*self.metal.at(row), strict=True)
                ]
            )
        table = microfacet_losses.conductor_table(self.roughness)
        row.integers[S_FACETS] = row.pool.add(table)
        # Survival of light that meets several facets stands where others have transmittance
        row.transmittance[:] = [
            microfacet_losses.multiple_reflectance(float(average), table) for average in averages
        ]

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        n, k = ((), ()) if self.metal is None else self.metal.listed(row)
        back = row.listed(self.reflectance)
        return MirrorLaw(reflectance=back, n=n, k=k, roughness=self.roughness or 0.0)


KINDS = (RoughMirror,)
