"""``crosses(plane(z=120, size=[36, 24]))``: passes a place where no detector stood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from query.engine.bind import Binder, Misfit
from query.engine.bound import BoundNode, unknown
from query.engine.context import Context, RayContext
from query.engine.kleene import Pair, exactly
from query.engine.places import parse_place
from query.expression.arguments import Places
from query.expression.atom import Condition
from raymap.model.errors import CriterionError, RayMapError
from raymap.passes.crossings import Place, crossings_of_rays

__all__ = ["KINDS", "Crosses", "crosses"]


@dataclass(frozen=True)
class Crosses(Condition):
    """Passes one of these places, from a side that registers it."""

    places: tuple[str, ...]

    word = "crosses"
    title = "passes a place without a detector"
    arguments = (Places(help="plane, sphere, far_field or moved"),)
    place = 35

    def __post_init__(self) -> None:
        if not self.places:
            raise CriterionError("crosses takes a place, as plane(z=120, size=[36, 24])")

    def bind(self, binder: Binder, text: str) -> BoundNode:
        try:
            found = tuple(parse_place(each, binder.directory) for each in self.places)
        except RayMapError as error:
            raise Misfit(CriterionError(str(error)), self.places[0]) from None
        return BoundCrosses(text=text, places=found)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundCrosses(BoundNode):
    """Some segment crosses one of the places."""

    places: tuple[Place, ...]

    def own_streams(self) -> tuple[str, ...]:
        return ("position",)

    def on_rays(self, context: Context) -> Pair:
        if not isinstance(context, RayContext):
            return unknown(context)
        found = np.zeros(context.n_rays, np.bool_)
        for place in self.places:
            found |= (
                crossings_of_rays(
                    place,
                    context.position,
                    np.asarray(context.starts, np.int64),
                    np.asarray(context.lengths, np.int64),
                    context.left,
                )
                > 0
            )
        return exactly(found)


def crosses(*places: str) -> Crosses:
    """Passes one of these places: ``crosses("plane(z=120, size=[36, 24])")``."""
    return Crosses(tuple(" ".join(place.split()) for place in places))


KINDS = (Crosses,)
