"""The glass of a lens: index and absorption at any wavelength that its data cover."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracer.lens.errors import LensError
from tracer.optics.absorption import absorption_from_transmittance
from tracer.optics.dispersion import Dispersion, constant
from tracer.optics.glasses import find_glass

__all__ = ["AIR", "Glass"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Glass:
    """A refractive index law and a table of internal transmittance.

    Attributes
    ----------
    dispersion : refractive index, relative to the air around the lens
    transmittance : internal transmittance by wavelength [nm] of ``transmittance_length_mm`` of
        glass (without reflection losses); empty for clear glass
    transmittance_length_mm : thickness that the table is for, 10 or 25 mm in catalogues
    """

    dispersion: Dispersion
    transmittance: Mapping[float, float] | tuple[tuple[float, float], ...] = ()
    transmittance_length_mm: float = 10.0

    def __post_init__(self) -> None:
        table = tuple(sorted(dict(self.transmittance).items()))
        for wavelength, value in table:
            if not (0.0 <= value <= 1.0 and math.isfinite(wavelength)):
                raise LensError(
                    f"transmittance of {self.name} is {value:g} at {wavelength:g} nm: "
                    "an internal transmittance lies between 0 and 1"
                )
        if not self.transmittance_length_mm > 0.0:
            raise LensError(
                f"transmittance_length_mm of {self.name} is {self.transmittance_length_mm:g}: "
                "it must be a positive thickness"
            )
        object.__setattr__(self, "transmittance", table)

    @property
    def name(self) -> str:
        """Name of the glass, for messages."""
        return self.dispersion.name or f"the {self.dispersion.kind} glass"

    def index(self, wavelength_nm: ArrayLike) -> Real:
        """Refractive index at vacuum wavelengths [nm].

        Raises
        ------
        LensError
            where the data do not reach
        """
        wavelengths = np.asarray(wavelength_nm, np.float64)
        low, high = self.dispersion.range_nm
        bad = ~((wavelengths >= low) & (wavelengths <= high) & (wavelengths > 0.0))
        if np.any(bad):
            example = float(wavelengths[bad].flat[0]) if wavelengths.ndim else float(wavelengths)
            raise LensError(
                f"wavelength_nm is {example:g}: the data of {self.name} cover {low:g} to "
                f"{high:g} nm; choose a wavelength inside"
            )
        return self.dispersion.index(wavelengths)

    def absorption(self, wavelength_nm: ArrayLike) -> Real:
        """Absorption coefficient [1/mm]; infinite where the table says opaque.

        Outside the table its end values hold, with a warning.
        """
        wavelengths = np.asarray(wavelength_nm, np.float64)
        if not self.transmittance:
            return np.zeros_like(wavelengths)
        table = np.array(self.transmittance, np.float64)
        return absorption_from_transmittance(
            wavelengths, table[:, 0], table[:, 1], self.transmittance_length_mm, name=self.name
        )

    @classmethod
    def named(cls, name: str) -> Glass:
        """A glass of the catalogues, e.g. "N-BK7".

        Raises
        ------
        SceneError
            no catalogue has it
        """
        found = find_glass(name)
        pairs = zip(found.transmittance_nm.tolist(), found.transmittance.tolist(), strict=True)
        return cls(dispersion=found.dispersion, transmittance=tuple(pairs))

    @classmethod
    def of(cls, text: str) -> Glass | float:
        """A constant index from a number, or a glass by name."""
        try:
            return float(text)
        except ValueError:
            return cls.named(text)


AIR = Glass(dispersion=constant(1.0, name="air"))
