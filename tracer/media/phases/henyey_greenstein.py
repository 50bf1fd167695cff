"""Of the mean cosine `g`, -1 .. 1."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from raymap.laws.phase import PhaseLaw
from tracer.media.phases.phase import Phase

__all__ = ["HenyeyGreenstein"]


class HenyeyGreenstein(Phase):
    """Of the mean cosine ``g``, -1 .. 1."""

    kind: Literal["henyey_greenstein"]
    g: Annotated[float, Field(gt=-1, lt=1)] = 0.0

    place: ClassVar[float] = 2

    def stated(self) -> PhaseLaw:
        return PhaseLaw(**self.model_dump(exclude_unset=True))


KINDS = (HenyeyGreenstein,)
