"""The measurement file of a fit: one TOML for a material, with the tables of its plates."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from raymap.model.givenfile import given_text
from raymap.model.giventext import toml_tables
from tracer.scattering.measured.bsdf_xml import read_bsdf_xml
from tracer.scattering.measured.measurement import (
    FluxTable,
    MaterialMeasurement,
    MeasurementError,
    ScatterTable,
)
from tracer.scattering.measured.tables import read_flux_csv, read_scatter_astm, read_scatter_csv

__all__ = ["FitSettings", "load_measurement"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Node(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FitSettings(_Node):
    """Section ``[fit]``: what is fitted and how.

    gamma : the exponent, or "search" over ``gammas``
    angle_weights : weight of an angle of incidence [deg] in the objective; 1 where not named
    use_btdf : let the BTDF shape of the thinnest plate take part where it was measured
    """

    gamma: float | Literal["search"] = "search"
    gammas: tuple[float, ...] = (1.0, 1.5, 2.0, 2.5, 3.5, 5.0, 7.0, 10.0, 14.0)
    angle_weights: dict[str, Annotated[float, Field(ge=0)]] = {"45": 0.5, "60": 0.0}
    use_btdf: bool = True


class _Errors(_Node):
    flux: Positive = 0.05
    scatter: Positive = 0.1


class _Units(_Node):
    thickness: Literal["mm", "um", "m", "inch"] = "mm"
    wavelength: Literal["nm", "um"] = "nm"
    flux: Literal["1", "percent"] = "1"


class _Scatter(_Node):
    file: str
    side: Literal["brdf", "btdf"] | None = None


class _Plate(_Node):
    thickness: Positive | None = None
    flux: str
    scatter: tuple[_Scatter, ...] = ()


class _DataFile(_Node):
    name: str
    index: Annotated[float, Field(ge=1, lt=5)] = 1.49
    energy_tolerance: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    errors: _Errors = _Errors()
    units: _Units = _Units()
    plate: Annotated[tuple[_Plate, ...], Field(min_length=1)]
    fit: FitSettings = FitSettings()


_MILLIMETRES = {"mm": 1.0, "um": 1e-3, "m": 1e3, "inch": 25.4}


def load_measurement(path: Path | str) -> tuple[MaterialMeasurement, FitSettings]:
    """Read a measurement file and the tables beside it.

    Raises
    ------
    MeasurementError
        naming the key of the file, or the line of the table, that cannot be used
    """
    where = Path(path)
    try:
        text = given_text(where, "measurement file", MeasurementError)
        if (kind := _kind_of_table(where, text)) is not None:
            raise MeasurementError(
                f"{where.name}: is {kind}, which says neither index nor thickness; write a "
                f"measurement file (.toml) that names it: name, index, and [[plate]] with "
                f"thickness, flux = a CSV of R and T, scatter = [{{ file = '{where.name}' }}]; "
                "fit-scattering takes that file"
            )
        data = _DataFile.model_validate(toml_tables(text, where.name, MeasurementError))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise MeasurementError(f"{where.name}: {key}: {first['msg']}") from None
    flux: list[FluxTable] = []
    scatter: list[ScatterTable] = []
    for number, plate in enumerate(data.plate, start=1):
        thickness = None
        if plate.thickness is not None:
            thickness = plate.thickness * _MILLIMETRES[data.units.thickness]
            if not 0.005 <= thickness <= 200.0:
                raise MeasurementError(
                    f"{where.name}: plate {number} is {thickness:g} mm thick; mixed units? "
                    "Say units.thickness for all plates"
                )
        table = read_flux_csv(
            where.parent / plate.flux,
            thickness,
            error=data.errors.flux,
            wavelength_unit=data.units.wavelength,
            flux_unit=data.units.flux,
        )
        if np.any(np.isnan(table.thickness_mm)):
            raise MeasurementError(
                f"{where.name}: plate {number} ({plate.flux}) has no thickness; give "
                "plate.thickness or a column thickness_mm"
            )
        flux.append(table)
        for item in plate.scatter:
            if thickness is None:
                raise MeasurementError(
                    f"{where.name}: plate {number} has scattering data and needs its thickness"
                )
            scatter += _read_scatter(
                where.parent / item.file,
                thickness,
                data.errors.scatter,
                item.side,
                data.units.wavelength,
            )
    material = MaterialMeasurement(
        name=data.name,
        index=data.index,
        flux=_joined(flux),
        scatter=tuple(scatter),
        energy_tolerance=data.energy_tolerance,
    )
    return material, data.fit


def _kind_of_table(path: Path, text: str) -> str | None:
    """What a table is that a measurement file names, and that was given in its place."""
    begins = text.lstrip("\ufeff \t\r\n")
    if begins.startswith("<"):
        klems = "<WindowElement" in text[:100_000]
        return "a BSDF in XML (WindowElement, as of Klems)" if klems else "a file in XML"
    if path.suffix.lower() == ".csv":
        return "a table of measured values (CSV)"
    if re.search(r"(?m)^VARS[ \t]", text):
        return "a table of scattering (ASTM E1392)"
    return None


def _read_scatter(
    path: Path, thickness_mm: float, error: float, side: str | None, wavelength_unit: str
) -> list[ScatterTable]:
    suffix = path.suffix.lower()
    if suffix == ".xml":
        tables = read_bsdf_xml(path, thickness_mm, error=error)
    elif suffix == ".csv":
        tables = read_scatter_csv(path, thickness_mm, error=error, wavelength_unit=wavelength_unit)
    elif side is None:
        raise MeasurementError(
            f'{path.name}: say side = "brdf" or "btdf"; the file itself does not'
        )
    else:
        return read_scatter_astm(path, thickness_mm, error=error, side=side)
    found = [table for table in tables if side in (None, table.side)]
    if tables and not found:
        raise MeasurementError(
            f"{path.name}: holds no {side}, but {tables[0].side}; drop side, or name another file"
        )
    return found


def _joined(tables: list[FluxTable]) -> FluxTable:
    def column(name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.concatenate([getattr(table, name) for table in tables])

    return FluxTable(
        thickness_mm=column("thickness_mm"),
        wavelength_nm=column("wavelength_nm"),
        incidence_deg=column("incidence_deg"),
        reflectance=column("reflectance"),
        transmittance=column("transmittance"),
        reflectance_error=column("reflectance_error"),
        transmittance_error=column("transmittance_error"),
        places=tuple(place for table in tables for place in table.places),
    )
