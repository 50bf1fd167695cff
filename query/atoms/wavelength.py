"""``wavelength < 500 nm``: vacuum wavelength of a ray at its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundNode, BoundValue
from query.engine.context import Context, RayContext
from query.engine.kleene import Pair, exactly
from query.engine.surface_parameters import COMPARISONS
from query.expression.atom import Comparison, Quantity

__all__ = ["KINDS", "Wavelength", "wavelength"]


class Wavelength(Quantity):
    """Vacuum wavelength of the ray at its end [nm]; undefined while several channels travel."""

    word = "wavelength"
    title = "vacuum wavelength at its end"
    dimension = "wavelength"
    place = 200

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        channels = [w for chosen in binder.facts.channel_sets for w in chosen.wavelengths_nm]
        compares = COMPARISONS[comparison.operator]
        possible = any(compares(w, comparison.value) for w in channels)
        return BoundWavelength(text=text, **vars(comparison), possible=possible)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundWavelength(BoundValue):
    """``possible``: some channel of the map satisfies it."""

    possible: bool

    def own_streams(self) -> tuple[str, ...]:
        return ("color",) if self.possible else ()

    def values(self, context: RayContext) -> NDArray[Any]:
        return context.wavelength

    def on_rays(self, context: Context) -> Pair:
        if not self.possible:
            return exactly(np.zeros(context.n_rays, np.bool_))
        return super().on_rays(context)

    def never(self, map: Any) -> str | None:
        if self.possible:
            return None
        nm = sorted({w for chosen in map.channel_sets for w in chosen.wavelengths_nm})
        channels = ", ".join(f"{w:g}" for w in nm[:12]) + (" …" if len(nm) > 12 else "")
        return f"{self.text}: the channels of this map are {channels} nm"


wavelength = Wavelength()

KINDS = (Wavelength,)
