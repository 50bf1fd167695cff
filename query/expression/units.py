"""Numbers with units, as criteria write them."""

from __future__ import annotations

import math

from raymap.model.errors import CriterionError
from raymap.model.units import METRES

__all__ = ["ANGLES", "convert", "degrees", "known_units", "length_factor", "unit_words"]

_LENGTH_M = METRES | {"μm": 1e-6, "dm": 1e-1, "km": 1e3, "inch": METRES["in"]}
_WAVELENGTH_NM = {"nm": 1.0, "um": 1e3, "µm": 1e3, "μm": 1e3, "mm": 1e6, "m": 1e9, "Å": 0.1}
_ANGLE_DEG = {
    "deg": 1.0,
    "°": 1.0,
    "rad": 180 / math.pi,
    "mrad": 0.18 / math.pi,
    "arcmin": 1 / 60,
    "arcsec": 1 / 3600,
}
_TIME_PS = {"fs": 1e-3, "ps": 1.0, "ns": 1e3, "us": 1e6, "µs": 1e6, "μs": 1e6}
ANGLES = frozenset(_ANGLE_DEG)
"""Units of angle."""
_FLUX = {
    "W": {"W": 1.0, "mW": 1e-3, "uW": 1e-6, "µW": 1e-6, "μW": 1e-6, "nW": 1e-9, "kW": 1e3},
    "lm": {"lm": 1.0, "mlm": 1e-3, "klm": 1e3},
}


def _scale(unit: str, table: dict[str, float], what: str) -> float:
    if unit not in table:
        raise CriterionError(f"{what} is measured in {', '.join(table)}, not in {unit!r}")
    return table[unit]


def length_factor(unit: str, length_unit: str) -> float:
    """Scene units per ``unit``.

    Raises
    ------
    CriterionError
        The unit is none of length, or that of the map is not known.
    """
    metres = _scale(unit, _LENGTH_M, "a length")
    if length_unit not in _LENGTH_M:
        raise CriterionError(
            f"the map's unit of length, {length_unit!r}, is not known: write the number without one"
        )
    return metres / _LENGTH_M[length_unit]


def known_units() -> set[str]:
    """Every unit word of the language."""
    return {*_LENGTH_M, *_WAVELENGTH_NM, *_ANGLE_DEG, *_TIME_PS, *_FLUX["W"], *_FLUX["lm"]}


def unit_words() -> str:
    """The units by what they measure, each in one spelling, for messages."""
    groups = (_LENGTH_M, _ANGLE_DEG, _TIME_PS, _FLUX["W"], _FLUX["lm"])
    return "; ".join(" ".join(u for u in group if u.isascii()) for group in groups)


def degrees(unit: str, what: str = "an angle") -> float:
    """Degrees per ``unit``.

    Raises
    ------
    CriterionError
    """
    return _scale(unit, _ANGLE_DEG, what)


def convert(
    number: float, unit: str, dimension: str, what: str, length_unit: str, flux_unit: str
) -> float:
    """A number with unit in the units of a map: nm, scene units, degrees, ps, flux units.

    Without a unit the number is taken to be in the unit of the map already.

    Parameters
    ----------
    dimension : "wavelength", "length", "angle", "time", "flux", or "" of plain numbers
    what : is measured, for messages
    """
    if not unit:
        return number
    if dimension == "wavelength":
        return number * _scale(unit, _WAVELENGTH_NM, what or "a wavelength")
    if dimension == "length":
        return number * length_factor(unit, length_unit)
    if dimension == "angle":
        return number * degrees(unit, what or "an angle")
    if dimension == "time":
        return number * _scale(unit, _TIME_PS, what or "a time")
    if dimension == "flux":
        return number * _scale(unit, _FLUX[flux_unit], what or "the flux of this map")
    raise CriterionError(f"{what} is a plain number and takes no unit, found {unit!r}")
