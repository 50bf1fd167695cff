"""``kappa = ...`` of a medium: absorption by the imaginary part of its index."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracer.description.fields import ByWavelength, Spectral
from tracer.media.keys.key import At, MediumKey

__all__ = ["KAPPA"]


def absorption(value: ByWavelength, at: At) -> NDArray[np.float64]:
    """4 pi kappa / λ."""
    return at.per_unit(4.0 * np.pi * at.values(value, "kappa") / (at.wavelengths_nm * 1e-6))


KAPPA = MediumKey(
    word="kappa",
    title="Imaginary part of the index: a number, or by wavelength",
    value=Spectral,
    absorption=absorption,
)
