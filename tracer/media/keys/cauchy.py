"""n = a + b / λ² + c / λ⁴ ..., the formula of Cauchy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracer.description.fields import Finite
from tracer.media.keys.key import At, MediumKey
from tracer.optics import dispersion

__all__ = ["CAUCHY"]


def _index(value: tuple[float, ...], at: At) -> NDArray[np.float64]:
    return dispersion.cauchy(value, name=at.place).index(at.wavelengths_nm)


CAUCHY = MediumKey(
    word="cauchy",
    title="Coefficients of n = a + b / λ² + c / λ⁴ ..., λ in µm",
    value=tuple[Finite, ...],
    index=_index,
    place=3.0,
)

KINDS = (CAUCHY,)
