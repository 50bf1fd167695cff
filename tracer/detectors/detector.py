"""What every detector of the scene description has, and how kinds of other makers register."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.jit.compiling import Door
from tracer.description.fields import Node

__all__ = ["REGISTER", "DetectorKind", "Side", "ViewDetector"]

Array = NDArray[np.float64]
Side = Annotated[int, Field(ge=1, le=65_535)]

_WAY = (0.0, 0.0, 1.0)

REGISTER = Door((0.0, 0.0, 0.0, 0.0), (np.zeros(1), *_WAY, *_WAY, 0.0, True))
"""``register(own, x, y, z, dx, dy, dz, length, leaves) -> t, u, v, cosine``: where along a segment
light registers [scene units], and in which place of the grid (u and v from 0 to 1); t below 0 where
it does not. ``leaves`` says that the segment ends at the edge of the world."""


class DetectorKind(Node):
    """What all detectors share: a grid of cells that counts light."""

    kind: str
    cells: tuple[Side, Side] | None = None


class ViewDetector(DetectorKind):
    """A kind of another distribution: it counts light that passes, and stops none.

    Its function ``register`` is asked for every segment, in a frame of the detector's own. In the
    map it stands as one of the stored forms of detectors, whose meaning ``parameters`` complete.
    """

    register: ClassVar[Any] = None
    """Compiled function (see `REGISTER`)."""
    stored: ClassVar[Literal["plane", "far_field", "camera", "surface"]] = "camera"
    """Stored form."""

    def center(self) -> tuple[float, float, float]:
        """Origin of its frame."""
        return 0.0, 0.0, 0.0

    def axes(self) -> tuple[Array, Array, Array]:
        """Unit vectors u, v and the third axis of its frame."""
        return np.eye(3)[0], np.eye(3)[1], np.eye(3)[2]

    def own(self) -> Sequence[float]:
        """At most 12 numbers that ``register`` is handed."""
        return ()

    def extent(self) -> tuple[float, float]:
        """Extent of the grid along u and v, in the unit ``parameters()["size_unit"]``."""
        return 1.0, 1.0

    def parameters(self) -> dict[str, Any]:
        """What the map says of it."""
        return {"size_unit": "1"}

    def box(self) -> tuple[Array, Array] | None:
        """Corners of the box that it takes in the scene; None where it has no place."""
        return None
