"""Plates under the polarising microscope, as Jones matrices over the directions of light.

Directions are named by their tangential refraction vector (s_x, s_y) = n sin(theta) (cos(phi),
sin(phi)), n the medium outside. Matrices act on E_x, E_y of the pupil: the components that a lens
which makes all rays parallel to z would show.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracer.optics.crystals.media import Crystal
from tracer.optics.crystals.plates import plate_jones
from tracer.optics.polarization_rays import PolarizationError

__all__ = ["CrystalPlate", "RetarderPlate", "Specimen"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


class Specimen(Protocol):
    """Anything that turns the light of a direction into other light of the same direction."""

    @property
    def index_outside(self) -> float:
        """Refractive index of the medium around the plate."""

    def jones(self, s_x: ArrayLike, s_y: ArrayLike, wavelength_nm: float) -> Complex:
        """(..., 2, 2) Jones matrices in pupil axes x, y."""


@dataclass(frozen=True, kw_only=True)
class CrystalPlate:
    """A plane-parallel plate of any crystal, its normal along z.

    Attributes
    ----------
    crystal : with its orientation in the world
    thickness_mm : of the plate
    index_outside : of the medium on both sides
    levels : passes through the plate that are summed; 1 leaves out the light reflected inside,
        None sums all of it (in white light its fringes need a fine spectrum)
    """

    crystal: Crystal
    thickness_mm: float
    index_outside: float = 1.0
    levels: int | None = 1

    def jones(self, s_x: ArrayLike, s_y: ArrayLike, wavelength_nm: float) -> Complex:
        """(..., 2, 2) Jones matrices in pupil axes x, y, Fresnel losses included."""
        transmission, _ = plate_jones(
            self.crystal, s_x, s_y, self.thickness_mm, wavelength_nm,
            n_before=self.index_outside, n_after=self.index_outside,
            basis="pupil", levels=self.levels,
        )  # fmt: skip
        return np.asarray(transmission, np.complex128)


@dataclass(frozen=True, kw_only=True)
class RetarderPlate:
    """A thin plate without losses: a path difference, the same for all directions or by direction.

    Attributes
    ----------
    path_difference_nm : a number, or a function of (s_x, s_y, wavelength_nm)
    slow_deg : angle of the slow vibration from x, a number, or a function of (s_x, s_y)
    index_outside : of the medium around
    """

    path_difference_nm: float | Callable[[Real, Real, float], Real]
    slow_deg: float | Callable[[Real, Real], Real] = 45.0
    index_outside: float = 1.0

    def jones(self, s_x: ArrayLike, s_y: ArrayLike, wavelength_nm: float) -> Complex:
        """(..., 2, 2) Jones matrices in pupil axes x, y."""
        x, y = np.broadcast_arrays(np.asarray(s_x, np.float64), np.asarray(s_y, np.float64))
        if not wavelength_nm > 0.0:
            raise PolarizationError(f"wavelength_nm is {wavelength_nm:g}: it must be positive")
        difference, slow = self.path_difference_nm, self.slow_deg
        nm = difference(x, y, wavelength_nm) if callable(difference) else difference
        degrees = slow(x, y) if callable(slow) else slow
        return retarder_jones(
            np.broadcast_to(2.0 * np.pi * np.asarray(nm) / wavelength_nm, x.shape),
            np.broadcast_to(np.deg2rad(degrees), x.shape),
        )


def retarder_jones(retardance: ArrayLike, slow: ArrayLike) -> Complex:
    """(..., 2, 2) of a retarder [rad] whose slow vibration stands at an angle from x [rad]."""
    turn = np.exp(1j * np.asarray(retardance, np.float64)) - 1.0
    angle = np.asarray(slow, np.float64)
    axis = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    matrix = turn[..., np.newaxis, np.newaxis] * axis[..., :, np.newaxis] * axis[..., np.newaxis, :]
    return np.asarray(np.eye(2) + matrix, np.complex128)
