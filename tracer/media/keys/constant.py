"""An index, and an absorption, as numbers or tables by wavelength."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracer.description.fields import ByWavelength, Spectral
from tracer.media.keys.key import At, MediumKey

__all__ = ["ABSORPTION", "INDEX"]


def _index(value: ByWavelength, at: At) -> NDArray[np.float64]:
    return at.values(value, "index")


def _absorption(value: ByWavelength, at: At) -> NDArray[np.float64]:
    return at.values(value, "absorption")


INDEX = MediumKey(
    word="index", title="The index: a number, or by wavelength", value=Spectral, index=_index,
    place=1.0,
)  # fmt: skip
ABSORPTION = MediumKey(
    word="absorption",
    title="Absorption coefficient [1/scene unit]: a number, or by wavelength",
    value=Spectral,
    absorption=_absorption,
    place=6.0,
)

KINDS = (INDEX, ABSORPTION)
