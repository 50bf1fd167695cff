"""Spectra of sources: where they come from, and their shares in the channels of a trace.

A spectrum is relative: its scale is set by the flux of the source. A continuous part stands as
power per nm between sampled wavelengths, lines stand beside it with their power. Each channel of a
spectral trace represents the band up to half-way to its neighbours.
"""

from __future__ import annotations

import csv
import difflib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.optics import colorimetry
from tracer.optics.dispersion import OutOfRangeWarning

__all__ = [
    "SourceSpectrum",
    "blackbody",
    "channel_bands",
    "equal_energy",
    "illuminant",
    "illuminant_names",
    "led",
    "lines",
    "phosphor_led",
    "rgb_spectrum",
    "tabulated_spectrum",
]

Array = NDArray[np.float64]

VISIBLE_NM = (360.0, 830.0)
"""Range over which spectra without an end of their own are taken [nm]."""

LARGEST_STEP_NM = 25.0
"""Wider steps in the table of a spectrum are gaps."""

_C2_NM_K = 1.438776877e7  # second radiation constant h c / k [nm K]
_RGB_WIDTH_NM = 18.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SourceSpectrum:
    """Relative power of a source over wavelength.

    Attributes
    ----------
    name : for messages
    wavelength_nm, power_per_nm : (n,) rising wavelengths [nm] and power between them, linear
    line_nm, line_power : (m,) spectral lines beside it
    open_ended : the range is a convention, not the source's: what lies outside the channels of a
        trace is left out without a warning
    """

    name: str
    wavelength_nm: Array = field(default_factory=lambda: np.zeros(0))
    power_per_nm: Array = field(default_factory=lambda: np.zeros(0))
    line_nm: Array = field(default_factory=lambda: np.zeros(0))
    line_power: Array = field(default_factory=lambda: np.zeros(0))
    open_ended: bool = False

    @property
    def power(self) -> float:
        """All of the power, in the unit of the spectrum."""
        return float(np.trapezoid(self.power_per_nm, self.wavelength_nm) + self.line_power.sum())

    @property
    def xyz(self) -> Array:
        """XYZ of one unit of power."""
        fine, values = self._fine()
        total = colorimetry.spectrum_to_xyz(fine, values) if fine.size else np.zeros(3)
        total = total + self.line_power @ colorimetry.color_matching(self.line_nm)
        return np.asarray(total / self.power)

    @property
    def luminous_efficacy(self) -> float:
        """Lumen per watt of radiation [lm/W]."""
        return colorimetry.LUMINOUS_EFFICACY * float(self.xyz[1])

    def radiant_from_luminous(self, lumen: float) -> float:
        """Watt of a flux in lumen.

        Raises
        ------
        SceneError
            if the eye sees none of the spectrum
        """
        efficacy = self.luminous_efficacy
        if efficacy < 1e-6:
            raise SceneError(
                f"spectrum {self.name!r} is invisible: its flux cannot be given in lumen; give it "
                "in watt"
            )
        return lumen / efficacy

    def luminous_from_radiant(self, watt: float) -> float:
        """Lumen of a flux in watt."""
        return watt * self.luminous_efficacy

    def channel_shares(self, channels_nm: ArrayLike) -> Array:
        """Share of the power in each channel's band, summing to 1.

        Parameters
        ----------
        channels_nm : (n,) rising wavelengths of the channels [nm]

        Returns
        -------
        shares : (n,); power outside all bands is left out with a warning if it exceeds 1 %

        Raises
        ------
        SceneError
            if no power falls into the bands
        """
        edges = channel_bands(channels_nm)
        inside = np.array([self._between(a, b) for a, b in pairwise(edges)])
        total = float(inside.sum())
        span = f"{edges[0]:g} to {edges[-1]:g} nm"
        if total <= 0.0:
            raise SceneError(
                f"spectrum {self.name!r} has no power in the channels of the trace ({span}); "
                "choose wavelengths where it shines"
            )
        lost = 1.0 - total / self.power
        if lost > 0.01 and not self.open_ended:
            warnings.warn(
                f"spectrum {self.name!r}: {100 * lost:.1f} % of its power lies outside the "
                f"channels of the trace ({span}) and is shared out to them",
                OutOfRangeWarning,
                stacklevel=2,
            )
        return inside / total

    def channel_efficacy(self, channels_nm: ArrayLike) -> float:
        """Lumen per watt of the light as its channels carry it: 683 Σ share V [lm/W]."""
        shares = self.channel_shares(channels_nm)
        return float(shares @ np.atleast_1d(colorimetry.luminous_efficacy(channels_nm)))

    def rgb_shares(self) -> Array:
        """Colour of the source in an RGB trace: linear sRGB inside the gamut, summing to 1."""
        rgb = colorimetry.into_gamut(colorimetry.xyz_to_linear_srgb(self.xyz))
        total = float(rgb.sum())
        if total <= 0.0:
            raise SceneError(
                f"spectrum {self.name!r} is invisible: an RGB trace cannot carry it; trace "
                "wavelengths instead"
            )
        return np.asarray(rgb / total)

    def _fine(self) -> tuple[Array, Array]:
        """The continuous part on its own nodes and every whole nm between."""
        if not self.wavelength_nm.size:
            return self.wavelength_nm, self.power_per_nm
        low, high = self.wavelength_nm[0], self.wavelength_nm[-1]
        whole = np.arange(np.ceil(low), high)
        fine = np.unique(np.concatenate((self.wavelength_nm, whole)))
        return fine, np.interp(fine, self.wavelength_nm, self.power_per_nm)

    def _between(self, low: float, high: float) -> float:
        """Power between two wavelengths, the upper one excluded for lines."""
        total = float(self.line_power[(self.line_nm >= low) & (self.line_nm < high)].sum())
        if not self.wavelength_nm.size:
            return total
        a, b = max(low, self.wavelength_nm[0]), min(high, self.wavelength_nm[-1])
        if a >= b:
            return total
        inner = self.wavelength_nm[(self.wavelength_nm > a) & (self.wavelength_nm < b)]
        nodes = np.concatenate(([a], inner, [b]))
        values = np.interp(nodes, self.wavelength_nm, self.power_per_nm)
        return total + float(np.trapezoid(values, nodes))


def channel_bands(channels_nm: ArrayLike) -> Array:
    """Edges of the bands of channels [nm]: half-way between neighbours, as far beyond the ends.

    A single channel takes everything.
    """
    channels = np.atleast_1d(np.asarray(channels_nm, np.float64))
    if not (np.all(np.isfinite(channels)) and np.all(channels > 0.0)):
        raise SceneError("wavelengths of a trace must be positive numbers [nm]")
    if np.any(np.diff(channels) <= 0.0):
        raise SceneError("wavelengths of a trace must rise")
    if channels.size == 1:
        return np.array([0.0, np.inf])
    middles = 0.5 * (channels[1:] + channels[:-1])
    first = 1.5 * channels[0] - 0.5 * channels[1]
    last = 1.5 * channels[-1] - 0.5 * channels[-2]
    return np.concatenate(([max(0.0, first)], middles, [last]))


def tabulated_spectrum(
    wavelength_nm: ArrayLike,
    power: ArrayLike,
    *,
    name: str = "table",
    largest_step_nm: float = LARGEST_STEP_NM,
) -> SourceSpectrum:
    """A measured spectrum: relative power per nm, linear between its wavelengths, 0 outside.

    Raises
    ------
    SceneError
        for values that are missing, negative or all zero, and for gaps wider than
        ``largest_step_nm``
    """
    wavelength, values = np.asarray(wavelength_nm, np.float64), np.asarray(power, np.float64)
    if wavelength.ndim != 1 or wavelength.size < 2 or wavelength.shape != values.shape:
        raise SceneError(f"spectrum {name!r}: needs two or more wavelengths and as many values")
    missing = ~(np.isfinite(wavelength) & np.isfinite(values))
    if np.any(missing):
        raise SceneError(f"spectrum {name!r} has a gap: row {int(np.argmax(missing)) + 1} is empty")
    order = np.argsort(wavelength, kind="stable")
    wavelength, values = wavelength[order], values[order]
    step = np.diff(wavelength)
    if np.any(step <= 0.0):
        raise SceneError(f"spectrum {name!r}: {wavelength[int(np.argmin(step))]:g} nm stands twice")
    if step.max() > largest_step_nm:
        at = int(np.argmax(step))
        raise SceneError(
            f"spectrum {name!r} has a gap from {wavelength[at]:g} to {wavelength[at + 1]:g} nm; "
            f"steps must not exceed {largest_step_nm:g} nm: fill it in, or describe lines as lines"
        )
    if np.any(values < 0.0) or not np.any(values > 0.0):
        raise SceneError(f"spectrum {name!r}: power must not be negative, and not 0 everywhere")
    return SourceSpectrum(name=name, wavelength_nm=wavelength, power_per_nm=values)


def lines(wavelength_nm: Sequence[float], power: Sequence[float]) -> SourceSpectrum:
    """Spectral lines with their relative powers."""
    wavelength, values = np.asarray(wavelength_nm, np.float64), np.asarray(power, np.float64)
    if wavelength.ndim != 1 or wavelength.size == 0 or wavelength.shape != values.shape:
        raise SceneError("spectrum of lines: needs as many powers as wavelengths")
    if not (np.all(wavelength > 0.0) and np.all(values >= 0.0) and np.any(values > 0.0)):
        raise SceneError("spectrum of lines: wavelengths and powers must be positive")
    return SourceSpectrum(name="lines", line_nm=wavelength, line_power=values)


def blackbody(temperature: float, *, range_nm: tuple[float, float] = VISIBLE_NM) -> SourceSpectrum:
    """Planck's radiation of a temperature [K] within ``range_nm``, 1 at its highest there."""
    if not (np.isfinite(temperature) and 100.0 <= temperature <= 1e6):
        raise SceneError(f"blackbody: the temperature must lie in 100 .. 1e6 K, got {temperature}")
    wavelength = np.arange(range_nm[0], range_nm[1] + 0.5, 1.0)
    exponent = _C2_NM_K / (wavelength * temperature)
    # exp(-x) / (1 - exp(-x)) does not overflow where 1 / (exp(x) - 1) would
    logarithm = -5.0 * np.log(wavelength) - exponent - np.log(-np.expm1(-exponent))
    return SourceSpectrum(
        name=f"blackbody {temperature:g} K",
        wavelength_nm=wavelength,
        power_per_nm=np.exp(logarithm - logarithm.max()),
        open_ended=True,
    )


def equal_energy(*, range_nm: tuple[float, float] = VISIBLE_NM) -> SourceSpectrum:
    """The same power per nm everywhere in a range."""
    return SourceSpectrum(
        name="E",
        wavelength_nm=np.array(range_nm, np.float64),
        power_per_nm=np.ones(2),
        open_ended=True,
    )


def led(peak_nm: float, width_nm: float) -> SourceSpectrum:
    """A coloured LED: a Gaussian of full width ``width_nm`` at half its height."""
    return _gaussians(f"LED {peak_nm:g} nm", [(1.0, peak_nm, width_nm)])


def phosphor_led(
    *,
    blue_nm: float = 450.0,
    blue_width_nm: float = 20.0,
    phosphor_nm: float = 560.0,
    phosphor_width_nm: float = 120.0,
    blue_share: float = 0.25,
) -> SourceSpectrum:
    """A white LED: blue light and what a phosphor makes of it, both Gaussian.

    ``blue_share`` is the share of the power that stays blue: more of it is a colder white.
    """
    if not 0.0 <= blue_share <= 1.0:
        raise SceneError(f"white LED: the blue share must lie between 0 and 1, got {blue_share:g}")
    bands = [(blue_share, blue_nm, blue_width_nm), (1 - blue_share, phosphor_nm, phosphor_width_nm)]
    return _gaussians("white LED", bands)


def _gaussians(name: str, bands: Sequence[tuple[float, float, float]]) -> SourceSpectrum:
    """Sum of bands (power, peak [nm], full width at half height [nm])."""
    for _, peak, width in bands:
        if not (np.isfinite(peak) and peak > 0.0 and np.isfinite(width) and width > 0.0):
            raise SceneError(f"spectrum {name!r}: peak and width must be positive [nm]")
    grids = [peak + width * np.linspace(-2.0, 2.0, 161) for _, peak, width in bands]
    wavelength = np.unique(np.concatenate(grids))
    wavelength = wavelength[wavelength > 0.0]
    values = np.zeros_like(wavelength)
    for power, peak, width in bands:
        sigma = width / (2.0 * np.sqrt(2.0 * np.log(2.0)))
        height = power / (sigma * np.sqrt(2.0 * np.pi))
        values += height * np.exp(-0.5 * ((wavelength - peak) / sigma) ** 2)
    return SourceSpectrum(name=name, wavelength_nm=wavelength, power_per_nm=values)


def rgb_spectrum(rgb: ArrayLike) -> SourceSpectrum:
    """A spectrum that looks like a colour of linear sRGB: three narrow bands mixed to match it.

    Saturated colours at the rim of the gamut are matched as closely as powers >= 0 allow.
    """
    color = np.asarray(rgb, np.float64)
    if color.shape != (3,) or not (np.all(color >= 0.0) and np.any(color > 0.0)):
        raise SceneError("an RGB colour needs three numbers >= 0, not all 0")
    bands = [
        _gaussians("", [(1.0, peak, _RGB_WIDTH_NM)]) for peak in colorimetry.RGB_WAVELENGTHS_NM
    ]
    matrix = np.stack([colorimetry.xyz_to_linear_srgb(band.xyz) for band in bands], axis=1)
    powers = np.maximum(0.0, np.linalg.solve(matrix, color))
    return _gaussians(
        "RGB colour",
        [
            (float(power), peak, _RGB_WIDTH_NM)
            for power, peak in zip(powers, colorimetry.RGB_WAVELENGTHS_NM, strict=True)
        ],
    )


@cache
def _illuminants() -> dict[str, tuple[Array, Array]]:
    text = resources.files("tracer.optics").joinpath("illuminants.csv").read_text(encoding="utf-8")
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))
    table = np.array([[float(cell or "nan") for cell in row] for row in rows[1:]])
    found = {}
    for k, name in enumerate(rows[0][1:], start=1):
        known = np.isfinite(table[:, k])
        found[name] = table[known, 0], table[known, k]
    return found


def illuminant_names() -> list[str]:
    """Names that `illuminant` knows."""
    return ["A", "E", *_illuminants()]


def illuminant(name: str) -> SourceSpectrum:
    """A CIE illuminant: A, D50, D55, D65, D75, E, fluorescent lamps FL…, HP1, LED-…

    All of them over 360 to 830 nm, so that their lumens per watt compare: of lamps, whose tables go
    from 380 to 780 nm, nothing is known outside, and nothing is assumed.

    Raises
    ------
    SceneError
        for an unknown name, with the nearest ones
    """
    wanted = name.strip().upper()
    if wanted == "E":
        return equal_energy()
    if wanted == "A":
        wavelength = np.arange(VISIBLE_NM[0], VISIBLE_NM[1] + 0.5)
        values = colorimetry.illuminant_a(wavelength)
        return SourceSpectrum(
            name="A", wavelength_nm=wavelength, power_per_nm=values, open_ended=True
        )
    known = _illuminants()
    if wanted not in known:
        near = difflib.get_close_matches(wanted, illuminant_names(), n=3, cutoff=0.3)
        raise SceneError(
            f"there is no illuminant {name!r}"
            + (f"; the nearest names are {', '.join(near)}" if near else "")
        )
    return replace(tabulated_spectrum(*known[wanted], name=wanted), open_ended=True)
