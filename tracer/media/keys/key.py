"""What a key of a medium is, and those that there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.registry import Registry
from raymap.model.units import length_scale
from tracer.description.channels import RGB_NM
from tracer.description.fields import ByWavelength

__all__ = ["MEDIUM_KEYS", "At", "MediumKey"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class At:
    """Where a quantity of a medium is asked for.

    Attributes
    ----------
    wavelengths_nm : (n,) vacuum wavelengths [nm]
    length_unit : of the scene
    place : of the medium, for messages
    """

    wavelengths_nm: Array
    length_unit: str
    place: str

    def values(self, given: ByWavelength, key: str) -> Array:
        """A quantity that is given by wavelength, at the wavelengths.

        Raises
        ------
        SceneError
            with the place
        """
        try:
            return given.at(self.wavelengths_nm, np.array(RGB_NM))
        except SceneError as error:
            raise SceneError(f"{self.place}.{key}: {error}") from None

    def per_unit(self, per_mm: Array) -> Array:
        """Coefficients [1/mm] by the scene's unit of length."""
        return per_mm * length_scale(self.length_unit, "mm")


@dataclass(frozen=True, kw_only=True, eq=False)
class MediumKey:
    """A key of ``[media.NAME]`` that says an index, an absorption, or both.

    Attributes
    ----------
    word : of the scene file
    title : what it is, in a few words
    value : type of what is given, as an annotation of pydantic
    index : refractive indices, of the value and where they are asked for; None where it says none.
        A medium has exactly one key that does
    absorption : coefficients [1 / scene unit], 0 or more; None where it says none. A key that says
        nothing else goes before what an index brings along
    splits : whether light in it splits in two, so that rays carry their polarisation
    alone : why nothing but an index may stand beside it, for messages; "" where it may
    place : in lists
    """

    word: str
    title: str
    value: Any
    index: Callable[[Any, At], Array] | None = None
    absorption: Callable[[Any, At], Array] | None = None
    splits: bool = False
    alone: str = ""
    place: float = 1000.0


MEDIUM_KEYS: Registry[MediumKey] = Registry(
    "tracer.media",
    "tracer.media.keys",
    words=lambda key: (key.word,),
    of=MediumKey,
    sort="keys of media: index and absorption",
)
