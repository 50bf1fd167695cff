"""Sheet polarisers: what vibrates along an axis is absorbed."""

from __future__ import annotations

from typing import Any, Literal

from raymap.jit.kernels import stage_kernel
from raymap.laws.law import Law as StoredLaw
from raymap.laws.sheet import PolariserLaw
from raymap.model.events import Event
from tracer.compiled import POLARISER, SURFACE_ROW
from tracer.description.fields import Share, Spectral, Vector
from tracer.rays.colors import COLORS
from tracer.surfaces.filter import pass_or_absorb
from tracer.surfaces.interaction import Hit, Light, Optics, Outcome
from tracer.surfaces.surface import Surface, SurfaceRow, axis_of

__all__ = ["Polariser", "meet_polariser"]

_PASSED = int(Event.SPECULAR_REFRACTION | Event.POLARISER)


@stage_kernel
def meet_polariser(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Go straight on, or be absorbed, as natural light is."""
    colors = light.colors
    n_channels = colors.shape[1]
    spare = light.counters[COLORS] + 1
    for j in range(n_channels):
        clear = optics.surface_f[hit.surface, SURFACE_ROW + n_channels + j]
        colors[spare, j] = 0.5 * (1.0 + optics.surface_f[hit.surface, 0]) * clear
    return pass_or_absorb(_PASSED, light)


class Polariser(Surface):
    """Sheet that absorbs the vibration along ``absorbs``, a direction of the scene.

    ``extinction`` is the share of that vibration which gets through, ``transmittance`` that of the
    vibration across it. Natural light passes by half; what polarised light does needs
    ``[trace] light = "polarised"``.
    """

    kind: Literal["polariser"] = "polariser"
    absorbs: Vector | None = None
    extinction: Share = 0.0
    transmittance: Spectral | None = None
    number = POLARISER
    meet = meet_polariser

    def model_post_init(self, context: Any) -> None:
        if self.absorbs is None:
            raise ValueError("a polariser needs the axis that it absorbs")

    def compile(self, row: SurfaceRow) -> None:
        axis_of(self.absorbs, f"{row.place}.absorbs")
        row.set_shares(None, self.transmittance)
        if self.transmittance is None:
            row.transmittance[:] = 1.0
        row.numbers[0] = self.extinction

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        return PolariserLaw(
            absorbs=axis_of(self.absorbs, f"{row.place}.absorbs"),
            extinction=self.extinction,
            transmittance=tuple(row.transmittance.tolist()),
        )

    def transmits(self) -> bool:
        return True

    def needs_polarised_light(self) -> bool:
        return True


KINDS = (Polariser,)
