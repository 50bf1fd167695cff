"""Points that fill a cube evenly, for pictures without grain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["quasi_random"]


def quasi_random(count: int, dimensions: int, *, shift: float = 0.0) -> NDArray[np.float64]:
    """(count, dimensions) points in 0 .. 1 by additive recurrence.

    The steps are powers of 1/g with g^(d+1) = g + 1, the generalised golden ratio; ``shift`` gives
    another set.
    """
    g = 1.5
    for _ in range(40):
        g = (1.0 + g) ** (1.0 / (dimensions + 1))
    steps = g ** -np.arange(1.0, dimensions + 1.0)
    number = np.arange(1.0, count + 1.0)[:, None]
    points: NDArray[np.float64] = (0.5 + shift + number * steps) % 1.0
    return points
