"""Glasses, plastics, crystals and liquids by name.

A table of the common ones is shipped (``glasses.csv``, with the source of every row), and one of
the makers' full lists (`tracer.optics.maker_glasses`); the package ``opticalglass``, where it is
installed, adds what is newer than they are.
"""

from __future__ import annotations

import csv
import difflib
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module, resources, util
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import MissingExtra, SceneError
from tracer.optics.absorption import absorption_from_transmittance
from tracer.optics.dispersion import Dispersion, Kind
from tracer.optics.maker_glasses import CATALOGUE_MAKERS, Row, find_row

__all__ = ["Glass", "find_glass", "find_shipped", "glass_names"]

MAKERS = CATALOGUE_MAKERS
"""Makers by whose names glasses may be called."""

_IN_OPTICALGLASS = ("Schott", "Ohara", "CDGM", "Hoya", "Hikari", "Sumita")

_REFERENCE_MM = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Glass:
    """A material by name.

    Attributes
    ----------
    name, maker : maker is "" for materials that nobody owns
    dispersion : its refractive index
    source : where the data come from
    transmittance_nm, transmittance : (n,) internal transmittance of 10 mm, empty if not known
    """

    name: str
    maker: str
    dispersion: Dispersion
    source: str
    transmittance_nm: NDArray[np.float64]
    transmittance: NDArray[np.float64]

    def index(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Refractive index at vacuum wavelengths [nm]."""
        return self.dispersion.index(wavelength_nm)

    def absorption(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Absorption coefficient [1/mm]; 0 where the material has no transmittance data."""
        if self.transmittance.size == 0:
            return np.zeros_like(np.asarray(wavelength_nm, np.float64))
        return absorption_from_transmittance(
            wavelength_nm,
            self.transmittance_nm,
            self.transmittance,
            _REFERENCE_MM,
            name=self.name,
        )


_SHORT = {"pc": "polycarbonate", "ps": "polystyrene"}
"""Abbreviations of ISO 1043 for plastics that the tables have by their full names."""

_MEANT = {
    "polycarb": "polycarbonate", "lexan": "polycarbonate",
    "acrylic": "pmma", "plexiglas": "pmma", "plexiglass": "pmma",
    "bk7": "n-bk7", "silica": "fused silica", "quartz glass": "fused silica",
    "sapphire": "sapphire o", "calcite": "calcite o", "quartz": "quartz o",
}  # fmt: skip
"""What people call materials that the tables have under another name."""


def find_glass(name: str, maker: str | None = None) -> Glass:
    """The material of a name, written as in the catalogues; case and spaces do not matter.

    Parameters
    ----------
    name : e.g. "N-BK7", "PMMA", "fused silica"; "Schott N-BK7" and "N-BK7 (Schott)" name the maker
    maker : only look in the catalogue of this maker

    Raises
    ------
    SceneError
        if no such material is known, with the nearest names
    """
    wanted, maker = _split(name, maker)
    shipped = find_shipped(wanted, maker)
    if shipped is not None:
        return shipped
    if util.find_spec("opticalglass") is not None:
        found = _from_catalogues(wanted, maker)
        if found is not None:
            return found
        hint = ""
    else:
        hint = "; the makers' newest glasses come with the package opticalglass"
        if maker is not None and _key(wanted) not in _shipped():
            raise MissingExtra(
                f"glass {wanted!r} of {maker} is not in the shipped tables; "
                "pip install opticalglass for the makers' newest catalogues"
            )
    near = difflib.get_close_matches(_key(wanted), list(_shipped()), n=3, cutoff=0.4)
    if _key(wanted) in _MEANT:
        near = [_MEANT[_key(wanted)]]
    names = ", ".join(repr(_shipped()[key].name) for key in near)
    by_maker = f" by {maker}" if maker else ""
    raise SceneError(
        f"there is no glass {wanted!r}{by_maker}"
        + (f"; the nearest names are {names}" if names else "")
        + hint
    )


def find_shipped(name: str, maker: str | None = None) -> Glass | None:
    """As `find_glass`, from the shipped tables alone; None for a name that they do not have."""
    wanted, maker = _split(name, maker)
    key = _key(wanted)
    common = _shipped().get(_SHORT.get(key, key))
    if common is not None and maker in (None, common.maker):
        return common
    row = find_row(wanted, maker)
    return None if row is None else _from_row(row)


def glass_names() -> list[str]:
    """Names of the shipped materials."""
    return [glass.name for glass in _shipped().values()]


def _split(name: str, maker: str | None) -> tuple[str, str | None]:
    """Take a maker's name out of "Schott N-BK7" or "N-BK7 (Schott)"."""
    if maker is None:
        for known in MAKERS:
            match = re.fullmatch(
                rf"{known}[\s:]+(.+)|(.+?)\s*\({known}\)", name.strip(), re.IGNORECASE
            )
            if match:
                return (match[1] or match[2]).strip(), known
        return name.strip(), None
    for known in MAKERS:
        if known.casefold() == maker.casefold():
            return name.strip(), known
    raise SceneError(f"there is no maker {maker!r} of glasses; known are {', '.join(MAKERS)}")


def _key(name: str) -> str:
    return re.sub(r"\s+", " ", name.strip()).casefold()


def _rows(file: str) -> Iterator[dict[str, str]]:
    text = resources.files("tracer.optics").joinpath(file).read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return iter(csv.DictReader(lines))


@cache
def _shipped() -> dict[str, Glass]:
    known: dict[str, tuple[list[float], list[float]]] = {}
    for row in _rows("glass_transmittance.csv"):
        wavelengths, values = known.setdefault(row["name"], ([], []))
        wavelengths.append(float(row["wavelength_nm"]))
        values.append(float(row["transmittance"]))
    glasses = {}
    for row in _rows("glasses.csv"):
        wavelengths, values = known.get(row["name"], ([], []))
        glasses[_key(row["name"])] = Glass(
            name=row["name"],
            maker=row["maker"],
            dispersion=Dispersion(
                kind=cast(Kind, row["kind"]),
                coefficients=tuple(float(cell) for cell in row["coefficients"].split()),
                range_nm=(float(row["from_nm"]), float(row["to_nm"])),
                name=row["name"],
            ),
            source=row["source"],
            transmittance_nm=np.array(wavelengths),
            transmittance=np.array(values),
        )
    return glasses


def _from_row(row: Row) -> Glass:
    """A glass of the table of the makers."""
    numbers = tuple(float(cell) for cell in row["coefficients"].split())
    table = row["kind"] == "tabulated"
    pairs = [pair.split(":") for pair in row["transmittance"].split()]
    return Glass(
        name=row["name"],
        maker=row["maker"],
        dispersion=Dispersion(
            kind=cast(Kind, row["kind"]),
            coefficients=numbers[1::2] if table else numbers,
            table_nm=numbers[::2] if table else (),
            range_nm=(float(row["from_nm"]), float(row["to_nm"])),
            name=row["name"],
        ),
        source=f"{row['maker']} catalogue (refractiveindex.info, CC0)",
        transmittance_nm=np.array([float(pair[0]) for pair in pairs]),
        transmittance=np.array([float(pair[1]) for pair in pairs]),
    )


@cache
def _from_catalogues(name: str, maker: str | None) -> Glass | None:
    """A glass of the package opticalglass, its index as a table."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the package warns of its own dependencies
        glassfactory: Any = import_module("opticalglass.glassfactory")
        for catalogue in (maker,) if maker else _IN_OPTICALGLASS:
            try:
                found: Any = glassfactory.create_glass(name.upper(), catalogue)
            except Exception:  # each catalogue has its own way to say no
                continue
            return _convert(found, name.upper(), str(catalogue))
    return None


def _convert(found: Any, name: str, maker: str) -> Glass:
    wavelengths, values = (np.asarray(part, np.float64) for part in found.transmission_data())
    order = np.argsort(wavelengths)
    wavelengths, values = wavelengths[order], np.clip(values[order], 0.0, 1.0)
    transparent = wavelengths[values > 0.0]
    low, high = (transparent[0], transparent[-1]) if transparent.size else (365.0, 2325.4)
    table = np.unique(np.concatenate((np.arange(low, 1100.0, 2.0), np.linspace(1100.0, high, 200))))
    table = table[(table >= low) & (table <= high)]
    index = np.array([float(found.rindex(float(w))) for w in table])
    return Glass(
        name=name,
        maker=maker,
        dispersion=Dispersion(
            kind="tabulated",
            coefficients=tuple(index.tolist()),
            table_nm=tuple(table.tolist()),
            range_nm=(float(table[0]), float(table[-1])),
            name=name,
        ),
        source=f"{maker} catalogue (package opticalglass)",
        transmittance_nm=wavelengths,
        transmittance=values,
    )
