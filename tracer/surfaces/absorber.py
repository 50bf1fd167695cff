"""Absorbers: they take all light."""

from __future__ import annotations

from typing import Literal

from raymap.laws.law import Law as StoredLaw
from raymap.laws.smooth import AbsorberLaw
from tracer.compiled import ABSORBER
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = ["Absorber"]


class Absorber(Surface):
    """Takes all light."""

    kind: Literal["absorber"] = "absorber"
    number = ABSORBER

    def compile(self, row: SurfaceRow) -> None:
        """Nothing to say."""

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        return AbsorberLaw()


KINDS = (Absorber,)
