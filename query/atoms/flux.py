"""``flux > 1e-9 W``: flux that a ray carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Binder
from query.engine.bound import BoundCompare, BoundNode, compare, unknown
from query.engine.context import Context, RayContext
from query.engine.kleene import Pair, exactly
from query.expression.atom import Comparison, Quantity

__all__ = ["KINDS", "Flux", "flux"]


class Flux(Quantity):
    """Flux that the ray carries [flux unit of the map]."""

    word = "flux"
    title = "flux that the ray carries"
    dimension = "flux"
    place = 240

    def bind(self, binder: Binder, comparison: Comparison, text: str) -> BoundNode:
        facts = binder.facts
        fluxes = np.array([source.flux for source in binder.directory.sources], np.float64)
        return BoundFlux(
            text=text,
            **vars(comparison),
            per_weight=fluxes / np.maximum(facts.emitted, 1),
            weighted=facts.weighted,
            worth_by_color=facts.worth_by_color,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundFlux(BoundCompare):
    """The flux of a ray at its end.

    ``per_weight`` : (n_sources,) flux of a ray of weight 1; ``weighted``: weights are stored;
    ``worth_by_color``: it depends on the colour, too.
    """

    per_weight: NDArray[np.float64]
    weighted: bool
    worth_by_color: bool

    def own_streams(self) -> tuple[str, ...]:
        return ("weight",) * self.weighted + ("color",) * self.worth_by_color

    def on_rays(self, context: Context) -> Pair:
        flux = self.per_weight[context.source]
        if self.weighted or self.worth_by_color:
            if not isinstance(context, RayContext):
                return unknown(context)
            flux = flux * context.carried
        return exactly(compare(self.operator, flux, self.value))

    def samples(self, context: RayContext) -> tuple[NDArray[Any], NDArray[Any]]:
        return np.arange(context.n_rays), self.per_weight[context.source] * context.carried


flux = Flux()

KINDS = (Flux,)
