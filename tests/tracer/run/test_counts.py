"""Fluxes that a trace counts itself: those that criteria find among the recorded rays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import raymap
from query import detector_image, select
from tests.tracer.transport.tracing import compiled
from tracer.run.recording import record
from tracer.run.results import RecordResult
from tracer.transport.tally import CLASSES

SCENE = """
[media.glass]
index = 1.5
absorption = 0.05
[surfaces.white]
kind = "lambertian"
reflectance = 0.6
transmittance = { rgb = [0.1, 0.2, 0.3] }
[bodies.plate]
kind = "box"
size = [6, 6, 1]
medium = "glass"
[bodies.sheet]
kind = "rectangle"
size = [8, 8]
position = [0, 0, 2]
surface = "white"
[sources.bright]
kind = "lambertian"
position = [0, 0, -3]
diameter = 2
flux = 90
share = 1
[sources.faint]
kind = "collimated"
position = [0, 0, -3]
direction = [0.2, 0, 1]
diameter = 1
flux = 10
share = 3
[detectors.wall]
position = [0, 0, 4]
looks = [0, 0, -1]
size = [12, 12]
cells = [3, 2]
blocking = true
[detectors.window]
position = [0, 0, -1]
looks = [0, 0, -1]
both_sides = true
size = [5, 5]
cells = [2, 2]
"""

SPLIT = '\n[trace]\nmode = "weighted"\nsplit_depth = 2\nmin_reflection = 0.1'

MODES = {"analog": "", "split": SPLIT}


def recorded(mode: str, path: Path) -> RecordResult:
    return record(compiled(SCENE + MODES[mode]), path, rays=6_000, threads=2, portion_rays=1_000)


@pytest.mark.parametrize("mode", MODES)
def test_fluxes_are_those_of_the_recorded_rays(mode: str, tmp_path: Path) -> None:
    result = recorded(mode, tmp_path / "a.raymap")
    assert result.audit["faint"]["emitted"] == 3 * result.audit["bright"]["emitted"]
    with raymap.open(tmp_path / "a.raymap") as found:
        wall = select(found, 'detected("wall")')
        assert result.fluxes["detectors"]["wall"]["flux"] == pytest.approx(wall.flux, rel=1e-6)
        assert result.fluxes["detectors"]["wall"]["flux_se"] == pytest.approx(
            wall.flux_se, rel=1e-6
        )
        for name, objects in result.fluxes["absorbed_by"]["objects"].items():
            ended = select(found, f'last(hit("{name}", absorbed))')
            assert objects["flux"] == pytest.approx(ended.flux, rel=1e-6)
            assert objects["flux_se"] == pytest.approx(ended.flux_se, rel=1e-6)
        for source, row in result.fluxes["sources"].items():
            assert row["emitted"] == {"bright": 90.0, "faint": 10.0}[source]
            total = sum(row[c]["flux"] for c in CLASSES)
            assert total == pytest.approx(row["emitted"], rel=1e-6 if mode == "analog" else 2e-3)
            seen = select(found, f'source("{source}") & last(hit("wall"))')
            assert row["detected"]["flux"] == pytest.approx(seen.flux, rel=1e-6)
            assert row["detected"]["flux_se"] == pytest.approx(seen.flux_se, rel=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_pictures_are_those_of_the_recorded_rays(mode: str, tmp_path: Path) -> None:
    result = recorded(mode, tmp_path / "a.raymap")
    with raymap.open(tmp_path / "a.raymap") as found:
        emitted = float(found.emitted.min())
        for name, count in result.detectors.items():
            image = detector_image(found, name)
            np.testing.assert_allclose(count.channels, image.channels, rtol=1e-6)
            np.testing.assert_allclose(count.flux, image.flux, rtol=1e-6)
            # A picture leaves out that a cell cannot be met more often than rays are sent
            assert np.all(count.flux_se <= image.flux_se * (1.0 + 1e-6))
            least = image.variance - image.flux**2 / emitted
            assert np.all(count.flux_se**2 >= least * (1.0 - 1e-6))
            stored = found.detector_result(name)
            assert stored is not None
            sums, sums2 = stored
            np.testing.assert_allclose(sums, count.sums, rtol=1e-12)
            np.testing.assert_allclose(sums2, count.sums2, rtol=1e-12)


def test_standard_errors_are_the_scatter_of_repeated_traces() -> None:
    # One emission brings several rays to the same cell: taken as independent they would seem surer
    scene = compiled(SCENE + SPLIT)
    runs = [record(scene, rays=2_048, seed=k, no_rays=True, threads=1) for k in range(40)]
    for name in ("wall", "window"):
        fluxes = np.array([run.detectors[name].flux for run in runs])
        said = np.array([run.detectors[name].flux_se ** 2 for run in runs]).mean(axis=0)
        ratio = fluxes.var(axis=0, ddof=1) / said
        # Each ratio is χ²/39 about: sqrt(2/39) = 0.23
        assert np.all((ratio > 0.3) & (ratio < 2.1)), ratio
        totals = np.array([run.detectors[name].total for run in runs])
        said_total = np.mean([run.detectors[name].total_se ** 2 for run in runs])
        assert 0.3 < totals.var(ddof=1) / said_total < 2.1


def test_parts_of_a_trace_add_up(tmp_path: Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    scene = compiled(SCENE)
    whole = record(scene, rays=8_192, no_rays=True)
    with ThreadPoolExecutor(2) as pool:
        again = record(scene, rays=8_192, no_rays=True, executor=pool)
    for name, row in whole.fluxes["detectors"].items():
        other = again.fluxes["detectors"][name]
        assert other.pop("doubtful") == row.pop("doubtful")
        assert other == pytest.approx(row, rel=1e-12)
    parts = [record(scene, rays=4_096, seed=s, no_rays=True).counts for s in (1, 2)]
    both = (parts[0] + parts[1]).fluxes()
    for name, row in both["detectors"].items():
        own = [part.fluxes()["detectors"][name] for part in parts]
        assert row["flux"] == pytest.approx((own[0]["flux"] + own[1]["flux"]) / 2)
        assert row["flux_se"] == pytest.approx(
            np.hypot(own[0]["flux_se"], own[1]["flux_se"]) / 2, rel=0.05
        )
