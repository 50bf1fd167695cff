"""Colours of thin sections and crystals between polarisers in white light.

Between crossed polarisers, with its vibrations at 45 deg to theirs, a plate of path difference G
transmits sin²(pi G / wavelength): the colours of the Michel-Lévy chart.

References
----------
Born & Wolf, Principles of Optics, 7th ed., 15.4.2 eq (14). Integrals over 380 .. 780 nm with the
CIE 1931 2° observer.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.optics.colorimetry import (
    color_matching,
    encode_srgb,
    illuminant_a,
    illuminant_d65,
    illuminant_e,
    into_gamut,
    xyz_to_linear_srgb,
)
from tracer.optics.polarization_rays import PolarizationError

__all__ = [
    "WHITE_NM",
    "Illuminant",
    "interference_srgb",
    "interference_xyz",
    "srgb_of",
    "transmission_to_xyz",
    "white_weights",
]

Real = NDArray[np.float64]
Illuminant = Literal["D65", "A", "E"]

WHITE_NM: Real = np.arange(380.0, 780.5, 1.0)
"""Wavelengths of white light [nm]."""

_ILLUMINANTS = {"D65": illuminant_d65, "A": illuminant_a, "E": illuminant_e}


def white_weights(wavelength_nm: ArrayLike, illuminant: Illuminant = "D65") -> Real:
    """(n, 3) weights: XYZ of a transmission is its sum with them; Y of no plate is 1."""
    if illuminant not in _ILLUMINANTS:
        raise PolarizationError(
            f"illuminant is {illuminant!r}: choose one of {', '.join(_ILLUMINANTS)}"
        )
    wavelengths = np.asarray(wavelength_nm, np.float64)
    weights = color_matching(wavelengths) * _ILLUMINANTS[illuminant](wavelengths)[:, np.newaxis]
    return np.asarray(weights / weights[:, 1].sum())


def transmission_to_xyz(
    wavelength_nm: ArrayLike, transmission: ArrayLike, illuminant: Illuminant = "D65"
) -> Real:
    """XYZ (..., 3) of transmissions (..., n) at wavelengths (n,) [nm], even spacing."""
    return np.asarray(
        np.asarray(transmission, np.float64) @ white_weights(wavelength_nm, illuminant)
    )


def interference_xyz(
    path_difference_nm: ArrayLike,
    *,
    illuminant: Illuminant = "D65",
    polarisers: Literal["crossed", "parallel"] = "crossed",
) -> Real:
    """XYZ (..., 3) of path differences (...) [nm], the same at all wavelengths; white has Y = 1."""
    difference = np.asarray(path_difference_nm, np.float64)[..., np.newaxis]
    crossed = np.sin(np.pi * difference / WHITE_NM) ** 2
    transmission = crossed if polarisers == "crossed" else 1.0 - crossed
    return transmission_to_xyz(WHITE_NM, transmission, illuminant)


def interference_srgb(
    path_difference_nm: ArrayLike,
    *,
    illuminant: Illuminant = "D65",
    polarisers: Literal["crossed", "parallel"] = "crossed",
) -> Real:
    """Encoded sRGB (..., 3), 0 .. 1, of path differences (...) [nm]."""
    xyz = interference_xyz(path_difference_nm, illuminant=illuminant, polarisers=polarisers)
    return srgb_of(xyz)


def srgb_of(xyz: ArrayLike, *, exposure: float = 1.0) -> Real:
    """Encoded sRGB of XYZ, brought into the gamut; ``exposure`` multiplies the light."""
    return encode_srgb(into_gamut(xyz_to_linear_srgb(np.asarray(xyz, np.float64) * exposure)))
