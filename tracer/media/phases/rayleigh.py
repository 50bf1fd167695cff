"""Of particles far smaller than the wavelength."""

from __future__ import annotations

from typing import ClassVar, Literal

from raymap.laws.phase import PhaseLaw
from tracer.media.phases.phase import Phase

__all__ = ["Rayleigh"]


class Rayleigh(Phase):
    """Of particles far smaller than the wavelength."""

    kind: Literal["rayleigh"]

    place: ClassVar[float] = 4

    def stated(self) -> PhaseLaw:
        return PhaseLaw(**self.model_dump(exclude_unset=True))


KINDS = (Rayleigh,)
