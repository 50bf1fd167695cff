"""Sources of kind elliptical: light that fills an elliptical pupil."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.jit.kernels import lean_kernel
from raymap.optics.angles import turned
from tracer.description.fields import Positive
from tracer.sources.source import Source, SourceLaw

__all__ = ["EllipticalSource"]

Array = NDArray[np.float64]
HalfAngle = Annotated[float, Field(gt=0, le=90)]


@lean_kernel
def emit(
    own: Array, u1: float, u2: float, u3: float, u4: float, u5: float
) -> tuple[float, float, float, float, float, float]:
    """Uniform over an ellipse: of places, or of directions in Lambert's azimuthal projection.

    The projection sin(theta/2) keeps solid angles, so that the cone is filled evenly.
    """
    radius = math.sqrt(u1)
    cosine, sine = turned(u2)
    a, b = own[0] * radius * cosine, own[1] * radius * sine
    x, y = a * own[2] - b * own[3], a * own[3] + b * own[2]
    if own[4] == 0.0:
        return x, y, 0.0, 0.0, 0.0, 1.0
    half2 = x * x + y * y
    # sin(theta) = 2 sin(theta/2) cos(theta/2)
    factor = 2.0 * math.sqrt(max(1.0 - half2, 0.0))
    return 0.0, 0.0, 0.0, factor * x, factor * y, 1.0 - 2.0 * half2


class EllipticalSource(Source):
    """A parallel beam of elliptical section (``size``), or such a cone from a point (``cone_deg``).

    ``size`` holds both diameters, ``cone_deg`` both half angles; ``turn_deg`` turns the first of
    them about the axis.
    """

    kind: Literal["elliptical"] = "elliptical"
    size: tuple[Positive, Positive] | None = None
    cone_deg: tuple[HalfAngle, HalfAngle] | None = None
    turn_deg: float = Field(0.0, ge=-360, le=360)

    law = SourceLaw(emit=emit)

    def model_post_init(self, context: object) -> None:
        if (self.size is None) == (self.cone_deg is None):
            raise ValueError("give either size (a beam) or cone_deg (a cone)")
        super().model_post_init(context)

    def own(self) -> Sequence[float]:
        """Half axes, of places or of sin(theta/2); cosine and sine of the turn; whether a cone."""
        turn = math.radians(self.turn_deg)
        if self.cone_deg is not None:
            a, b = (math.sin(math.radians(0.5 * angle)) for angle in self.cone_deg)
            return [a, b, math.cos(turn), math.sin(turn), 1.0]
        assert self.size is not None
        return [0.5 * self.size[0], 0.5 * self.size[1], math.cos(turn), math.sin(turn), 0.0]

    def half_size(self) -> tuple[float, float, float]:
        a, b, cosine, sine, cone = self.own()
        if cone:
            return 0.0, 0.0, 0.0
        return math.hypot(a * cosine, b * sine), math.hypot(a * sine, b * cosine), 0.0


KINDS = (EllipticalSource,)
