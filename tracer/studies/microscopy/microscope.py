"""The polarising microscope in direction space: orthoscopic and conoscopic pictures.

The train: source, polariser, condenser, plate, objective, compensator, analyser, Bertrand lens,
screen. A perfect objective sends every direction (s_x, s_y) of light, numerical aperture and all,
to one point of its back focal plane, r = f s (Abbe's sine condition). The Bertrand lens shows that
plane: *conoscopy*. Without it, and with parallel light, the screen shows the plate itself:
*orthoscopy*. Here the coordinates of a conoscopic picture are the direction sines themselves;
`tracer.studies.microscopy.microscope_train` sends rays through real lenses instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracer.optics.polarization_elements import Retarder
from tracer.optics.polarization_rays import PolarizationError
from tracer.studies.interference_colors import Illuminant, transmission_to_xyz
from tracer.studies.microscopy.specimens import Specimen, retarder_jones

__all__ = ["Conoscopy", "Microscope", "conoscopy", "orthoscopy"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class Microscope:
    """Polars, compensator and light of a microscope.

    Attributes
    ----------
    polariser_deg, analyser_deg : angle of the transmitted vibration from x; analyser None: drawn
        out of the train
    extinction : share of the other vibration that either polar lets through
    numerical_aperture : of condenser and objective
    compensator : a retarder behind the objective, or None
    wavelength_nm : of monochromatic light, or None for white light
    illuminant, white_samples : of white light; wavelengths between 380 and 780 nm
    """

    polariser_deg: float = 0.0
    analyser_deg: float | None = 90.0
    extinction: float = 0.0
    numerical_aperture: float = 0.65
    compensator: Retarder | None = None
    wavelength_nm: float | None = None
    illuminant: Illuminant = "D65"
    white_samples: int = 81

    def __post_init__(self) -> None:
        if not self.numerical_aperture > 0.0:
            raise PolarizationError(
                f"numerical_aperture is {self.numerical_aperture:g}: it must be positive"
            )
        if not 0.0 <= self.extinction <= 1.0:
            raise PolarizationError(f"extinction is {self.extinction:g}: it lies in 0 .. 1")
        if self.wavelength_nm is not None and not self.wavelength_nm > 0.0:
            raise PolarizationError(f"wavelength_nm is {self.wavelength_nm:g}: it must be positive")
        if self.white_samples < 8:
            raise PolarizationError(
                f"white_samples is {self.white_samples}: white light needs 8 wavelengths or more"
            )

    @property
    def wavelengths_nm(self) -> Real:
        """Wavelengths of the light [nm]."""
        if self.wavelength_nm is not None:
            return np.array([self.wavelength_nm])
        return np.linspace(380.0, 780.0, self.white_samples)

    def transmitted(self, plate: Complex, wavelength_nm: float) -> Real:
        """(...) share of the flux of the source that reaches the screen through plates (..., 2, 2).

        The source is unpolarised and counts from behind the polariser.
        """
        first = _polar(self.polariser_deg, self.extinction)
        train = np.eye(2, dtype=np.complex128)
        if self.compensator is not None:
            slow = math.atan2(self.compensator.slow_axis[1], self.compensator.slow_axis[0])
            train = retarder_jones(self.compensator.retardance(wavelength_nm), slow)
        if self.analyser_deg is not None:
            train = _polar(self.analyser_deg, self.extinction) @ train
        whole = train @ plate @ first
        # Natural light: two orthogonal vibrations of half the flux, without interference
        power = np.sum(np.abs(whole) ** 2, axis=(-2, -1))
        return np.asarray(power / np.sum(np.abs(first) ** 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Conoscopy:
    """A picture of the back focal plane of the objective.

    Attributes
    ----------
    s : (n,) direction sines along both sides of the picture
    xyz : (n, n, 3) of white light, Y = 1 without plate between open polars; row i is s_y = s[i]
    transmission : (n, n) share of the flux, over all wavelengths
    inside : (n, n) bool, within the numerical aperture
    """

    s: Real
    xyz: Real
    transmission: Real
    inside: NDArray[np.bool_]


def conoscopy(specimen: Specimen, microscope: Microscope, *, pixels: int = 301) -> Conoscopy:
    """The conoscopic figure of a plate.

    Raises
    ------
    PolarizationError
        an aperture that light around the plate cannot have
    """
    aperture = microscope.numerical_aperture
    if aperture >= specimen.index_outside:
        raise PolarizationError(
            f"numerical_aperture is {aperture:g}, but light around the plate has at most "
            f"{specimen.index_outside:g}, its index outside"
        )
    s = np.linspace(-aperture, aperture, pixels)
    s_x, s_y = np.meshgrid(s, s)
    inside = s_x * s_x + s_y * s_y <= aperture * aperture
    wavelengths = microscope.wavelengths_nm
    shares = np.empty((int(inside.sum()), len(wavelengths)))
    for column, wavelength in enumerate(wavelengths):
        plate = specimen.jones(s_x[inside], s_y[inside], float(wavelength))
        shares[:, column] = microscope.transmitted(plate, float(wavelength))
    xyz = np.zeros((pixels, pixels, 3))
    xyz[inside] = _colors(microscope, wavelengths, shares)
    transmission = np.zeros((pixels, pixels))
    transmission[inside] = shares.mean(axis=1)
    return Conoscopy(s=s, xyz=xyz, transmission=transmission, inside=inside)


def orthoscopy(
    path_difference_nm: ArrayLike, slow_deg: ArrayLike, microscope: Microscope
) -> tuple[Real, Real]:
    """The picture of a plate in parallel light.

    Parameters
    ----------
    path_difference_nm, slow_deg : (...) of every point of the plate: a wedge, grains, a stage
        turned by an angle

    Returns
    -------
    xyz : (..., 3), Y = 1 without plate between open polars
    transmission : (...) share of the flux
    """
    difference, slow = np.broadcast_arrays(
        np.asarray(path_difference_nm, np.float64), np.asarray(slow_deg, np.float64)
    )
    wavelengths = microscope.wavelengths_nm
    shares = np.stack(
        [
            microscope.transmitted(
                retarder_jones(2.0 * np.pi * difference / wavelength, np.deg2rad(slow)),
                float(wavelength),
            )
            for wavelength in wavelengths
        ],
        axis=-1,
    )
    return _colors(microscope, wavelengths, shares), shares.mean(axis=-1)


def _colors(microscope: Microscope, wavelengths: Real, shares: Real) -> Real:
    """White light in colour; light of one wavelength as grey, so that dark stays dark."""
    if microscope.wavelength_nm is None:
        return transmission_to_xyz(wavelengths, shares, microscope.illuminant)
    grey = np.array([0.95047, 1.0, 1.08883])
    return np.asarray(shares[..., :1] * grey)


def _polar(degrees: float, extinction: float) -> Complex:
    """Jones matrix of a polar."""
    angle = math.radians(degrees)
    t = np.array([math.cos(angle), math.sin(angle)])
    passed = np.outer(t, t)
    return np.asarray(passed + math.sqrt(extinction) * (np.eye(2) - passed), np.complex128)
