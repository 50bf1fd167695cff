"""Measured plates of one material: fluxes R, T and scattering distributions, checked row by row."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MeasurementError

__all__ = ["FluxTable", "MaterialMeasurement", "MeasurementError", "ScatterTable", "check_flux"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FluxTable:
    """Integral reflection and transmission, one row per plate, wavelength and angle.

    Attributes
    ----------
    thickness_mm, wavelength_nm, incidence_deg : (n,)
    reflectance, transmittance : (n,) shares of the incident flux; nan where not measured
    reflectance_error, transmittance_error : (n,) relative standard errors
    places : where each row comes from, for messages
    """

    thickness_mm: Array
    wavelength_nm: Array
    incidence_deg: Array
    reflectance: Array
    transmittance: Array
    reflectance_error: Array
    transmittance_error: Array
    places: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.thickness_mm.size)

    def take(self, rows: NDArray[np.bool_]) -> FluxTable:
        """The rows of a mask."""
        return FluxTable(
            thickness_mm=self.thickness_mm[rows],
            wavelength_nm=self.wavelength_nm[rows],
            incidence_deg=self.incidence_deg[rows],
            reflectance=self.reflectance[rows],
            transmittance=self.transmittance[rows],
            reflectance_error=self.reflectance_error[rows],
            transmittance_error=self.transmittance_error[rows],
            places=tuple(np.array(self.places, object)[rows]) if self.places else (),
        )


@dataclass(frozen=True, kw_only=True)
class ScatterTable:
    """Scattering distribution of one plate on one side.

    Attributes
    ----------
    side : "brdf" or "btdf"
    thickness_mm : of the plate
    wavelength_nm : (n,); nan: averaged over the visible
    incidence_deg, theta_deg, phi_deg : (n,); phi 0 is forwards in the plane of incidence
    value : (n,) [1/sr]
    error : (n,) relative standard errors
    """

    side: str
    thickness_mm: float
    wavelength_nm: Array
    incidence_deg: Array
    theta_deg: Array
    phi_deg: Array
    value: Array
    error: Array

    def section(self, wavelength_nm: float, incidence_deg: float) -> tuple[Array, Array, Array]:
        """Polar angles, values and errors of one wavelength and incidence, rising in angle."""
        rows = np.isclose(self.incidence_deg, incidence_deg)
        if np.isnan(wavelength_nm):
            rows &= np.isnan(self.wavelength_nm)
        else:
            rows &= np.isclose(self.wavelength_nm, wavelength_nm)
        order = np.argsort(self.theta_deg[rows], kind="stable")
        return (
            self.theta_deg[rows][order],
            self.value[rows][order],
            self.error[rows][order],
        )


@dataclass(frozen=True, kw_only=True)
class MaterialMeasurement:
    """Everything measured of one material.

    Attributes
    ----------
    name : of the material
    index : refractive index of its matrix
    flux : all R and T
    scatter : scattering distributions, any number
    energy_tolerance : by how much R + T may exceed 1
    """

    name: str
    index: float
    flux: FluxTable
    scatter: tuple[ScatterTable, ...] = field(default_factory=tuple)
    energy_tolerance: float = 0.0

    def __post_init__(self) -> None:
        check_flux(self.flux, self.energy_tolerance)

    @property
    def wavelengths_nm(self) -> Array:
        """Different wavelengths of the fluxes, rising."""
        return np.unique(self.flux.wavelength_nm)

    @property
    def plates_mm(self) -> Array:
        """Different thicknesses, rising."""
        return np.unique(self.flux.thickness_mm)

    def at(self, wavelength_nm: float) -> FluxTable:
        """Fluxes of one wavelength."""
        return self.flux.take(self.flux.wavelength_nm == wavelength_nm)

    def thinnest_section(self, wavelength_nm: float) -> tuple[Array, Array, Array] | None:
        """BTDF section of the thinnest plate at normal incidence, if it was measured."""
        tables = [t for t in self.scatter if t.side == "btdf"]
        for table in sorted(tables, key=lambda t: t.thickness_mm):
            if table.thickness_mm > self.plates_mm[0] * 1.001:
                break
            section = table.section(wavelength_nm, 0.0)
            if section[0].size >= 3:
                return section
        return None

    def average(self) -> MaterialMeasurement:
        """Spectral averages ("black and white"): one row per plate and angle, wavelength 0.

        Errors are those of a single wavelength: what a spectrometer does wrong, it mostly does
        wrong at all of them.
        """
        flux = self.flux
        keys = np.stack([flux.thickness_mm, flux.incidence_deg], axis=1)
        groups, member = np.unique(keys, axis=0, return_inverse=True)
        member = member.ravel()

        def mean(column: Array) -> Array:
            good = np.isfinite(column)
            total = np.bincount(member[good], column[good], len(groups))
            count = np.bincount(member[good], minlength=len(groups))
            return np.where(count > 0, total / np.maximum(count, 1), np.nan)

        return MaterialMeasurement(
            name=self.name,
            index=self.index,
            flux=FluxTable(
                thickness_mm=groups[:, 0],
                wavelength_nm=np.zeros(len(groups)),
                incidence_deg=groups[:, 1],
                reflectance=mean(flux.reflectance),
                transmittance=mean(flux.transmittance),
                reflectance_error=mean(flux.reflectance_error),
                transmittance_error=mean(flux.transmittance_error),
            ),
            scatter=tuple(_averaged(table) for table in self.scatter),
            energy_tolerance=self.energy_tolerance,
        )


def _averaged(table: ScatterTable) -> ScatterTable:
    """Mean over wavelengths of each direction."""
    keys = np.stack([table.incidence_deg, table.theta_deg, table.phi_deg], axis=1)
    groups, member = np.unique(keys, axis=0, return_inverse=True)
    member = member.ravel()
    count = np.bincount(member, minlength=len(groups))
    return ScatterTable(
        side=table.side,
        thickness_mm=table.thickness_mm,
        wavelength_nm=np.zeros(len(groups)),
        incidence_deg=groups[:, 0],
        theta_deg=groups[:, 1],
        phi_deg=groups[:, 2],
        value=np.bincount(member, table.value, len(groups)) / count,
        error=np.bincount(member, table.error, len(groups)) / count,
    )


def check_flux(flux: FluxTable, energy_tolerance: float = 0.0) -> None:
    """Refuse rows that no plate can show, naming the first of them."""
    r, t = flux.reflectance, flux.transmittance
    total = np.nan_to_num(r) + np.nan_to_num(t)
    percent = np.maximum(np.nan_to_num(r), np.nan_to_num(t)) > 1.5
    if np.all(percent) and len(flux) > 0:
        _refuse(flux, percent, 'R and T look like percent; say units.flux = "percent"')
    checks: tuple[tuple[NDArray[np.bool_], str], ...] = (
        (~(flux.thickness_mm > 0.0), "the plate's thickness is missing or not > 0 mm"),
        (~((flux.incidence_deg >= 0.0) & (flux.incidence_deg < 90.0)),
         "the angle of incidence is missing or outside 0 <= angle < 90 degrees"),
        (~np.isfinite(flux.wavelength_nm), "the wavelength is missing"),
        ((flux.wavelength_nm != 0.0) & (flux.wavelength_nm < 10.0),
         "the wavelength looks like micrometres; say units.wavelength = \"um\" for all rows"),
        (np.isnan(r) & np.isnan(t), "neither R nor T is given"),
        (percent, "R or T looks like percent while other rows are shares; use one unit"),
        ((r <= 0.0) | (t <= 0.0), "R and T must be > 0"),
        (total > 1.0 + energy_tolerance,
         "R + T exceeds 1, more light leaves than enters; correct the row, or allow noise with "
         "energy_tolerance"),
        (~((flux.reflectance_error > 0.0) & (flux.transmittance_error > 0.0)),
         "relative errors must be > 0"),
    )  # fmt: skip
    for bad, reason in checks:
        if np.any(bad):
            _refuse(flux, bad, reason)


def _refuse(flux: FluxTable, bad: NDArray[np.bool_], reason: str) -> None:
    row = int(np.argmax(bad))
    where = flux.places[row] if flux.places else f"row {row + 1}"
    values = f"R = {flux.reflectance[row]:.4g}, T = {flux.transmittance[row]:.4g}"
    raise MeasurementError(f"{where}: {reason} ({values})")
