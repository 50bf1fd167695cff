"""Units of length that maps, scenes and ray files state."""

from __future__ import annotations

from raymap.model.errors import RayMapError

__all__ = ["METRES", "length_scale"]

METRES = {
    "nm": 1e-9,
    "um": 1e-6,
    "µm": 1e-6,
    "mm": 1e-3,
    "cm": 1e-2,
    "m": 1.0,
    "in": 0.0254,
    "ft": 0.3048,
}
"""Metres in a unit of length."""


def length_scale(unit: str, wanted: str) -> float:
    """How many ``wanted`` make one ``unit``; 1 for equal units, whatever they are called.

    Raises
    ------
    RayMapError
        One of the units is not known.
    """
    if unit == wanted:
        return 1.0
    for name in (unit, wanted):
        if name not in METRES:
            raise RayMapError(f"unknown unit of length {name!r}; known are {', '.join(METRES)}")
    return METRES[unit] / METRES[wanted]
