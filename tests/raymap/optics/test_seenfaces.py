"""Areas of cells of faces against closed forms."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap.model.directory import Detector
from raymap.optics.cells import cell_measure
from tests.examples import examples


def _sizes(law: dict[str, Any], side: float, cells: tuple[int, int]) -> Any:
    detector = Detector(
        name="face",
        kind="surface",
        cells=cells,
        size=(side, side),
        parameters={"area_law": law},
    )
    measure = cell_measure(detector, "m")
    assert measure is not None
    return measure.sizes


def _quarter(x: float, y: float, r: float) -> float:
    """Area of a disc of radius r about the origin within [0, x] x [0, y]."""
    if x * x + y * y <= r * r:
        return x * y
    start = math.sqrt(r * r - y * y) if y < r else 0.0
    end = min(x, r)

    def below(t: float) -> float:
        return 0.5 * (t * math.sqrt(max(r * r - t * t, 0.0)) + r * r * math.asin(min(t / r, 1.0)))

    return start * min(y, r) + below(end) - below(start)


def _disc_over(x: tuple[float, float], y: tuple[float, float], r: float) -> float:
    """The same over any rectangle."""

    def to(a: float, b: float) -> float:
        return math.copysign(1.0, a) * math.copysign(1.0, b) * _quarter(abs(a), abs(b), r)

    return to(x[1], y[1]) - to(x[0], y[1]) - to(x[1], y[0]) + to(x[0], y[0])


@pytest.mark.parametrize("cells", [(1, 1), (3, 5), (40, 40), (101, 64)])
def test_each_cell_of_a_ring_has_the_area_that_circles_leave_it(cells):
    outer, inner = 1.3, 0.45
    sizes = _sizes({"kind": "revolution", "inner": inner, "outer": outer}, 2 * outer, cells)
    x, y = ((np.arange(n + 1) / n - 0.5) * 2 * outer for n in cells)
    expected = [
        [
            _disc_over((a, b), (c, d), outer) - _disc_over((a, b), (c, d), inner)
            for a, b in itertools.pairwise(x)
        ]
        for c, d in itertools.pairwise(y)
    ]
    found = sizes.part(*map(range, sizes.shape))
    assert np.abs(found - expected).max() < 2e-3 * found.max()
    assert found.sum() == pytest.approx(math.pi * (outer**2 - inner**2), rel=1e-4)


_TOTALS = [
    # A sphere's cap 2 π R h, one of a hemisphere included
    ({"curvature": 0.5, "outer": 1.2}, 2 * math.pi * 2.0 * (2.0 - math.sqrt(4.0 - 1.44)), 1e-6),
    ({"curvature": 1.0, "outer": 1.0}, 2 * math.pi, 2e-3),
    # A paraboloid z = c r² / 2: 2 π / (3 c²) ((1 + c² r²)^1.5 - 1)
    (
        {"curvature": 0.8, "conic": -1.0, "outer": 1.5},
        2 * math.pi / (3 * 0.64) * ((1 + 0.64 * 2.25) ** 1.5 - 1),
        1e-6,
    ),
    # z = a r^4, a = 0.3: 2 π ∫ r sqrt(1 + 16 a² r^6) dr by 10^6 points
    ({"aspheric": [0.3], "outer": 1.1}, None, 1e-6),
]


@pytest.mark.parametrize(("law", "area", "error"), _TOTALS)
@pytest.mark.parametrize("cells", [(30, 30), (4000, 4000), (65535, 40000)])
def test_all_cells_have_the_area_of_the_face(law, area, error, cells):
    outer = law["outer"]
    if area is None:
        r = (np.arange(10**6) + 0.5) / 10**6 * outer
        area = float((2 * np.pi * r * np.sqrt(1 + 16 * 0.09 * r**6)).mean() * outer)
    sizes = _sizes({"kind": "revolution"} | law, 2 * outer, cells)
    assert sizes.total() == pytest.approx(area, rel=error)


def test_a_triangle_and_a_trapezoid_leave_cells_what_is_inside():
    corners = [[-1.0, -1.0], [1.0, -1.0], [0.2, 1.0], [-0.4, 1.0]]
    sizes = _sizes({"kind": "polygon", "corners": corners}, 2.0, (2, 2))
    found = sizes.part(range(2), range(2))
    # Below v = 0 from -1 and -0.7 to 0, above from -0.7 and -0.4; on the right 1, 0.6 and 0.2
    assert np.allclose(found, [[0.85, 0.8], [0.55, 0.4]], rtol=1e-3)
    assert _sizes({"kind": "polygon", "corners": corners}, 2.0, (1000, 1000)).total() == (
        pytest.approx(2.6, rel=1e-5)
    )


@settings(max_examples=examples(40))
@given(
    cells=st.tuples(st.integers(1, 600), st.integers(1, 600)),
    side=st.integers(1, 64),
    curvature=st.floats(-0.9, 0.9),
    inner=st.just(0.0) | st.floats(0.01, 0.9),
)
def test_blocks_are_the_sums_of_their_cells(cells, side, curvature, inner):
    law = {"kind": "revolution", "inner": inner, "outer": 1.0, "curvature": curvature}
    sizes = _sizes(law, 2.0, cells)
    dense = sizes.part(*map(range, sizes.shape))
    expected = np.add.reduceat(dense, np.arange(0, cells[1], side), axis=0)
    expected = np.add.reduceat(expected, np.arange(0, cells[0], side), axis=1)
    blocks = sizes.joined(side)
    found = blocks.part(*map(range, blocks.shape))
    assert np.abs(found - expected).max() < 5e-3 * found.max()
    rows, columns = np.nonzero(found)
    assert np.array_equal(blocks.at(rows, columns), found[rows, columns])
    assert sizes.total() == pytest.approx(dense.sum(), rel=2e-3)


@pytest.mark.parametrize(
    "law",
    [
        "flat",
        {},
        {"kind": "revolution"},
        {"kind": "revolution", "outer": 0.0},
        {"kind": "revolution", "outer": 1.0, "inner": 1.0},
        {"kind": "revolution", "outer": 1.0, "curvature": float("nan")},
        {"kind": "revolution", "outer": 1e30, "curvature": 1.0},
        {"kind": "revolution", "outer": 1.0, "aspheric": 3},
        {"kind": "revolution", "outer": 1e30, "aspheric": [1.0] * 32},
        {"kind": "polygon", "corners": [[0.0, 1.0], [1.0, 1.0]]},
        {"kind": "polygon", "corners": [[0.0, 1.0], [1.0, 1.0], [1.0]]},
    ],
)
def test_laws_that_give_no_areas_are_refused(law):
    with pytest.raises(ValueError, match="area_law is no law of a face"):
        _sizes(law, 2.0, (2, 2))
