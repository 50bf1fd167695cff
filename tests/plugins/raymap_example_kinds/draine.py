"""``phase = { kind = "draine", g = 0.5, alpha = 1.0 }``: scattering by dust."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tracer.media.phases.phase import Phase

__all__ = ["Draine"]

F64 = NDArray[np.float64]


class Draine(Phase):
    """(1 + alpha mu²) / (1 + g² - 2 g mu)^1.5: Henyey-Greenstein at 0, Rayleigh at g = 0.

    References
    ----------
    B. T. Draine, Astrophysical Journal 598, 1017 (2003), eq. (4).
    """

    kind: Literal["draine"]
    g: Annotated[float, Field(gt=-1, lt=1)] = 0.0
    alpha: Annotated[float, Field(ge=0, le=1000)] = 1.0

    def density(self, mu: F64) -> F64:
        return (1.0 + self.alpha * mu**2) / (1.0 + self.g**2 - 2.0 * self.g * mu) ** 1.5
