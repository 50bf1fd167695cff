"""Measured: `value` at `angle_deg` from 0 to 180."""

from __future__ import annotations

from typing import ClassVar, Literal

from raymap.laws.phase import PhaseLaw
from tracer.description.fields import Finite
from tracer.media.phases.phase import Phase

__all__ = ["Tabulated"]


class Tabulated(Phase):
    """Measured: ``value`` at ``angle_deg`` from 0 to 180."""

    kind: Literal["tabulated"]
    angle_deg: tuple[Finite, ...] = ()
    value: tuple[Finite, ...] = ()

    place: ClassVar[float] = 5

    def stated(self) -> PhaseLaw:
        return PhaseLaw(**self.model_dump(exclude_unset=True))


KINDS = (Tabulated,)
