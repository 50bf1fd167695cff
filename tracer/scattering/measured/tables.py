"""Measured tables from CSV and ASTM E1392-style files.

An ASTM E1392-style file starts with ``KEY value`` lines; a line ``VARS a,b,c`` names the columns,
the numbers follow, separated by commas or blanks (ASTM E1392-96, Standard Practice for Angle
Resolved Optical Scatter Measurements).
"""

from __future__ import annotations

import csv
import difflib
import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.model.givenfile import given_text
from tracer.scattering.measured.measurement import FluxTable, MeasurementError, ScatterTable

__all__ = ["read_flux_csv", "read_scatter_astm", "read_scatter_csv"]

Array = NDArray[np.float64]
_MICROMETRE = {"nm": 1.0, "um": 1000.0}
_FLUX_COLUMNS = (
    "wavelength_nm", "incidence_deg", "R", "T", "thickness_mm", "R_error", "T_error",
)  # fmt: skip
_SCATTER_COLUMNS = (
    "wavelength_nm", "incidence_deg", "theta_deg", "phi_deg", "brdf", "btdf", "error",
)  # fmt: skip
_COLORS = {"red", "green", "blue"}
_SHARE = {"1": 1.0, "percent": 0.01}


def read_flux_csv(
    path: Path,
    thickness_mm: float | None,
    *,
    error: float,
    wavelength_unit: str = "nm",
    flux_unit: str = "1",
) -> FluxTable:
    """R and T from a CSV table.

    Parameters
    ----------
    path : columns wavelength_nm, incidence_deg, R, T in any order; thickness_mm if one file holds
        several plates; R_error, T_error (relative) where they differ by row
    thickness_mm : of the plate, unless the table says
    error : relative standard error of rows that do not say
    wavelength_unit : "nm" or "um"
    flux_unit : "1" or "percent"
    """
    columns, lines = _csv_columns(path, _FLUX_COLUMNS)
    if "R" not in columns and "T" not in columns:
        raise MeasurementError(f"{path.name}: needs a column R or T, has {', '.join(columns)}")
    for needed in ("wavelength_nm", "incidence_deg"):
        if needed not in columns:
            raise MeasurementError(
                f"{path.name}: column {needed} is missing, there are {', '.join(columns)}"
            )
    n = len(lines)
    missing = np.full(n, math.nan)
    if "thickness_mm" in columns:
        thickness = columns["thickness_mm"]
        if thickness_mm is not None and not np.allclose(thickness, thickness_mm):
            row = int(np.argmax(~np.isclose(thickness, thickness_mm)))
            raise MeasurementError(
                f"{path.name}, line {lines[row]}: thickness {thickness[row]:g} mm contradicts "
                f"{thickness_mm:g} mm of its plate; mixed units?"
            )
    else:
        thickness = np.full(n, math.nan if thickness_mm is None else thickness_mm)
    default = np.full(n, error)
    scale = _SHARE[flux_unit]
    return FluxTable(
        thickness_mm=thickness,
        wavelength_nm=columns["wavelength_nm"] * _MICROMETRE[wavelength_unit],
        incidence_deg=columns["incidence_deg"],
        reflectance=columns.get("R", missing) * scale,
        transmittance=columns.get("T", missing) * scale,
        reflectance_error=columns.get("R_error", default),
        transmittance_error=columns.get("T_error", default),
        places=tuple(f"{path.name}, line {line}" for line in lines),
    )


def read_scatter_csv(
    path: Path, thickness_mm: float, *, error: float, wavelength_unit: str = "nm"
) -> list[ScatterTable]:
    """BRDF and BTDF from a CSV table.

    Columns: wavelength_nm (may be empty: averaged over the visible), incidence_deg, theta_deg,
    phi_deg, and brdf or btdf or both [1/sr], in any order; error (relative) where it differs by
    row.
    """
    columns, lines = _csv_columns(path, _SCATTER_COLUMNS)
    if "wavelength_nm" in columns:
        columns["wavelength_nm"] = columns["wavelength_nm"] * _MICROMETRE[wavelength_unit]
    return _scatter_tables(path, columns, lines, thickness_mm, error)


def read_scatter_astm(
    path: Path, thickness_mm: float, *, error: float, side: str
) -> list[ScatterTable]:
    """BRDF or BTDF from an ASTM E1392-style file; ``side`` is "brdf" or "btdf".

    The columns theta_i, phi_i, theta_s, phi_s [deg] and one value (the mean of Red, Green, Blue
    where these are given) are read; phi_s - phi_i - 180° becomes the azimuth from the forward
    direction in reflection and in transmission.
    """
    names: list[str] = []
    header: dict[str, str] = {}
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, text in enumerate(_lines(path), start=1):
        line = text.strip()
        if not line or line.startswith("#"):
            continue
        fields = line.replace(",", " ").split()
        if fields[0].upper() == "VARS":
            names = [name.lower() for name in fields[1:]]
        elif not names:
            header[fields[0].upper()] = line[len(fields[0]) :].strip()
        else:
            rows.append(_numbers(path, number, fields, len(names)))
            lines.append(number)
    if not names or not rows:
        raise MeasurementError(f"{path.name}: no line VARS with the column names, or no rows")
    table = dict(zip(names, np.array(rows).T, strict=True))
    for needed in ("theta_i", "theta_s"):
        if needed not in table:
            raise MeasurementError(f"{path.name}: column {needed} is missing in VARS")
    said = [name for name in names if not name.startswith(("theta", "phi"))]
    if not said:
        raise MeasurementError(f"{path.name}: VARS names no column of values")
    if len(said) > 1 and not _COLORS.issuperset(said):
        raise MeasurementError(
            f"{path.name}: VARS names several columns beside the angles ({', '.join(said)}); "
            "keep the one of values, or Red, Green and Blue, whose mean is taken"
        )
    values = [table[name] for name in said]
    zero = np.zeros(len(rows))
    wavelength = _wavelength(header, path)
    turned = table.get("phi_s", zero) - table.get("phi_i", zero) - 180.0
    columns = {
        "wavelength_nm": np.full(len(rows), wavelength),
        "incidence_deg": table["theta_i"],
        "theta_deg": table["theta_s"],
        "phi_deg": turned % 360.0,
        side: np.mean(values, axis=0),
    }
    return _scatter_tables(path, columns, lines, thickness_mm, error)


_LENGTH = re.compile(r"([-+.\deE]+?)\s*(nm|nanomet\w*|um|µm|micro\w*)?", re.IGNORECASE)


def _wavelength(header: dict[str, str], path: Path) -> float:
    """Wavelength [nm] of an ASTM header; micrometres are recognised by word or by size."""
    for key in ("WAVELENGTH", "INC_WAVELENGTH", "LAMBDA"):
        if key in header:
            found = _LENGTH.fullmatch(header[key].strip())
            try:
                value = float(found[1]) if found else math.nan
            except ValueError:
                value = math.nan
            if not value > 0.0:
                raise MeasurementError(
                    f"{path.name}: {key} {header[key]!r} is no wavelength; say a number of nm"
                )
            unit = (found[2] or "").lower() if found else ""
            micrometres = unit.startswith(("u", "µ", "mi")) if unit else value < 30.0
            return value * 1000.0 if micrometres else value
    return math.nan


def _scatter_tables(
    path: Path, columns: dict[str, Array], lines: list[int], thickness_mm: float, error: float
) -> list[ScatterTable]:
    for needed in ("incidence_deg", "theta_deg"):
        if needed not in columns:
            raise MeasurementError(f"{path.name}: column {needed} is missing")
    sides = [side for side in ("brdf", "btdf") if side in columns]
    if not sides:
        raise MeasurementError(f"{path.name}: needs a column brdf or btdf")
    n = len(lines)
    tables = []
    for side in sides:
        value = columns[side]
        angles = (columns["incidence_deg"], columns["theta_deg"])
        bad = ~np.isfinite(value) | (value < 0.0)
        for angle in angles:
            bad |= ~((angle >= 0.0) & (angle <= 90.0))
        if np.any(bad):
            row = int(np.argmax(bad))
            raise MeasurementError(
                f"{path.name}, line {lines[row]}: {side} = {value[row]:g} at incidence "
                f"{angles[0][row]:g} and theta {angles[1][row]:g} degrees; values must be >= 0, "
                "angles within 0 .. 90 degrees"
            )
        keep = (value > 0.0) & (angles[0] < 90.0) & (angles[1] < 90.0)
        tables.append(
            ScatterTable(
                side=side,
                thickness_mm=thickness_mm,
                wavelength_nm=columns.get("wavelength_nm", np.full(n, math.nan))[keep],
                incidence_deg=angles[0][keep],
                theta_deg=angles[1][keep],
                phi_deg=columns.get("phi_deg", np.zeros(n))[keep],
                value=value[keep],
                error=columns.get("error", np.full(n, error))[keep],
            )
        )
    return tables


def _csv_columns(path: Path, known: tuple[str, ...]) -> tuple[dict[str, Array], list[int]]:
    """Columns of numbers by name, and the line of each row; an empty cell is nan.

    Raises
    ------
    MeasurementError
        for a column that nobody would read, above all a misspelt one
    """
    reader = csv.reader(line for line in _lines(path))
    names: list[str] = []
    rows: list[list[float]] = []
    lines: list[int] = []
    for fields in reader:
        if not fields or fields[0].lstrip().startswith("#"):
            continue
        if not names:
            names = [name.strip() for name in fields]
            _check_columns(names, known, path)
            continue
        rows.append(_numbers(path, reader.line_num, fields, len(names)))
        lines.append(reader.line_num)
    if not rows:
        raise MeasurementError(f"{path.name}: the table has no rows")
    return dict(zip(names, np.array(rows, np.float64).T, strict=True)), lines


def _check_columns(names: list[str], known: tuple[str, ...], path: Path) -> None:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise MeasurementError(f"{path.name}: two columns are called {name!r}; drop one")
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise MeasurementError(
                f"{path.name}: the column {name!r} is not read{hint}; there may be "
                f"{', '.join(known)}: rename or drop it"
            )


def _numbers(path: Path, line: int, fields: list[str], expected: int) -> list[float]:
    if len(fields) != expected:
        raise MeasurementError(
            f"{path.name}, line {line}: {len(fields)} cells, the header has {expected}"
        )
    numbers = []
    for cell in fields:
        try:
            numbers.append(float(cell) if cell.strip() else math.nan)
        except ValueError:
            raise MeasurementError(
                f"{path.name}, line {line}: {cell.strip()!r} is not a number"
            ) from None
    return numbers


def _lines(path: Path) -> list[str]:
    return given_text(path, "table", MeasurementError).splitlines()
