"""Rays as plain arrays with units, and the checks that every ray file must pass."""

from __future__ import annotations

import dataclasses
import math
import warnings
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import RayMapError
from raymap.model.units import length_scale

__all__ = ["FluxFrom", "FluxUnit", "RayFileError", "RaySet", "Spectrum", "checked", "with_flux_of"]

FluxUnit = Literal["W", "lm"]
FluxFrom = Literal["header", "rays"]
Floats = NDArray[np.float32]

_UNIT_TOLERANCE = 1e-3
_FLUX_TOLERANCE = 0.01
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


_WAVELENGTHS_NM = (10.0, 1e5)
"""What counts as light: numbers in a wrong unit lie outside."""


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
        length_nm = rays.wavelength_nm
        strange = (length_nm < _WAVELENGTHS_NM[0]) | (length_nm > _WAVELENGTHS_NM[1])
        if strange.any():
            nm = float(length_nm[int(np.argmax(strange))])
            why = f"a wavelength of {nm:g} nm, which is no light: its unit is another one"
            _refuse(strange, name, why)
    if len(off) and float(off.max()) > _ROUNDING:
        unit = (rays.direction / length[:, None]).astype(np.float32)
        return dataclasses.replace(rays, direction=unit)
    return rays


def with_flux_of(rays: RaySet, flux_from: FluxFrom, name: str, *,
                 stated: float, stated_luminous: float = 0.0) -> RaySet:  # fmt: skip
    """The rays with the flux that the header states, where it states one, or as they are.

    Programs write the powers of rays relative to one another, LightTools and others 1 each: then
    the header alone knows the flux. A warning names both where they differ by more than 1 %.

    Parameters
    ----------
    rays : as they stand in the file
    flux_from : "header" or "rays"
    name : of the file, for messages
    stated : flux of the header [flux_unit]; nan, 0 or less where it states none
    stated_luminous : the same of the luminous flux beside a radiant one [lm]
    """
    factor = _factor(stated, rays.flux)
    luminous = 1.0
    if rays.luminous_flux is not None:
        luminous = _factor(stated_luminous, rays.luminous_flux, otherwise=factor)
        factor = _factor(stated, rays.flux, otherwise=luminous)
    if factor == 1.0 and luminous == 1.0:
        return rays
    total = rays.total_flux
    word = "header" if flux_from == "header" else "rays"
    other = "" if flux_from == "rays" else '; flux_from = "rays" takes the other'
    if factor != 1.0:
        said = f"{total * factor:.6g} {rays.flux_unit}, its rays carry {total:.6g} {rays.flux_unit}"
    else:
        assert rays.luminous_flux is not None
        beside = float(rays.luminous_flux.sum(dtype=np.float64))
        said = f"{stated_luminous:.6g} lm, its rays carry {beside:.6g} lm"
    verb = "counts" if word == "header" else "count"
    warnings.warn(f"{name}: its header states {said}; the {word} {verb}{other}", stacklevel=4)
    if flux_from == "rays":
        return rays
    if rays.luminous_flux is None:
        luminous = factor
    return dataclasses.replace(
        rays,
        flux=_times(rays.flux, factor),
        luminous_flux=None if rays.luminous_flux is None else _times(rays.luminous_flux, luminous),
        tristimulus=None if rays.tristimulus is None else _times(rays.tristimulus, luminous),
    )


def _factor(stated: float, flux: Floats, otherwise: float = 1.0) -> float:
    """What fluxes are multiplied by to make what is stated, 1 where they do to rounding."""
    total = float(flux.sum(dtype=np.float64))
    if not (math.isfinite(stated) and stated > 0.0 and total > 0.0):
        return otherwise
    far = abs(stated - total) > _FLUX_TOLERANCE * max(stated, total)
    return stated / total if far else 1.0


def _times(column: Floats, factor: float) -> Floats:
    return (column.astype(np.float64) * factor).astype(np.float32)


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
