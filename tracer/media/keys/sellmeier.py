"""n² = 1 + Σ b λ² / (λ² - c), the formula of Sellmeier."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracer.description.fields import Finite, Node
from tracer.media.keys.key import At, MediumKey
from tracer.optics import dispersion

__all__ = ["SELLMEIER", "Sellmeier"]


class Sellmeier(Node):
    """n² = 1 + Σ b λ² / (λ² - c), λ in µm, c in µm²."""

    b: tuple[Finite, Finite, Finite]
    c: tuple[Finite, Finite, Finite]


def _index(value: Sellmeier, at: At) -> NDArray[np.float64]:
    return dispersion.sellmeier(value.b, value.c, name=at.place).index(at.wavelengths_nm)


SELLMEIER = MediumKey(
    word="sellmeier",
    title="`b` and `c` of n² = 1 + Σ b λ² / (λ² - c), λ in µm",
    value=Sellmeier,
    index=_index,
    place=2.0,
)

KINDS = (SELLMEIER,)
