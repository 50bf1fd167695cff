"""What every body of the scene description has: a place, a medium, surfaces, and its faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.model.unfinished import Unfinished
from tracer.description.fields import Placed
from tracer.geometry.shapes import Shape

__all__ = ["Body", "FacePlan"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class FacePlan:
    """A face before it is numbered: name, primitives, surface by name, and its neighbours.

    ``partner`` names another body that lies beyond the face (a cemented interface), ``aliases``
    further full names.
    """

    name: str
    shapes: tuple[Shape, ...]
    surface: str | None = None
    partner: str | None = None
    aliases: tuple[str, ...] = ()
    event: int = 0


class Body(Placed):
    """What all bodies share.

    A body with a ``medium`` is a solid; without one its faces are open surfaces that light meets
    from both sides. ``faces`` gives single faces a surface of their own.
    """

    kind: str
    medium: str | None = None
    surface: str | None = None
    priority: int = 0
    faces: dict[str, str] = Field(default_factory=dict)

    def plan(self) -> list[FacePlan]:
        """The faces, with normals that point out of the body."""
        raise Unfinished(self, "plan")

    def crystal_axis(self) -> Array | None:
        """(3,) optic axis of a crystal that says none itself; None where the body has none."""
        return None

    def problems(self) -> list[str]:
        """What makes the body impossible, as 'key: what; remedy'."""
        return []
