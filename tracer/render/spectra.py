"""From wall colours to spectra, and from sampled spectra back to linear sRGB.

A wall of linear sRGB (r, g, b) emits r R + g G + b B times daylight D65, where R, G, B are the
smoothest spectra between 0 and 1 that add up to 1 and have the colours of the primaries. The way
back integrates the CIE 1931 observer over the wavelengths of the picture; the 3 x 3 matrix that
this leaves (a few per mille from the identity for 21 wavelengths) is divided out, so that a bare
wall has exactly its colour whatever wavelengths were chosen.

References
----------
I. Mallett, C. Yuksel, "Spectral primary decomposition for rendering with sRGB reflectance",
Eurographics Symposium on Rendering (2019).
"""

from __future__ import annotations

from functools import cache
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.optics.colorimetry import color_matching, illuminant_d65, xyz_to_linear_srgb

__all__ = ["primary_spectra", "rgb_weights", "visible_wavelengths"]

Real = NDArray[np.float64]


@cache
def _table() -> Real:
    text = resources.files("tracer.render").joinpath("rgb_basis.csv").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line and line[0].isdigit()]
    return np.array([[float(cell) for cell in row.split(",")] for row in rows])


def visible_wavelengths(count: int) -> Real:
    """``count`` wavelengths [nm] over 380 .. 780, 21 of them in steps of 20."""
    if count == 1:
        return np.array([589.3])
    return np.linspace(380.0, 780.0, count)


def primary_spectra(wavelengths_nm: ArrayLike) -> Real:
    """(n, 3) relative emission of red, green and blue walls, white = daylight, 1 on average."""
    wavelength = np.asarray(wavelengths_nm, np.float64)
    table = _table()
    shares = np.stack([np.interp(wavelength, table[:, 0], table[:, k]) for k in (1, 2, 3)], axis=-1)
    shares /= shares.sum(axis=-1, keepdims=True)
    daylight = illuminant_d65(wavelength)
    return np.asarray(shares * (daylight / daylight.mean())[:, None])


def rgb_weights(wavelengths_nm: ArrayLike) -> Real:
    """(n, 3) weights that turn radiances at these wavelengths into linear sRGB.

    With fewer than three wavelengths, or ones that cannot tell the primaries apart, the weights
    are grey: a white wall has the value 1.
    """
    wavelength = np.asarray(wavelengths_nm, np.float64)
    spectra = primary_spectra(wavelength)
    weights = xyz_to_linear_srgb(color_matching(wavelength))
    response = weights.T @ spectra
    if len(wavelength) >= 3 and np.linalg.cond(response) < 100.0:
        return np.asarray(weights @ np.linalg.inv(response).T)
    white = spectra.sum(axis=1)
    return np.repeat((1.0 / (len(wavelength) * white))[:, None], 3, axis=1)
