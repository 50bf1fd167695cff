"""Parameters of detectors from which readers compute: what each must be, if it is there.

Whoever reads them need not ask again whether an angle is a number. Other parameters are carried
along as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["check_cells", "is_length"]

_SMALLEST, _LARGEST = 1e-30, 1e30
"""Of lengths: their squares and what is divided by these are numbers."""

_MOST_CORNERS, _MOST_COEFFICIENTS = 1024, 32
_STEEPEST = 1e9
"""Of slopes, and of what their roots are taken of."""


def is_length(value: Any) -> bool:
    """A number above 0 of which squares and reciprocals are numbers."""
    return _is_number(value) and _SMALLEST <= value <= _LARGEST


def check_cells(cells: tuple[int, int], parameters: Mapping[str, Any]) -> None:
    """Refuse parameters that are not what the format's page says.

    Raises
    ------
    ValueError
    """
    for name, (is_sound, words) in _FORMS.items():
        if name in parameters and not is_sound(parameters[name]):
            raise ValueError(f"its parameter {name} is no {words}")
    areas = parameters.get("cell_area")
    fitting = 1, cells[1], cells[0] * cells[1]
    if isinstance(areas, list | tuple) and len(areas) not in fitting:
        raise ValueError(f"its cell_area has {len(areas)} numbers for {cells[0]} x {cells[1]}")


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= _LARGEST and math.isfinite(value)


def _is_size(value: Any) -> bool:
    return _is_number(value) and (value == 0 or value >= _SMALLEST)


def _is_pair(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) == 2 and all(map(_is_number, value))


def _is_range(value: Any) -> bool:
    return _is_pair(value) and bool(0.0 <= value[0] < value[1] <= 180.0)


def _are_areas(value: Any) -> bool:
    return all(map(_is_size, value)) if isinstance(value, list | tuple) else _is_size(value)


def _is_law(value: Any) -> bool:
    """A face as `raymap.optics.seenfaces` reads it, of slopes that are numbers."""
    if not isinstance(value, Mapping):
        return False
    if value.get("kind") == "polygon":
        corners = value.get("corners")
        return (
            isinstance(corners, list | tuple)
            and 3 <= len(corners) <= _MOST_CORNERS
            and all(map(_is_pair, corners))
        )
    outer: Any = value.get("outer")
    inner: Any = value.get("inner", 0.0)
    aspheric = value.get("aspheric", ())
    if value.get("kind") != "revolution" or not is_length(outer) or not _is_size(inner):
        return False
    if not isinstance(aspheric, list | tuple) or len(aspheric) > _MOST_COEFFICIENTS:
        return False
    numbers = (value.get("curvature", 0.0), value.get("conic", 0.0), *aspheric)
    if not all(map(_is_number, numbers)) or not inner < outer:
        return False
    slopes = [numbers[0] * outer, numbers[1], numbers[1] * (numbers[0] * outer) ** 2]
    try:
        slopes += [a * outer ** (3 + 2 * power) for power, a in enumerate(aspheric)]
    except OverflowError:
        return False
    return all(abs(slope) <= _STEEPEST for slope in slopes)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


_FORMS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "gamma_deg": (_is_range, "two angles that rise from 0 to 180"),
    "half_field": (lambda value: _is_pair(value) and min(value) >= _SMALLEST, "two tangents"),
    "aperture_diameter": (_is_size, "length"),
    "focus_distance": (is_length, "length"),
    "cell_area": (_are_areas, "areas"),
    "area_law": (_is_law, "law of a face"),
    "size_unit": (_is_text, "text"),
    "mapping": (_is_text, "text"),
    "lens": (_is_text, "text"),
    "angles": (_is_text, "text"),
}
