"""Which lenses can exist, and what the refusals say."""

from __future__ import annotations

import math

import pytest

from tests.tracer.lens.lenses import biconvex
from tracer.lens import Lens, LensError
from tracer.lens.shape import lens_shape, sag


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"thickness": 2.0}, "thickness"),  # negative edge
        ({"thickness": 0.0}, "thickness"),
        ({"thickness": -1.0}, "thickness"),
        ({"thickness": math.nan}, "thickness"),
        ({"radius_front": 10.0}, "semi_aperture_front"),
        ({"radius_back": 0.0}, "radius_back"),
        ({"radius_front": math.nan}, "radius_front"),
        ({"semi_aperture_front": 0.0}, "semi_aperture_front"),
        ({"semi_aperture_back": -3.0}, "semi_aperture_back"),
        ({"glass": -1.5}, "glass"),
        ({"outside": math.inf}, "outside"),
        ({"axis": (0.0, 0.0, 0.0)}, "axis"),
        ({"origin": (0.0, math.nan, 0.0)}, "origin"),
    ],
)
def test_impossible_lenses_are_refused_by_field(changes: dict[str, object], named: str) -> None:
    with pytest.raises(LensError, match=named):
        biconvex(**changes)


def test_caps_that_cross_inside_a_smaller_aperture_are_refused() -> None:
    # A strong meniscus whose front cap overtakes the back cap at 8 mm
    with pytest.raises(LensError, match=r"thickness.*cross"):
        Lens(
            radius_front=10.0,
            radius_back=12.0,
            thickness=0.5,
            semi_aperture_front=8.0,
            semi_aperture_back=11.5,
            glass=1.5,
        )


def test_a_conical_rim_through_a_cap_is_refused() -> None:
    with pytest.raises(LensError, match=r"semi_aperture_front.*rim"):
        Lens(
            radius_front=-10.0,
            radius_back=math.inf,
            thickness=1.0,
            semi_aperture_front=10.0,
            semi_aperture_back=5.0,
            glass=1.5,
        )


def test_limits_that_are_allowed() -> None:
    # A ball lens: two hemispheres whose edge has no thickness
    ball = lens_shape(
        radius_front=5.0,
        radius_back=-5.0,
        thickness=10.0,
        semi_aperture_front=5.0,
        semi_aperture_back=5.0,
    )
    assert ball.edge_front == pytest.approx(ball.edge_back)
    # A meniscus thinner than its sag
    lens_shape(
        radius_front=50.0,
        radius_back=49.0,
        thickness=0.1,
        semi_aperture_front=12.0,
        semi_aperture_back=12.0,
    )


def test_sag_is_the_sphere() -> None:
    assert sag(1.0 / 50.0, 12.5) == pytest.approx(50.0 - math.sqrt(50.0**2 - 12.5**2), rel=1e-14)
    assert sag(1.0 / 50.0, 12.5) == pytest.approx(1.587708, abs=5e-7)
    assert sag(-1.0 / 5.0, 5.0) == -5.0
    assert sag(0.0, 7.0) == 0.0


def test_paraxial_data() -> None:
    lens = biconvex()
    assert lens.focal_length(587.5618) == pytest.approx(49.384172328, abs=5e-8)
    assert lens.back_focal_length(587.5618) == pytest.approx(47.365047219, abs=5e-8)
