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
import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from raymap.model.givenfile import given_bytes
from tracer.scattering.measured.measurement import MeasurementError, ScatterTable

__all__ = ["read_bsdf_xml"]

Array = NDArray[np.float64]
_SIDES = {"transmission front": "btdf", "reflection front": "brdf"}
_LARGEST = 64 * 1024 * 1024


class _HasEntities(Exception):
    """The text declares a document type, the only place where entities are defined."""


class _Plain(ElementTree.TreeBuilder):
    """Builds elements of a text without a document type, in whatever encoding it comes."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise _HasEntities


def read_bsdf_xml(path: Path, thickness_mm: float, *, error: float) -> list[ScatterTable]:
    """Front BRDF and BTDF tables of a BSDF XML file with its angle basis written out.

    A table whose light is all in the undeviated or the mirrored beam is that of a clear pane: it
    holds no scattering and is left out with a warning. Values averaged over the visible are taken
    before those over the sunlight or the infrared.
    """
    raw = given_bytes(path, "BSDF file", MeasurementError, largest=_LARGEST)
    try:
        # Old systems close a text with Ctrl-Z, some programs with NUL bytes
        parser = ElementTree.XMLParser(target=_Plain())
        parser.feed(raw.rstrip(b"\0\x1a \t\r\n"))
        root = parser.close()
    except _HasEntities:
        raise MeasurementError(
            f"{path.name}: document types and entities are not accepted"
        ) from None
    except (ElementTree.ParseError, ValueError, LookupError) as failure:
        raise MeasurementError(f"{path.name}: not well-formed XML: {failure}") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    bases = {
        _text(basis, "AngleBasisName", path): _patches(basis, path)
        for basis in root.iter("AngleBasis")
    }
    if not bases:
        raise MeasurementError(f"{path.name}: no AngleBasis (tensor trees are not read)")
    layers = sum(1 for _ in root.iter("Layer"))
    if layers > 1:
        raise MeasurementError(
            f"{path.name}: describes {layers} layers; their tables cannot be told apart here: keep "
            "the one of the plate"
        )
    _compare_thickness(root, thickness_mm, path)
    by_columns = _incident_by_columns(root, path)
    tables: list[ScatterTable | None] = []
    for data, wavelength in _spectral_data(root, path):
        for block in data.iter("WavelengthDataBlock"):
            side = _SIDES.get(_text(block, "WavelengthDataDirection", path).strip().lower())
            if side is None:
                continue
            read = _Block(block, bases, side, path, by_columns)
            tables.append(read.table(wavelength, thickness_mm, error))
    if not tables:
        raise MeasurementError(f"{path.name}: no front transmission or reflection data")
    scattering = [table for table in tables if table is not None]
    if len(scattering) < len(tables):
        warnings.warn(
            f"{path.name}: {len(tables) - len(scattering)} of {len(tables)} tables show the "
            "undeviated or mirrored beam alone, as a clear pane does: they hold no scattering and "
            "are left out",
            stacklevel=2,
        )
    return scattering


_MILLIMETRES = {"millimeter": 1.0, "mm": 1.0, "meter": 1e3, "m": 1e3, "inch": 25.4, "inches": 25.4}


def _compare_thickness(root: ElementTree.Element, thickness_mm: float, path: Path) -> None:
    """Warn where the file is that of another plate than the one it is given for."""
    said = next(root.iter("Thickness"), None)
    if said is None or not (said.text or "").strip():
        return
    unit = said.get("unit", "millimeter").strip().lower().replace("metre", "meter")
    scale = _MILLIMETRES.get(unit.removesuffix("s") if unit.endswith("meters") else unit)
    if scale is None:
        raise MeasurementError(f"{path.name}: Thickness in {unit!r}; millimeter, meter or inch")
    stated = scale * _number((said.text or "").strip(), path)
    if stated > 0.0 and abs(stated - thickness_mm) > 0.01 * thickness_mm:
        warnings.warn(
            f"{path.name}: is of a plate of {stated:g} mm, and is taken for one of "
            f"{thickness_mm:g} mm",
            stacklevel=4,
        )


def _incident_by_columns(root: ElementTree.Element, path: Path) -> bool:
    """Whether a column of the matrices belongs to one direction of incidence."""
    said = next(root.iter("IncidentDataStructure"), None)
    word = (said.text or "").strip().lower() if said is not None else "columns"
    if word not in ("columns", "rows"):
        raise MeasurementError(
            f"{path.name}: data of structure {word!r}; matrices by columns or rows are read"
        )
    return word == "columns"


def _spectral_data(
    root: ElementTree.Element, path: Path
) -> list[tuple[ElementTree.Element, float]]:
    """Blocks of data with their wavelength [nm], nan for the average over the visible."""
    found = [(data, *_wavelength(data, path)) for data in root.iter("WavelengthData")]
    others = sorted({word for _, _, word in found if word})
    chosen = [(data, nm) for data, nm, word in found if not word]
    if others and not chosen:
        chosen = [(data, nm) for data, nm, word in found if word == others[0]]
        warnings.warn(
            f"{path.name}: has no data of the visible; those called {others[0]!r} stand for it",
            stacklevel=3,
        )
        others = others[1:]
    if others:
        warnings.warn(f"{path.name}: data called {', '.join(others)} are left out", stacklevel=3)
    return chosen


def _patches(basis: ElementTree.Element, path: Path) -> Array:
    """(n, 2) polar angle and azimuth of the patch centres [deg]."""
    patches = []
    for ring in basis.iter("AngleBasisBlock"):
        theta = _number(_text(ring, "Theta", path), path)
        if not 0.0 <= theta <= 90.0:
            raise MeasurementError(f"{path.name}: Theta = {theta:g} is out of range (0 .. 90)")
        count = _number(_text(ring, "nPhis", path), path)
        if not (1 <= count <= 10_000 and count.is_integer()):
            raise MeasurementError(f"{path.name}: nPhis = {count:g} is out of range")
        patches += [(theta, 360.0 * k / count) for k in range(int(count))]
    return np.array(patches, np.float64).reshape(-1, 2)


class _Block:
    """One matrix of values and the patches of its rows and columns."""

    def __init__(
        self,
        block: ElementTree.Element,
        bases: dict[str, Array],
        side: str,
        path: Path,
        by_columns: bool,
    ) -> None:
        coming = bases.get(_text(block, "ColumnAngleBasis", path))
        leaving = bases.get(_text(block, "RowAngleBasis", path))
        if coming is None or leaving is None:
            raise MeasurementError(f"{path.name}: a data block names an unknown angle basis")
        if not by_columns:
            coming, leaving = leaving, coming
        kind = next(block.iter("ScatteringDataType"), None)
        word = ((kind.text if kind is not None else "") or side).strip().lower()
        if word not in ("btdf", "brdf"):
            raise MeasurementError(
                f"{path.name}: ScatteringDataType {word!r}; only BTDF and BRDF [1/sr] are read"
            )
        cells = _text(block, "ScatteringData", path).replace(",", " ").split()
        if len(cells) != len(leaving) * len(coming):
            raise MeasurementError(
                f"{path.name}: {len(cells)} values of {side}, the angle bases need "
                f"{len(leaving)} x {len(coming)}"
            )
        value = np.array([_number(cell, path) for cell in cells])
        if np.any(~np.isfinite(value)) or np.any(value < 0.0):
            raise MeasurementError(
                f"{path.name}: {side} has values that are negative or not finite"
            )
        shape = len(leaving), len(coming)
        self.value = value.reshape(shape) if by_columns else value.reshape(shape[::-1]).T
        self.side, self.leaving, self.coming = side, leaving, coming

    def table(self, wavelength_nm: float, thickness_mm: float, error: float) -> ScatterTable | None:
        """The values above 0; None where they are a beam that goes on straight or is mirrored."""
        row, column = np.nonzero(self.value > 0.0)
        coming, leaving = self.coming[column], self.leaving[row]
        # The undeviated beam has the patch number of its incidence, the specular one lies opposite
        turned = leaving[:, 1] - coming[:, 1] - (180.0 if self.side == "brdf" else 0.0)
        same = np.abs(leaving[:, 0] - coming[:, 0]) < 1e-6
        across = np.abs(np.sin(np.radians(turned))) > 1e-6
        if not np.any(~same | (across & (leaving[:, 0] > 0.0))):
            return None
        return ScatterTable(
            side=self.side,
            thickness_mm=thickness_mm,
            wavelength_nm=np.full(row.size, wavelength_nm),
            incidence_deg=coming[:, 0],
            theta_deg=leaving[:, 0],
            phi_deg=turned % 360.0,
            value=self.value[row, column],
            error=np.full(row.size, error),
        )


def _wavelength(data: ElementTree.Element, path: Path) -> tuple[float, str]:
    """Wavelength [nm], nan for the visible; and what a range that is none of both is called."""
    element = data.find("Wavelength")
    if element is None:
        return math.nan, ""
    text = (element.text or "").strip()
    try:
        length = float(text)
    except ValueError:
        visible = text.lower() in ("", "visible", "photopic", "vis")
        return math.nan, "" if visible else text
    unit = element.get("unit", "nm").strip().lower()
    if unit in ("um", "µm", "micron", "microns", "micrometers"):
        return length * 1000.0, ""
    if unit in ("nm", "nanometer", "nanometers", "integral"):
        return length, ""
    raise MeasurementError(f"{path.name}: Wavelength in {unit!r}; nanometers or microns are read")


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
