"""Sheet retarders: the vibration along an axis is delayed."""

from __future__ import annotations

from typing import Any, Literal

from raymap.jit.kernels import stage_kernel
from raymap.laws.law import Law as StoredLaw
from raymap.laws.sheet import RetarderLaw
from raymap.model.events import Event
from tracer.compiled import RETARDER
from tracer.description.fields import Spectral, Vector
from tracer.surfaces.interaction import Hit, Light, Optics, Outcome
from tracer.surfaces.surface import Surface, SurfaceRow, axis_of

__all__ = ["Retarder", "meet_retarder"]

_PASSED = int(Event.SPECULAR_REFRACTION)


@stage_kernel
def meet_retarder(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Go straight on."""
    return _PASSED, 0.0, 0.0, 0.0, light.code, light.state


class Retarder(Surface):
    """Sheet that delays the vibration along ``slow``, a direction of the scene.

    ``retardance_nm`` is the difference of optical paths, a quarter of the wavelength for a
    quarter-wave plate; it is the same at all angles. Natural light passes unchanged; what polarised
    light does needs ``[trace] light = "polarised"``.
    """

    kind: Literal["retarder"] = "retarder"
    slow: Vector | None = None
    retardance_nm: Spectral | None = None
    number = RETARDER
    meet = meet_retarder

    def model_post_init(self, context: Any) -> None:
        if self.slow is None or self.retardance_nm is None:
            raise ValueError("a retarder needs its slow axis and its retardance_nm")

    def compile(self, row: SurfaceRow) -> None:
        axis_of(self.slow, f"{row.place}.slow")

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        return RetarderLaw(
            slow=axis_of(self.slow, f"{row.place}.slow"),
            retardance_nm=row.listed(self.retardance_nm),
        )

    def transmits(self) -> bool:
        return True

    def needs_polarised_light(self) -> bool:
        return True


KINDS = (Retarder,)
