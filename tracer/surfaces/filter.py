"""Filters: thin absorbing sheets."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from raymap.jit.kernels import inner_kernel, stage_kernel
from raymap.laws.law import Law as StoredLaw
from raymap.laws.sheet import FilterLaw, filter_transmittance
from raymap.model.events import Event
from tracer.compiled import FILTER, SURFACE_ROW
from tracer.description.fields import Positive, Spectral
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import ABSORBED, Hit, Light, Optics, Outcome
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = ["Filter", "meet_filter", "pass_or_absorb"]


_REFRACTED = int(Event.SPECULAR_REFRACTION)


@inner_kernel
def pass_or_absorb(event: int, light: Light) -> Outcome:
    """Let light go straight on, or absorb it, by the shares in the first spare row of colours."""
    colors, counters, code = light.colors, light.counters, light.code
    spare = counters[COLORS] + 1
    state = advance(light.state)
    if uniform(state) >= mean_of(colors, code, colors, spare, np.int64(0)):
        code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
        return ABSORBED, 0.0, 0.0, 0.0, code, state
    code = recolor(colors, code, colors, spare, np.int64(0), counters)
    return event, 0.0, 0.0, 0.0, code, state


@stage_kernel
def meet_filter(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Go straight on, or be absorbed."""
    colors = light.colors
    n_channels = colors.shape[1]
    spare = light.counters[COLORS] + 1
    for j in range(n_channels):
        normal = optics.surface_f[hit.surface, SURFACE_ROW + n_channels + j]
        colors[spare, j] = filter_transmittance(
            normal, hit.wz, optics.medium_f[hit.medium, j], optics.surface_f[hit.surface, 0]
        )
    return pass_or_absorb(_REFRACTED, light)


class Filter(Surface):
    """Thin sheet with internal ``transmittance`` and ``index``; light goes straight on."""

    kind: Literal["filter"] = "filter"
    transmittance: Spectral | None = None
    index: Positive | None = None
    number = FILTER
    meet = meet_filter

    def model_post_init(self, context: Any) -> None:
        if self.transmittance is None:
            raise ValueError("a filter needs a transmittance")

    def compile(self, row: SurfaceRow) -> None:
        row.set_shares(None, self.transmittance)
        row.numbers[0] = self.index or 1.5

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        return FilterLaw(transmittance=row.listed(self.transmittance), index=self.index or 1.5)

    def transmits(self) -> bool:
        return True


KINDS = (Filter,)
