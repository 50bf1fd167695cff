"""Polarisers, retarders and diaphragms: what they do to a field, and as planes in the way of rays.

The field functions take any number of rays. A sheet polariser absorbs the vibration that lies in
the plane of the ray and its absorption axis b (O-type), so it transmits t = d x b / |d x b|. A
retarder delays the vibration along its slow axis, as seen across the ray, by delta: under
exp(-i w t) it gains exp(+i delta).

References
----------
Born & Wolf, Principles of Optics, 7th ed., 15.4.2 (plates between polarisers, eqs 10 to 14).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.optics.frames import transverse_axes
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays

__all__ = [
    "Diaphragm",
    "Polarizer",
    "Retarder",
    "polarize",
    "retard",
    "to_plane",
]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Vector = tuple[float, float, float]


def polarize(
    field: ArrayLike, direction: ArrayLike, absorption_axis: ArrayLike, extinction: float = 0.0
) -> Complex:
    """Field behind a sheet polariser.

    Parameters
    ----------
    field, direction : (..., 3)
    absorption_axis : (3,) b
    extinction : share of the flux of the other vibration that leaks through

    Notes
    -----
    A ray along the absorption axis itself has no plane of absorption; all its light counts as the
    other vibration.
    """
    e, d = np.asarray(field, np.complex128), np.asarray(direction, np.float64)
    b = np.broadcast_to(_unit(absorption_axis, "absorption_axis"), d.shape)
    t = np.cross(d, b)
    length = np.linalg.norm(t, axis=-1, keepdims=True)
    t = t / np.where(length > 1e-12, length, np.inf)
    passed = np.sum(e * t, axis=-1, keepdims=True) * t
    return np.asarray(passed + np.sqrt(extinction) * (e - passed), np.complex128)


def retard(
    field: ArrayLike, direction: ArrayLike, slow_axis: ArrayLike, retardance: ArrayLike
) -> Complex:
    """Field behind a retarder: the component along the slow axis times exp(i retardance).

    Parameters
    ----------
    field, direction : (..., 3)
    slow_axis : (..., 3); its part across the ray counts
    retardance : (...) delta [rad] at the wavelength of each ray
    """
    e, d = np.asarray(field, np.complex128), np.asarray(direction, np.float64)
    x, _ = transverse_axes(d, np.broadcast_to(np.asarray(slow_axis, np.float64), d.shape))
    slow = np.sum(e * x, axis=-1, keepdims=True) * x
    turn = np.exp(1j * np.asarray(retardance, np.float64))[..., np.newaxis]
    result: Complex = e + (turn - 1.0) * slow
    return result


def to_plane(
    rays: PolarizedRays, center: ArrayLike, normal: ArrayLike, index: float = 1.0
) -> PolarizedRays:
    """Rays where they cross a plane ahead of them; the others are left out."""
    n = _unit(normal, "normal")
    approach = rays.direction @ n
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((np.asarray(center, np.float64) - rays.origin) @ n) / approach
    ahead = np.isfinite(distance) & (distance >= -1e-9)
    kept, way = rays.where(ahead), distance[ahead]
    return replace(
        kept,
        origin=kept.origin + way[:, np.newaxis] * kept.direction,
        optical_path=kept.optical_path + index * way,
    )


@dataclass(frozen=True, kw_only=True)
class Polarizer:
    """A sheet polariser, or analyser, in a plane.

    Attributes
    ----------
    absorption_axis : direction in the sheet of the vibration that it absorbs
    extinction : share of that vibration's flux that leaks through, 0 .. 1
    center, normal : of the plane
    """

    absorption_axis: Vector
    extinction: float = 0.0
    center: Vector = (0.0, 0.0, 0.0)
    normal: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        _unit(self.absorption_axis, "absorption_axis")
        _unit(self.normal, "normal")
        if not 0.0 <= self.extinction <= 1.0:
            raise PolarizationError(
                f"extinction is {self.extinction:g}: the share that leaks through lies in 0 .. 1"
            )

    @classmethod
    def at_angle(cls, degrees: float, *, extinction: float = 0.0, z: float = 0.0) -> Polarizer:
        """A polariser across the z axis that transmits vibrations at an angle from x."""
        angle = np.deg2rad(degrees)
        return cls(
            absorption_axis=(-float(np.sin(angle)), float(np.cos(angle)), 0.0),
            extinction=extinction,
            center=(0.0, 0.0, z),
        )

    def __call__(self, rays: PolarizedRays) -> PolarizedRays:
        """The light behind the sheet."""
        there = to_plane(rays, self.center, self.normal)
        return there.with_field(
            polarize(there.field, there.direction, self.absorption_axis, self.extinction)
        )


@dataclass(frozen=True, kw_only=True)
class Retarder:
    """A thin retarder or compensator in a plane.

    Attributes
    ----------
    slow_axis : direction of the slow vibration, in the plate
    path_difference_nm : optical path difference of both vibrations [nm], the same for all
        wavelengths, or a function of the wavelength [nm]
    center, normal : of the plane
    """

    slow_axis: Vector
    path_difference_nm: float | Callable[[Real], Real]
    center: Vector = (0.0, 0.0, 0.0)
    normal: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        _unit(self.slow_axis, "slow_axis")
        _unit(self.normal, "normal")

    @classmethod
    def at_angle(
        cls, degrees: float, path_difference_nm: float | Callable[[Real], Real], *, z: float = 0.0
    ) -> Retarder:
        """A retarder across the z axis whose slow axis stands at an angle from x."""
        angle = np.deg2rad(degrees)
        return cls(
            slow_axis=(float(np.cos(angle)), float(np.sin(angle)), 0.0),
            path_difference_nm=path_difference_nm,
            center=(0.0, 0.0, z),
        )

    def retardance(self, wavelength_nm: ArrayLike) -> Real:
        """Phase difference [rad] at wavelengths [nm]."""
        wavelength = np.asarray(wavelength_nm, np.float64)
        difference = self.path_difference_nm
        nm = (
            difference(wavelength) if callable(difference) else np.full_like(wavelength, difference)
        )
        return 2.0 * np.pi * nm / wavelength

    def __call__(self, rays: PolarizedRays) -> PolarizedRays:
        """The light behind the plate."""
        there = to_plane(rays, self.center, self.normal)
        return there.with_field(
            retard(there.field, there.direction, self.slow_axis, self.retardance(there.wavelengths))
        )


@dataclass(frozen=True, kw_only=True)
class Diaphragm:
    """An opaque plane with a round hole; rays outside the hole end there."""

    radius: float
    center: Vector = (0.0, 0.0, 0.0)
    normal: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        _unit(self.normal, "normal")
        if not self.radius > 0.0:
            raise PolarizationError(f"radius is {self.radius:g}: a hole has a positive radius")

    def __call__(self, rays: PolarizedRays) -> PolarizedRays:
        """The light that passes the hole."""
        there = to_plane(rays, self.center, self.normal)
        away = np.linalg.norm(there.origin - np.asarray(self.center), axis=1)
        return there.where(away <= self.radius)


def _unit(vector: ArrayLike, name: str) -> Real:
    v = np.asarray(vector, np.float64)
    length = float(np.linalg.norm(v)) if v.shape == (3,) else float("nan")
    if not (np.isfinite(length) and length > 0.0):
        raise PolarizationError(
            f"{name} is {vector!r}: expected three numbers that are not all zero"
        )
    result: Real = v / length
    return result
