"""Colour and light: from wavelengths to XYZ, linear sRGB and lumen.

The observer is the CIE 1931 2° standard observer, white is D65. Spectra are sums over samples or
integrals by the trapezoidal rule; wavelengths in nm. RGB values are linear sRGB (IEC 61966-2-1)
unless a name says *encoded*.
"""

from __future__ import annotations

from functools import cache
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "LUMINOUS_EFFICACY",
    "RGB_LUMINANCE",
    "RGB_WAVELENGTHS_NM",
    "channel_display_rgb",
    "chromaticity",
    "color_matching",
    "decode_srgb",
    "encode_srgb",
    "illuminant_a",
    "illuminant_d65",
    "illuminant_e",
    "into_gamut",
    "linear_srgb_to_xyz",
    "luminous_efficacy",
    "photopic",
    "spectrum_luminous_efficacy",
    "spectrum_to_xyz",
    "xyz_to_linear_srgb",
]

Array = NDArray[np.float64]

LUMINOUS_EFFICACY = 683.0
"""Lumen per watt where the photopic observer sees best [lm/W]."""

RGB_LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Luminance Y of the primaries of linear sRGB."""

RGB_WAVELENGTHS_NM = (611.0, 549.0, 464.0)
"""Dominant wavelengths of the sRGB primaries: where media are evaluated for an RGB trace [nm]."""

_PRIMARIES_XY = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
_WHITE_XY = np.array([0.3127, 0.3290])
_C2_ILLUMINANT_A = 1.435e7  # nm K, the value of the definition of illuminant A
_T_ILLUMINANT_A = 2848.0


@cache
def _table(name: str) -> Array:
    text = resources.files("raymap.optics").joinpath(name).read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line and not line.startswith("#")][1:]
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    table.flags.writeable = False
    return table


def color_matching(wavelength_nm: ArrayLike) -> Array:
    """Colour-matching functions of the CIE 1931 2° observer, 0 outside 360 .. 830 nm.

    Parameters
    ----------
    wavelength_nm : (...) [nm]

    Returns
    -------
    xyz : (..., 3) x̄, ȳ, z̄
    """
    table = _table("cie_1931.csv")
    wavelength = np.asarray(wavelength_nm, np.float64)
    columns = [
        np.interp(wavelength, table[:, 0], table[:, column], left=0.0, right=0.0)
        for column in (1, 2, 3)
    ]
    return np.stack(columns, axis=-1)


def photopic(wavelength_nm: ArrayLike) -> Array:
    """Luminous efficiency V(λ) of the photopic observer, which is ȳ."""
    return np.asarray(color_matching(wavelength_nm)[..., 1])


def luminous_efficacy(wavelength_nm: ArrayLike) -> Array:
    """Lumen per watt of light of one wavelength, 683 V(λ) [lm/W]."""
    return LUMINOUS_EFFICACY * photopic(wavelength_nm)


def illuminant_a(wavelength_nm: ArrayLike) -> Array:
    """Relative power of CIE standard illuminant A (a tungsten lamp), 100 at 560 nm."""
    wavelength = np.asarray(wavelength_nm, np.float64)
    exponent = _C2_ILLUMINANT_A / _T_ILLUMINANT_A
    return np.asarray(
        100.0
        * (560.0 / wavelength) ** 5
        * np.expm1(exponent / 560.0)
        / np.expm1(exponent / wavelength)
    )


def illuminant_d65(wavelength_nm: ArrayLike) -> Array:
    """Relative power of CIE standard illuminant D65 (daylight), 100 at 560 nm, 300 .. 830 nm."""
    table = _table("illuminant_d65.csv")
    return np.interp(
        np.asarray(wavelength_nm, np.float64), table[:, 0], table[:, 1], left=0.0, right=0.0
    )


def illuminant_e(wavelength_nm: ArrayLike) -> Array:
    """Relative power of the equal-energy illuminant, 100 everywhere."""
    return np.full_like(np.asarray(wavelength_nm, np.float64), 100.0)


def spectrum_to_xyz(wavelength_nm: ArrayLike, power_per_nm: ArrayLike) -> Array:
    """XYZ of a spectrum by the trapezoidal rule; Y is the integral of ȳ times the power.

    Parameters
    ----------
    wavelength_nm : (n,) rising [nm]
    power_per_nm : (..., n)

    Returns
    -------
    xyz : (..., 3)
    """
    wavelength = np.asarray(wavelength_nm, np.float64)
    weighted = np.asarray(power_per_nm, np.float64)[..., None] * color_matching(wavelength)
    return np.asarray(np.trapezoid(weighted, wavelength, axis=-2))


def spectrum_luminous_efficacy(wavelength_nm: ArrayLike, power_per_nm: ArrayLike) -> float:
    """Lumen per watt of a spectrum, over all of its power [lm/W]."""
    wavelength = np.asarray(wavelength_nm, np.float64)
    power = np.asarray(power_per_nm, np.float64)
    luminous = np.trapezoid(power * photopic(wavelength), wavelength)
    return float(LUMINOUS_EFFICACY * luminous / np.trapezoid(power, wavelength))


@cache
def _rgb_to_xyz() -> Array:
    """Columns are the XYZ of the primaries, scaled so that R = G = B = 1 is white with Y = 1."""

    def xyz(xy: Array) -> Array:
        return np.array([xy[0] / xy[1], 1.0, (1.0 - xy[0] - xy[1]) / xy[1]])

    columns = np.stack([xyz(primary) for primary in _PRIMARIES_XY], axis=1)
    return np.asarray(columns * np.linalg.solve(columns, xyz(_WHITE_XY)))


def linear_srgb_to_xyz(rgb: ArrayLike) -> Array:
    """XYZ of linear sRGB, (..., 3)."""
    return np.asarray(np.asarray(rgb, np.float64) @ _rgb_to_xyz().T)


def xyz_to_linear_srgb(xyz: ArrayLike) -> Array:
    """Linear sRGB of XYZ, (..., 3); negative where a colour lies outside the gamut."""
    return np.asarray(np.asarray(xyz, np.float64) @ np.linalg.inv(_rgb_to_xyz()).T)


def chromaticity(xyz: ArrayLike) -> Array:
    """Chromaticity x, y of XYZ, (..., 2)."""
    values = np.asarray(xyz, np.float64)
    return np.asarray(values[..., :2] / values.sum(axis=-1, keepdims=True))


def encode_srgb(linear: ArrayLike) -> Array:
    """sRGB transfer function: linear 0 .. 1 to encoded 0 .. 1; values are clipped to that range."""
    value = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def decode_srgb(encoded: ArrayLike) -> Array:
    """Inverse of `encode_srgb`."""
    value = np.clip(np.asarray(encoded, np.float64), 0.0, 1.0)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def into_gamut(rgb: ArrayLike) -> Array:
    """Linear sRGB with negative parts removed by adding white, at the same luminance.

    Colours of single wavelengths lie outside the gamut; mixed with white of their own luminance
    they keep their hue.
    """
    values = np.asarray(rgb, np.float64)
    luminance = (values @ np.array(RGB_LUMINANCE))[..., None]
    lowest = values.min(axis=-1, keepdims=True)
    # Mix with grey of the same luminance until the lowest part reaches 0
    span = luminance - lowest
    share = np.where((lowest < 0.0) & (span > 0.0), -lowest / np.where(span > 0.0, span, 1.0), 0.0)
    mixed = values + np.minimum(share, 1.0) * (luminance - values)
    return np.asarray(np.maximum(mixed, 0.0))


def channel_display_rgb(wavelengths_nm: ArrayLike, *, gamut: bool) -> Array:
    """Linear sRGB of one unit of each spectral channel, for pictures.

    The scale is common to all channels: equal parts of all of them have the mean luminance 1. With
    few channels, or channels that the eye does not see, the colours stay true but may be dark.

    Parameters
    ----------
    wavelengths_nm : (n,) [nm]
    gamut : bring each channel into the gamut of sRGB, to draw single wavelengths; False keeps
        negative parts, so that sums over channels are exact: mixed light is summed with these and
        brought into the gamut afterwards

    Returns
    -------
    rgb : (n, 3)
    """
    xyz = color_matching(wavelengths_nm)
    scale = float(np.mean(xyz[..., 1]))
    rgb = xyz_to_linear_srgb(xyz / scale) if scale > 0.0 else np.zeros_like(xyz)
    return into_gamut(rgb) if gamut else rgb
