"""Into all directions alike."""

from __future__ import annotations

from typing import ClassVar, Literal

from raymap.laws.phase import PhaseLaw
from tracer.media.phases.phase import Phase

__all__ = ["Isotropic"]


class Isotropic(Phase):
    """Into all directions alike."""

    kind: Literal["isotropic"]

    place: ClassVar[float] = 1

    def stated(self) -> PhaseLaw:
        return PhaseLaw(**self.model_dump(exclude_unset=True))


KINDS = (Isotropic,)
