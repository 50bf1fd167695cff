"""Degrees in regions: C and gamma of a far field, as charts say them; field angles of a camera."""

from __future__ import annotations

import math

import numpy as np
import pytest

from query.atoms.detected import Detected
from query.engine.bind import MapFacts, bind
from query.engine.regions import BoundRegion, bind_region
from query.expression.arguments import Region
from query.expression.grammar import parse
from raymap import Detector, Directory, Source
from raymap.model.errors import CriterionError


def in_cells(detector: Detector, region: Region) -> BoundRegion:
    return bind_region(region, detector, "mm")


@pytest.mark.parametrize(
    ("gamma", "region", "cells"),
    [
        # 90 rows over 180°: 2° a row; 72 columns: 5° a column
        ((0.0, 180.0), Region("rect", (0.0, 20.0, 360.0, 40.0), "deg"), (0.0, 10.0, 72.0, 20.0)),
        ((0.0, 90.0), Region("rect", (90.0, 0.0, 180.0, 9.0), "deg"), (18.0, 0.0, 36.0, 9.0)),
        ((10.0, 100.0), Region("rect", (0.0, 10.0, 5.0, 12.0), "deg"), (0.0, 0.0, 1.0, 2.0)),
        ((0.0, 180.0), Region("ellipse", (180.0, 60.0, 10.0, 4.0), "deg"), (36.0, 30.0, 2.0, 2.0)),
        (
            (10.0, 100.0),
            Region("ellipse", (0.0, 0.5235987756, 1.0, 1.0), "rad"),
            (0.0, 20.0, 11.459156, 57.29578),
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
    assert in_cells(detector, region).numbers == pytest.approx(cells, rel=1e-6)


CAMERA = Detector(
    name="cam",
    kind="camera",
    cells=(200, 100),
    size=(2 * math.tan(math.radians(40)), math.tan(math.radians(40))),
    parameters={
        "half_field": (math.tan(math.radians(40)), math.tan(math.radians(40)) / 2),
        "size_unit": "tangent",
    },
)


def test_degrees_are_field_angles_of_a_camera() -> None:
    # 40° lies at the border, 0° in the middle, 20° at tan 20° / tan 40° of the way
    region = in_cells(CAMERA, Region("rect", (-40.0, 0.0, 20.0, 20.0), "deg"))
    share = math.tan(math.radians(20)) / math.tan(math.radians(40))
    expected = (0.0, 50.0, 100.0 + 100.0 * share, 50.0 + 100.0 * share)
    assert region.numbers == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('detected("cam", ellipse(0 deg, 0 deg, 5 deg, 5 deg))', "write cells"),
        ('detected("cam", rect(0 deg, 0 deg, 90 deg, 5 deg))', "less than 90°"),
        ('detected("cam", rect(0 mm, 0 mm, 1 mm, 1 mm))', "tangent"),
    ],
)
def test_what_a_camera_does_not_have_is_refused(text: str, said: str) -> None:
    directory = Directory(sources=(Source(name="lamp", flux=1.0),), detectors=(CAMERA,))
    facts = MapFacts(directory=directory, emitted=np.ones(1, np.int64))
    node = parse(text)
    assert isinstance(node, Detected)
    with pytest.raises(CriterionError, match=said) as caught:
        bind(node, facts, text)
    # The place in the criterion
    assert "^" in str(caught.value)
