"""Criteria and reports over the columns of polarised traces."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from query import angle_of_polarisation, degree_of_polarisation, hit, optical_path, report, select
from query.cli.terminal import print_report
from query.engine.recorded import ellipse_of
from raymap.model.errors import CriterionError
from tests.query.random_maps import write_random_map


@pytest.fixture
def maps(tmp_path: Path) -> Any:
    return {
        states: write_random_map(tmp_path / f"{states}.raymap", 5, states=states)
        for states in (True, False)
    }


@pytest.mark.parametrize(
    "criterion",
    [
        degree_of_polarisation >= 0,
        angle_of_polarisation(hit("*")) != "3 deg",
        optical_path < "1 km",
    ],
)
def test_says_why_nothing_matches_without_the_column(maps: Any, criterion: Any) -> None:
    with raymap.open(maps[False]) as map:
        found = select(map, criterion)
        assert found.matched == 0
        assert "has no column" in found.reason
        assert "light = 'polarised'" in found.reason
        # An undefined quantity makes the comparison false, so its opposite holds for all.
        assert select(map, ~criterion).matched == map.rays


def test_the_report_shows_the_state(maps: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with raymap.open(maps[True]) as map:
        whole = map.portions[0].read()
        place = int(np.argmax(whole.records_per_ray))
        ray = report(map, int(map.portions[0].ray_ids()[place]))
        row = int(whole.records_per_ray[:place].sum())
        s1, s2, s3 = (float(x) for x in whole.extra["stokes"][row])
        state = ray["points"][0]["polarisation"]
        assert state["degree"] == pytest.approx(math.sqrt(s1**2 + s2**2 + s3**2))
        assert ray["points"][0]["stokes"] == pytest.approx([s1, s2, s3])
        assert ray["points"][-1]["polarisation"] is None
        number = ray["ray_id"]
    print_report(ray)
    shown = capsys.readouterr().out
    assert f"{state['degree']:.2%}" in shown
    assert "path" in shown
    with raymap.open(maps[False]) as map:
        print_report(report(map, number))
    assert "polarisation" not in capsys.readouterr().out


def test_ellipses() -> None:
    # Right-handed circular, linear at 45 degrees, natural, and an ellipse of axes 2 : 1.
    assert ellipse_of(np.array([0.0, 0.0, 1.0])) == {
        "degree": 1.0,
        "angle_deg": None,
        "axis_ratio": pytest.approx(1.0),
        "handedness": "right",
    }
    assert ellipse_of(np.array([0.0, 1.0, 0.0])) == {
        "degree": 1.0,
        "angle_deg": pytest.approx(45.0),
        "axis_ratio": 0.0,
        "handedness": "linear",
    }
    assert ellipse_of(np.zeros(3))["axis_ratio"] is None
    found = ellipse_of(np.array([-0.6, 0.0, -0.8]))
    assert found["axis_ratio"] == pytest.approx(0.5)
    assert found["handedness"] == "left"
    assert found["angle_deg"] == pytest.approx(90.0)


def test_units_are_those_of_the_quantity(maps: Any) -> None:
    with raymap.open(maps[True]) as map:
        in_rad = select(map, "angle_of_polarisation > 0.5 rad").ray_ids.tolist()
        in_deg = select(map, f"angle_of_polarisation > {math.degrees(0.5)!r}").ray_ids.tolist()
        assert in_rad == in_deg
        assert in_rad
        with pytest.raises(CriterionError, match="takes no unit"):
            select(map, "degree_of_polarisation > 3 mm")
        with pytest.raises(CriterionError, match="angle of polarisation is measured in"):
            select(map, "angle_of_polarisation > 3 mm")
