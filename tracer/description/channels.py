"""Colour channels of a scene."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.model.limits import MAX_CHANNELS
from tracer.description.fields import Node, Positive

__all__ = ["RGB_NM", "Spectrum", "Wavelengths"]

Array = NDArray[np.float64]

RGB_NM = (611.0, 549.0, 464.0)
"""Wavelengths that stand for R, G and B."""


class Wavelengths(Node):
    """Evenly spaced wavelengths [nm]."""

    first: Positive
    last: Positive
    count: Annotated[int, Field(ge=1, le=4096)]


class Spectrum(Node):
    """Colour channels of the trace: R, G, B, or any wavelengths [nm]."""

    kind: Literal["rgb", "spectral"] = "rgb"
    wavelengths_nm: tuple[Positive, ...] | Wavelengths | None = None

    def model_post_init(self, context: Any) -> None:
        if (self.kind == "spectral") != (self.wavelengths_nm is not None):
            raise ValueError("wavelengths_nm goes with kind = 'spectral', and only with it")
        if isinstance(self.wavelengths_nm, tuple) and len(self.wavelengths_nm) > MAX_CHANNELS:
            raise ValueError(
                f"{len(self.wavelengths_nm)} wavelengths; a map may have {MAX_CHANNELS} channels"
            )

    def channels(self) -> Array:
        """Wavelength of each channel [nm]."""
        if self.wavelengths_nm is None:
            return np.array(RGB_NM)
        if isinstance(self.wavelengths_nm, Wavelengths):
            w = self.wavelengths_nm
            return np.linspace(w.first, w.last, w.count)
        return np.array(self.wavelengths_nm)
