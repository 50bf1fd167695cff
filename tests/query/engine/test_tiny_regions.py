"""Regions as small and as large as numbers go."""

from __future__ import annotations

import numpy as np
import pytest

from query.engine.regions import BoundRegion
from raymap.model.schema import UV_SCALE


@pytest.mark.parametrize(
    ("numbers", "inside"),
    [
        ((2.0, 2.0, 1e-320, 1e-320), [True, False]),
        ((2.0, 2.0, 1e-200, 1e200), [True, False]),
        ((2.0, 2.0, 1e200, 1e200), [True, True]),
        ((1e308, 1e308, 1e-300, 1e-300), [False, False]),
    ],
)
def test_ellipses_of_any_size(numbers, inside):
    """Its own centre, and a place one cell beside it."""
    places = np.array([[2.0, 2.0], [3.0, 2.0]]) / 4.0 * UV_SCALE
    region = BoundRegion(shape="ellipse", numbers=numbers, cells=(4, 4))
    assert region.holds(places).tolist() == inside
