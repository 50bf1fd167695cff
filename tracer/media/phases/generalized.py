"""A / (1 + g² - 2 g mu)^gamma, by `g` and `gamma`."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from raymap.laws.phase import PhaseLaw
from tracer.media.phases.phase import Phase

__all__ = ["Generalized"]


class Generalized(Phase):
    """A / (1 + g² - 2 g mu)^gamma, by ``g`` and ``gamma``."""

    kind: Literal["generalized"]
    g: Annotated[float, Field(gt=-1, lt=1)] = 0.0
    gamma: Annotated[float, Field(ge=-1000, le=1000)] = 1.5

    place: ClassVar[float] = 3

    def stated(self) -> PhaseLaw:
        return PhaseLaw(**self.model_dump(exclude_unset=True))


KINDS = (Generalized,)
