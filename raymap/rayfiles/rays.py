"""Rays as plain arrays with units, and the checks that every ray file must pass."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.errors import RayMapError
from raymap.units import length_scale

__all__ = ["FluxUnit", "RayFileError", "RaySet", "Spectrum", "checked"]

FluxUnit = Literal["W", "lm"]
Floats = NDArray[np.float32]

_UNIT_TOLERANCE = 1e-3
_ROUNDING = 1e-6


class RayFileError(RayMapError, ValueError):
    """A ray file cannot be read or written as it stands."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """A spectrum that rays share.

    Attributes
    ----------
    wavelength_nm : (n,) float32, positive
    power : (n,) float32, relative, not negative
    """

    wavelength_nm: Floats
    power: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RaySet:
    """Rays of a ray file: where they start, which way they go, what they carry.

    Attributes
    ----------
    position : (n, 3) float32 [length_unit]
    direction : (n, 3) float32, unit vectors
    flux : (n,) float32 [flux_unit]
    length_unit : "mm", "cm", "m", "um", "in" or "ft"
    flux_unit : "W" or "lm"
    wavelength_nm : (n,) float32 vacuum wavelength of each ray [nm], or None
    luminous_flux : (n,) float32 [lm] where the file states it beside the radiant flux, or None
    tristimulus : (n, 3) float32 X, Y, Z of each ray, Y being its luminous flux [lm], or None
    spectra : spectra that the rays share
    spectrum : (n,) int32 index into ``spectra``, or None where there is one spectrum for all
    title : name of the light source
    description : further texts of the file by name
    """

    position: Floats
    direction: Floats
    flux: Floats
    length_unit: str = "mm"
    flux_unit: FluxUnit = "W"
    wavelength_nm: Floats | None = None
    luminous_flux: Floats | None = None
    tristimulus: Floats | None = None
    spectra: tuple[Spectrum, ...] = ()
    spectrum: NDArray[np.int32] | None = None
    title: str = ""
    description: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.flux)

    @property
    def total_flux(self) -> float:
        """Sum over all rays [flux_unit]."""
        return float(self.flux.sum(dtype=np.float64))

    def describe(self) -> dict[str, Any]:
        """What the set holds, in plain values."""
        low, high = (
            (self.position.min(axis=0).tolist(), self.position.max(axis=0).tolist())
            if len(self)
            else ([], [])
        )
        mean = (self.direction * self.flux[:, None]).sum(axis=0, dtype=np.float64)
        length = float(np.linalg.norm(mean))
        span = None
        if self.wavelength_nm is not None and len(self):
            span = [float(self.wavelength_nm.min()), float(self.wavelength_nm.max())]
        return {
            "rays": len(self),
            "flux": self.total_flux,
            "flux_unit": self.flux_unit,
            "length_unit": self.length_unit,
            "box": [low, high],
            "mean_direction": (mean / length).tolist() if length > 0 else None,
            "wavelength_nm": span,
            "spectra": len(self.spectra),
            "tristimulus": self.tristimulus is not None,
            "title": self.title,
            "description": {key: text for key, text in self.description.items() if text},
        }

    def in_unit(self, length_unit: str) -> RaySet:
        """The same rays with positions in another unit of length.

        Raises
        ------
        RayFileError
            The unit is not known.
        """
        if length_unit == self.length_unit:
            return self
        try:
            factor = length_scale(self.length_unit, length_unit)
        except RayMapError as error:
            raise RayFileError(str(error)) from None
        scaled = (self.position.astype(np.float64) * factor).astype(np.float32)
        return dataclasses.replace(self, position=scaled, length_unit=length_unit)


def checked(rays: RaySet, name: str) -> RaySet:
    """The rays with directions of length 1 to rounding, refused where they cannot be light.

    Parameters
    ----------
    rays : as read
    name : of the file, for messages

    Raises
    ------
    RayFileError
        A column has values that are not finite, directions are no unit vectors, a flux or a
        wavelength is negative; the message says how many rays and names the first.
    """
    columns: dict[str, NDArray[Any] | None] = {
        "position": rays.position,
        "direction": rays.direction,
        "flux": rays.flux,
        "wavelength": rays.wavelength_nm,
        "luminous flux": rays.luminous_flux,
        "tristimulus value": rays.tristimulus,
    }
    for what, column in columns.items():
        if column is not None:
            finite = np.isfinite(column)
            _refuse(~(finite.all(axis=1) if column.ndim == 2 else finite), name, f"no {what}")
    length = np.sqrt(np.einsum("ij,ij->i", rays.direction, rays.direction, dtype=np.float64))
    off = np.abs(length - 1.0)
    bad = off > _UNIT_TOLERANCE
    if bad.any():
        first = int(np.argmax(bad))
        _refuse(bad, name, f"a direction of length {length[first]:.4g}, not 1")
    _refuse(rays.flux < 0, name, "a negative flux")
    if rays.luminous_flux is not None:
        _refuse(rays.luminous_flux < 0, name, "a negative luminous flux")
    if rays.wavelength_nm is not None:
        _refuse(rays.wavelength_nm <= 0, name, "a wavelength that is not positive")
    if len(off) and float(off.max()) > _ROUNDING:
        unit = (rays.direction / length[:, None]).astype(np.float32)
        return dataclasses.replace(rays, direction=unit)
    return rays


def _refuse(bad: NDArray[np.bool_], name: str, what: str) -> None:
    if not bad.any():
        return
    first = int(np.argmax(bad))
    count = int(bad.sum())
    raise RayFileError(
        f"{name}: ray {first + 1} of {len(bad)} has {what}"
        + (f" ({count} rays have)" if count > 1 else "")
        + "; the file is damaged or its header describes other columns"
    )
