"""Units of length against each other, and units that nobody knows."""

from __future__ import annotations

import pytest

from raymap.model.errors import RayMapError
from raymap.model.units import METRES, length_scale


def test_units_convert_as_defined() -> None:
    # The international inch and foot (1959)
    assert length_scale("in", "mm") == pytest.approx(25.4, rel=1e-15)
    assert length_scale("ft", "in") == pytest.approx(12.0, rel=1e-15)
    assert length_scale("um", "nm") == length_scale("µm", "nm") == pytest.approx(1000.0)


@pytest.mark.parametrize("unit", METRES)
def test_there_and_back_is_one(unit: str) -> None:
    assert length_scale(unit, "mm") * length_scale("mm", unit) == pytest.approx(1.0, rel=1e-15)


def test_unknown_units_are_refused_unless_they_are_the_same() -> None:
    assert length_scale("parsec", "parsec") == 1.0
    for pair in (("parsec", "mm"), ("mm", "parsec")):
        with pytest.raises(RayMapError, match="unknown unit of length 'parsec'"):
            length_scale(*pair)
