"""``conrady = [A, B, C]`` of a medium: its index by the formula of Conrady."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracer.description.fields import Finite
from tracer.media.keys.key import At, MediumKey

__all__ = ["CONRADY"]


def index(value: tuple[float, float, float], at: At) -> NDArray[np.float64]:
    """A + B / λ + C / λ^3.5, λ in µm.

    References
    ----------
    A. E. Conrady, Applied Optics and Optical Design, part 2, Dover (1960), p. 659.
    """
    a, b, c = value
    micrometre = at.wavelengths_nm * 1e-3
    return a + b / micrometre + c / micrometre**3.5


CONRADY = MediumKey(
    word="conrady",
    title="A, B, C of n = A + B / λ + C / λ^3.5, λ in µm",
    value=tuple[Finite, Finite, Finite],
    index=index,
)
