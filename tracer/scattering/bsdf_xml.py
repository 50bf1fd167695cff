"""Scattering distributions from the BSDF XML files of window and daylighting software.

The files (schema WINDOW 6/7, "WindowElement") hold matrices over an angle basis of patches, such
as the one of Klems: for each patch of incidence a column of values [1/sr]. Packages that read them
compile a whole renderer; this reader takes what a fit needs and refuses document types and
entities, so that a hostile file costs nothing.

References
----------
J. H. Klems, ASHRAE Transactions 100(1), 1065 (1994).
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from tracer.scattering.measurement import MeasurementError, ScatterTable

__all__ = ["read_bsdf_xml"]

Array = NDArray[np.float64]
_SIDES = {"transmission front": "btdf", "reflection front": "brdf"}
_LARGEST = 64 * 1024 * 1024


def read_bsdf_xml(path: Path, thickness_mm: float, *, error: float) -> list[ScatterTable]:
    """Front BRDF and BTDF tables of a BSDF XML file with its angle basis written out."""
    try:
        raw = path.read_bytes()
    except OSError as failure:
        raise MeasurementError(f"cannot read {path}: {failure}") from None
    if len(raw) > _LARGEST:
        raise MeasurementError(f"{path.name}: larger than {_LARGEST >> 20} MiB")
    if b"<!DOCTYPE" in raw or b"<!ENTITY" in raw:
        raise MeasurementError(f"{path.name}: document types and entities are not accepted")
    try:
        root = ElementTree.fromstring(raw)
    except ElementTree.ParseError as failure:
        raise MeasurementError(f"{path.name}: not well-formed XML: {failure}") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    bases = {
        _text(basis, "AngleBasisName", path): _patches(basis, path)
        for basis in root.iter("AngleBasis")
    }
    if not bases:
        raise MeasurementError(f"{path.name}: no AngleBasis (tensor trees are not read)")
    tables: list[ScatterTable] = []
    for data in root.iter("WavelengthData"):
        wavelength = _wavelength(data)
        for block in data.iter("WavelengthDataBlock"):
            side = _SIDES.get(_text(block, "WavelengthDataDirection", path).strip().lower())
            if side is None:
                continue
            tables.append(_table(block, bases, side, wavelength, thickness_mm, error, path))
    if not tables:
        raise MeasurementError(f"{path.name}: no front transmission or reflection data")
    return tables


def _patches(basis: ElementTree.Element, path: Path) -> Array:
    """(n, 2) polar angle and azimuth of the patch centres [deg]."""
    patches = []
    for ring in basis.iter("AngleBasisBlock"):
        theta = _number(_text(ring, "Theta", path), path)
        count = int(_number(_text(ring, "nPhis", path), path))
        if not 1 <= count <= 10_000:
            raise MeasurementError(f"{path.name}: nPhis = {count} is out of range")
        patches += [(theta, 360.0 * k / count) for k in range(count)]
    return np.array(patches, np.float64).reshape(-1, 2)


def _table(
    block: ElementTree.Element,
    bases: dict[str, Array],
    side: str,
    wavelength_nm: float,
    thickness_mm: float,
    error: float,
    path: Path,
) -> ScatterTable:
    columns = bases.get(_text(block, "ColumnAngleBasis", path))
    rows = bases.get(_text(block, "RowAngleBasis", path))
    if columns is None or rows is None:
        raise MeasurementError(f"{path.name}: a data block names an unknown angle basis")
    cells = _text(block, "ScatteringData", path).replace(",", " ").split()
    if len(cells) != len(rows) * len(columns):
        raise MeasurementError(
            f"{path.name}: {len(cells)} values of {side}, the angle bases need "
            f"{len(rows)} x {len(columns)}"
        )
    value = np.array([_number(cell, path) for cell in cells]).reshape(len(rows), len(columns))
    if np.any(~np.isfinite(value)) or np.any(value < 0.0):
        raise MeasurementError(f"{path.name}: {side} has values that are negative or not finite")
    leaving, coming = np.meshgrid(np.arange(len(rows)), np.arange(len(columns)), indexing="ij")
    keep = (value > 0.0).ravel()
    # The undeviated beam has the patch number of its incidence, the specular one lies opposite
    turned = rows[leaving, 1] - columns[coming, 1] - (180.0 if side == "brdf" else 0.0)
    return ScatterTable(
        side=side,
        thickness_mm=thickness_mm,
        wavelength_nm=np.full(int(keep.sum()), wavelength_nm),
        incidence_deg=columns[coming, 0].ravel()[keep],
        theta_deg=rows[leaving, 0].ravel()[keep],
        phi_deg=(turned % 360.0).ravel()[keep],
        value=value.ravel()[keep],
        error=np.full(int(keep.sum()), error),
    )


def _wavelength(data: ElementTree.Element) -> float:
    """Wavelength [nm] where the file names one, nan for "Visible" and the like."""
    element = data.find("Wavelength")
    try:
        return float((element.text or "").strip()) if element is not None else math.nan
    except ValueError:
        return math.nan


def _text(element: ElementTree.Element, name: str, path: Path) -> str:
    found = next(element.iter(name), None)
    if found is None or not (found.text or "").strip():
        raise MeasurementError(f"{path.name}: {element.tag} has no {name}")
    return (found.text or "").strip()


def _number(text: str, path: Path) -> float:
    try:
        return float(text)
    except ValueError:
        raise MeasurementError(f"{path.name}: {text[:20]!r} is not a number") from None
