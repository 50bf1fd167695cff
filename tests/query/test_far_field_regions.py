"""Degrees in a region of a far field are C and gamma, as charts and tables say them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from query.bind import Binder
from query.conditions import Region
from raymap import Detector


@pytest.mark.parametrize(
    ("gamma", "region", "cells"),
    [
        # 90 rows over 180°: 2° a row; 72 columns: 5° a column
        ((0.0, 180.0), Region("rect", (0.0, 20.0, 360.0, 40.0), "deg"), (0.0, 10.0, 72.0, 20.0)),
        ((0.0, 90.0), Region("rect", (90.0, 0.0, 180.0, 9.0), "deg"), (18.0, 0.0, 36.0, 9.0)),
        ((10.0, 100.0), Region("rect", (0.0, 10.0, 5.0, 12.0), "deg"), (0.0, 0.0, 1.0, 2.0)),
        ((0.0, 180.0), Region("ellipse", (180.0, 60.0, 10.0, 4.0), "deg"), (36.0, 30.0, 2.0, 2.0)),
        (
            (10.0, 190.0),
            Region("ellipse", (0.0, 0.5235987756, 1.0, 1.0), "rad"),
            (0.0, 10.0, 11.459156, 28.64789),
        ),
    ],
)
def test_degrees_are_c_and_gamma(
    gamma: tuple[float, float], region: Region, cells: tuple[float, ...]
) -> None:
    detector = Detector(
        name="far",
        kind="far_field",
        cells=(72, 90),
        size=(360.0, gamma[1] - gamma[0]),
        parameters={"gamma_deg": gamma, "size_unit": "deg"},
    )
    binder = cast(
        Any, SimpleNamespace(_region_scale=lambda *args: Binder._region_scale(binder, *args))
    )
    bound = Binder._region(binder, region, detector)
    assert bound.numbers == pytest.approx(cells, rel=1e-6)
