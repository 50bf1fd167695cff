"""Spectra of sources in the scene description, and flux in watt or lumen."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.model.errors import SceneError
from raymap.optics.colorimetry import RGB_LUMINANCE
from raymap.optics.photometry import RGB_EFFICACY
from tracer.description.fields import Node, Positive, Share
from tracer.optics import spectrum
from tracer.optics.spectrum import SourceSpectrum

__all__ = ["Led", "Lines", "SpectrumModel", "WhiteLed", "convert_flux", "source_shares"]

FluxUnit = Literal["W", "lm"]


class Led(Node):
    """A coloured LED: Gaussian, full width at half height [nm]."""

    peak_nm: Positive
    width_nm: Positive = 25.0


class WhiteLed(Node):
    """A white LED: blue light and what its phosphor makes of it, both Gaussian [nm]."""

    blue_nm: Positive = 450.0
    blue_width_nm: Positive = 20.0
    phosphor_nm: Positive = 560.0
    phosphor_width_nm: Positive = 120.0
    blue_share: Share = 0.25


class Lines(Node):
    """Spectral lines and their relative powers."""

    wavelength_nm: Annotated[tuple[Positive, ...], Field(min_length=1)]
    power: Annotated[tuple[float, ...], Field(min_length=1)]


class SpectrumModel(Node):
    """The spectrum of a source: exactly one of its keys.

    illuminant : a CIE illuminant by name ("D65", "A", "E", "FL11", "LED-B3", …)
    blackbody : temperature [K]
    led, white_led, lines : see there
    color : linear sRGB that the light looks like
    """

    illuminant: str | None = None
    blackbody: Positive | None = None
    led: Led | None = None
    white_led: WhiteLed | None = None
    lines: Lines | None = None
    color: tuple[Share, Share, Share] | None = None

    def model_post_init(self, context: Any) -> None:
        given = [key for key in type(self).model_fields if getattr(self, key) is not None]
        if len(given) != 1:
            keys = ", ".join(type(self).model_fields)
            raise ValueError(f"a spectrum takes exactly one of {keys}; given: {len(given)}")

    def build(self) -> SourceSpectrum:
        """The spectrum itself.

        Raises
        ------
        SceneError
            for names and numbers that make no spectrum
        """
        if self.illuminant is not None:
            return spectrum.illuminant(self.illuminant)
        if self.blackbody is not None:
            return spectrum.blackbody(self.blackbody)
        if self.led is not None:
            return spectrum.led(self.led.peak_nm, self.led.width_nm)
        if self.white_led is not None:
            return spectrum.phosphor_led(**self.white_led.model_dump())
        if self.lines is not None:
            return spectrum.lines(self.lines.wavelength_nm, self.lines.power)
        return spectrum.rgb_spectrum(self.color or (1.0, 1.0, 1.0))


def source_shares(
    light: SourceSpectrum, wavelengths_nm: NDArray[np.float64], *, rgb: bool
) -> NDArray[np.float64]:
    """Shares of a source's light in the channels of a trace, summing to 1.

    In an RGB trace they are its colour, in a spectral one shares of power.
    """
    return light.rgb_shares() if rgb else light.channel_shares(wavelengths_nm)


def convert_flux(
    flux: float,
    given: FluxUnit,
    wanted: FluxUnit,
    light: SourceSpectrum | None,
    *,
    wavelengths_nm: NDArray[np.float64] | None = None,
    name: str = "",
) -> float:
    """Flux of a source in the unit of the map.

    Parameters
    ----------
    flux, given : the flux and its unit
    wanted : unit of the map
    light : spectrum of the source, None if it has none
    wavelengths_nm : channels of a spectral trace, so that the light carries the lumens given even
        where its channels are few; None for an RGB trace, whose watts are lumens by 179 lm/W of
        white (`raymap.optics.photometry`)
    name : of the source, for messages

    Raises
    ------
    SceneError
        if the units differ and the source has no spectrum, or none that the eye sees
    """
    if given == wanted:
        return flux
    if light is None:
        raise SceneError(
            f"source {name!r}: flux in {given} cannot become {wanted} without a spectrum; give the "
            f"source a spectrum, or its flux in {wanted}"
        )
    efficacy = light.luminous_efficacy
    if wavelengths_nm is not None:
        efficacy = light.channel_efficacy(wavelengths_nm)
    if given == "W":
        return flux * efficacy
    if efficacy < 1e-6:
        raise SceneError(
            f"source {name!r}: the eye sees none of its spectrum {light.name!r}; give its flux in W"
        )
    if wavelengths_nm is None:
        # The map makes lumens of watts by one constant: let it show the lumens that were given
        efficacy = float(3.0 * RGB_EFFICACY * light.rgb_shares() @ np.array(RGB_LUMINANCE))
    return flux / efficacy
