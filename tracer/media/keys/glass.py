"""A glass of the catalogues: its index, and its absorption where that is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.media.keys.key import At, MediumKey
from tracer.optics.glasses import Glass, find_glass

__all__ = ["GLASS", "catalogue_glass"]


def catalogue_glass(name: str, where: str) -> Glass:
    """A glass by its name.

    Raises
    ------
    SceneError
        with the place of the medium
    """
    try:
        return find_glass(name)
    except SceneError as error:
        raise SceneError(f"{where}.glass: {error}") from None


def _index(value: str, at: At) -> NDArray[np.float64]:
    return np.asarray(catalogue_glass(value, at.place).index(at.wavelengths_nm))


def _absorption(value: str, at: At) -> NDArray[np.float64]:
    return at.per_unit(catalogue_glass(value, at.place).absorption(at.wavelengths_nm))


GLASS = MediumKey(
    word="glass",
    title="A name of the catalogues, with the absorption that these say",
    value=str,
    index=_index,
    absorption=_absorption,
    place=4.0,
)

KINDS = (GLASS,)
