"""Media: how much light they absorb and scatter on its way, and where scattering sends it.

The index and the absorption of media by channel stand in the channel set itself; this adds what
scatters.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import FailFast, Field

from raymap.laws.law import Part
from raymap.laws.phase import PhaseLaw

__all__ = ["MediumLaw", "transmitted"]

F64 = NDArray[np.float64]


class MediumLaw(Part):
    """What a medium does to light inside.

    Attributes
    ----------
    scattering : coefficient by channel [1 / length_unit]; none where it does not scatter
    phase : where scattered light goes
    group_index : n - λ dn/dλ by channel, by which pulses travel; none where the map does not say
    """

    scattering: Annotated[tuple[Annotated[float, Field(ge=0.0)], ...], FailFast()] = ()
    phase: PhaseLaw | None = None
    group_index: Annotated[tuple[float, ...], FailFast()] = ()


def transmitted(coefficient: ArrayLike, length: ArrayLike) -> F64:
    """Share of light that a way leaves: exp(-µ s), also of an infinite coefficient.

    Parameters
    ----------
    coefficient : of absorption, or of absorption and scattering [1 / length unit]
    length : of the way
    """
    mu, s = np.asarray(coefficient, np.float64), np.asarray(length, np.float64)
    with np.errstate(over="ignore"):
        depth = np.where(s > 0.0, mu * np.where(s > 0.0, s, 1.0), 0.0)
    return np.exp(-depth)
