"""Charts of detectors: their numbers against closed forms and the map, what they refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from query import detector_image
from query.answers.images.beams import beam_of, full_angle
from query.answers.images.readings import readings
from raymap import RayMap, RayMapError
from raymap.cli import application
from tests.far_fields import far_field
from viewer import chart


@pytest.mark.parametrize("power", [1.0, 3.0, 40.0])
@pytest.mark.parametrize("share", [0.5, 0.1])
def test_the_beam_of_a_power_of_the_cosine(power: float, share: float) -> None:
    gamma = np.linspace(-90, 90, 721)
    angle = full_angle(gamma, np.cos(np.radians(gamma)) ** power, share)
    assert angle == pytest.approx(2 * np.degrees(np.arccos(share ** (1 / power))), abs=0.02)


def test_a_curve_that_does_not_fall_has_no_angle() -> None:
    gamma = np.linspace(-40, 40, 81)
    assert full_angle(gamma, np.cos(np.radians(gamma)), 0.5) is None
    assert full_angle(gamma, np.zeros(81), 0.5) is None
    everywhere = np.linspace(-180, 180, 361)
    assert full_angle(everywhere, 1 - np.cos(np.radians(everywhere)), 0.5) is None


def test_planes_of_a_beam_that_is_wide_across_and_narrow_along() -> None:
    image = far_field(lambda g, c: np.cos(g) ** np.where(np.abs(np.cos(c)) > 0.7, 2, 30), (24, 180))
    wide, narrow = beam_of(image, "candela").planes
    assert (wide.name, narrow.name) == ("C0–C180", "C90–C270")
    assert wide.beam_deg is not None
    assert narrow.beam_deg is not None
    assert wide.beam_deg[0] == pytest.approx(90.0, abs=0.2)
    assert narrow.beam_deg[0] == pytest.approx(2 * np.degrees(np.arccos(0.5 ** (1 / 30))), abs=0.2)
    assert wide.gamma_deg.tolist() == (-wide.gamma_deg[::-1]).tolist()


def test_the_mean_is_weighed_by_the_size_of_cells() -> None:
    image = far_field(lambda g, c: np.cos(g) + 0 * c, (1, 90))
    numbers = readings(image, "candela")
    # A Lambertian emitter of intensity 1 has the flux π in 2π sr
    assert numbers["mean"] == pytest.approx(0.5, rel=1e-3)
    assert numbers["flux"] == pytest.approx(np.pi, rel=1e-3)
    assert numbers["planes"][0]["beam_deg"] == pytest.approx(120, abs=0.02)


def test_numbers_of_a_chart_are_those_of_the_picture(small_map: RayMap, tmp_path: Path) -> None:
    target = tmp_path / "chart.svg"
    criterion = 'hit("L1", reflected)'
    numbers = chart(small_map, "sensor", criterion, out=target, bin=2, log=True)
    image = detector_image(small_map, "sensor", criterion, bin=2)
    density = image.density()
    assert numbers["flux"] == pytest.approx(image.total)
    # The brightest cell is bright by chance, too
    assert density.mean() < numbers["peak"] <= density.max()
    assert numbers["peak_se"] > 0.0
    assert numbers["mean"] == pytest.approx(density.mean())
    assert 0.0 <= numbers["min_over_max"] <= numbers["min_over_mean"]
    assert numbers["unit"] == "W/m²"
    assert b"<svg" in target.read_bytes()[:600]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"out": "chart.jpg"}, r"charts end in \.png, \.pdf, \.svg, not 'chart\.jpg'"),
        ({"colors": "jet"}, "no colour map 'jet'; there are inferno"),
        ({"low": 2.0, "high": 1.0}, "the scale must go up"),
        ({"at": (10.0, 0.0)}, r"beside the detector: u goes from -9 to 9, v from -6 to 6 mm"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    small_map: RayMap, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    target = tmp_path / str(options.pop("out", "chart.png"))
    with pytest.raises(RayMapError, match=message):
        chart(small_map, "sensor", out=target, **options)
    assert not target.exists()


def test_the_command_draws_and_prints(map_path: Path, tmp_path: Path) -> None:
    target = tmp_path / "chart.png"
    command = ["chart", str(map_path), "sensor", "-o", str(target), "--at", "1", "-2"]
    done = CliRunner().invoke(application(), command)
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[0] == f"wrote {target}"
    assert "peak" in done.output
    done = CliRunner().invoke(application(), [*command, "--json"])
    assert json.loads(done.output)["unit"] == "W/m²"
    assert target.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
