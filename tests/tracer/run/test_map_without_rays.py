"""Maps of ``record --no-rays``: the detectors' sums without rays, read by what asks for no ray.

Each of two uniform lamps stands in the middle of a cube of which a detector is one face: a sixth of
its light is registered there.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import query
import raymap
from raymap.file.repair import repair
from raymap.file.verify import verify
from raymap.model.errors import NoRays, RayMapError
from tracer.run.recording import record
from tracer.scene.load import parse_scene

SCENE = """
length_unit = "mm"
[sources.red]
kind = "point"
flux = 6
share = {share}
[sources.blue]
kind = "point"
position = [100, 0, 0]
flux = 30
share = 1
[detectors.left]
position = [0, 0, 1]
size = [2, 2]
cells = [4, 4]
looks = [0, 0, -1]
[detectors.right]
position = [100, 0, 1]
size = [2, 2]
cells = [1, 1]
looks = [0, 0, -1]
"""
RAYS = 60_000


def scene(tmp_path: Path, share: float = 3.0) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(share=share), encoding="utf-8")
    return path


@pytest.mark.parametrize("share", [0.2, 3.0])
def test_pictures_are_those_of_the_map_with_rays(tmp_path: Path, share: float) -> None:
    text = SCENE.format(share=share)
    record(parse_scene(text), tmp_path / "rays.raymap", rays=RAYS)
    result = record(parse_scene(text), tmp_path / "sums.raymap", rays=RAYS, no_rays=True)
    with (
        raymap.open(tmp_path / "rays.raymap") as whole,
        raymap.open(tmp_path / "sums.raymap") as sums,
    ):
        assert (sums.rays, whole.rays) == (0, RAYS)
        assert sums.without_rays
        assert not whole.without_rays
        assert 1_000 < result.bytes <= (tmp_path / "sums.raymap").stat().st_size
        for name, flux in (("left", 1.0), ("right", 5.0)):
            picture, own = query.detector_image(whole, name), query.detector_image(sums, name)
            np.testing.assert_allclose(own.channels, picture.channels, rtol=1e-9, atol=1e-15)
            np.testing.assert_allclose(own.flux_se, picture.flux_se, rtol=0.02, atol=1e-12)
            count = result.detectors[name]
            assert own.total == pytest.approx(flux, abs=4.5 * count.total_se)
            assert own.total == pytest.approx(count.total, rel=1e-9)
            assert own.total_se == pytest.approx(count.total_se, rel=1e-9)
            assert picture.total_se == pytest.approx(count.total_se, rel=1e-6)
            # A ray of the lamp is counted or not
            n = sums.emitted[int(flux > 1.0)]
            expected = 6.0 * flux * math.sqrt(1 / 6 * 5 / 6 / n)
            assert own.total_se == pytest.approx(expected, rel=0.05)


def test_all_light_of_a_lamp_is_known_without_error(tmp_path: Path) -> None:
    """Which cell it meets is drawn, that it meets one is not."""
    sky = "[detectors.sky]\nkind = 'far_field'\ncells = [36, 18]\ngamma_deg = [0, 180]\n"
    lamp = "length_unit = 'mm'\nflux_unit = '{}'\n[sources.lamp]\nkind = 'point'\nflux = 10\n"
    for unit, other in (("W", "lm"), ("lm", "W")):
        path = tmp_path / f"{unit}.raymap"
        record(parse_scene(lamp.format(unit) + sky), path, rays=2_000, no_rays=True)
        with raymap.open(path) as sums:
            image = query.detector_image(sums, "sky")
            assert image.total == pytest.approx(10.0)
            assert image.total_se == pytest.approx(0.0, abs=1e-6)
            assert image.total_se_in(other) == pytest.approx(0.0, abs=1e-3)


DARK = """
[sources.dark]
kind = "point"
flux = 30
share = 1
on = false
[detectors.eye]
kind = "pinhole"
position = [100, 0, -30]
looks = [0, 0, 1]
cells = [2, 2]
field_deg = 40
[surfaces.paper]
kind = "lambertian"
reflectance = 0.5
[bodies.sheet]
kind = "rectangle"
position = [100, 0, 1.5]
size = [4, 4]
surface = "paper"
"""


@pytest.mark.parametrize("most_values", [2**24, 0])
def test_a_source_that_is_off_changes_no_flux(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most_values: int
) -> None:
    """A sixth of the light of what is on; also where sources of one kind share their sums."""
    monkeypatch.setattr("tracer.transport.tally._MOST_VALUES", most_values)
    text = SCENE.format(share=1.0) + DARK
    record(parse_scene(text), tmp_path / "rays.raymap", rays=20_000)
    result = record(parse_scene(text), tmp_path / "sums.raymap", rays=20_000, no_rays=True)
    with (
        raymap.open(tmp_path / "rays.raymap") as whole,
        raymap.open(tmp_path / "sums.raymap") as sums,
    ):
        for name, flux in (("left", 1.0), ("right", 5.0)):
            count = result.detectors[name]
            assert count.total == pytest.approx(flux, abs=4.5 * count.total_se)
            assert count.total == pytest.approx(query.detector_image(whole, name).total, rel=1e-6)
            assert count.total == pytest.approx(query.detector_image(sums, name).total, rel=1e-6)
        seen = result.detectors["eye"].total
        assert seen > 0.0
        assert seen == pytest.approx(query.detector_image(whole, "eye").total, rel=1e-6)
        assert seen == pytest.approx(query.detector_image(sums, "eye").total, rel=1e-6)


def test_the_commands_read_it_or_say_that_it_has_no_rays(tmp_path: Path, run: Any) -> None:
    path = tmp_path / "sums.raymap"
    code, out, error = run("record", scene(tmp_path), "-o", path, "--no-rays", "--rays", 2_000)
    assert (code, error) == (0, "")
    assert path.stat().st_size < 30_000
    code, out, _ = run("info", path)
    assert code == 0
    assert "recorded with --no-rays: what detectors counted of 2,000 rays" in out
    code, _, error = run("image", path, "left", "-o", tmp_path / "a.csv")
    assert (code, error) == (0, "")
    code, _, error = run("chart", path, "left", "-o", tmp_path / "a.svg")
    assert (code, error) == (0, "")
    for words in (
        ["query", path, "event(left)"],
        ["paths", path],
        ["report", path, "5"],
        ["ghosts", path],
        ["audit", path],
        ["compare", path, path],
        ["image", path, "left", "event(left)", "-o", tmp_path / "b.csv"],
        ["view", path, "--no-browser"],
        ["picture", path, "-o", tmp_path / "b.png"],
        ["export", path, "-o", tmp_path / "b.csv"],
    ):
        code, out, error = run(*words)
        assert code == 1, words
        [line] = error.splitlines()
        assert "holds no rays, only what its detectors counted" in line
    assert not list(tmp_path.glob("b.*"))


def test_it_is_verified_repaired_and_not_continued(tmp_path: Path) -> None:
    path, again = tmp_path / "sums.raymap", tmp_path / "again.raymap"
    parsed = parse_scene(SCENE.format(share=3.0))
    record(parsed, path, rays=2_000, no_rays=True)
    with raymap.open(path) as sums:
        assert not verify(sums).damage
        repair(sums, again)
        before = query.detector_image(sums, "left")
    with raymap.open(again) as sums:
        np.testing.assert_array_equal(query.detector_image(sums, "left").channels, before.channels)
        with pytest.raises(NoRays):
            sums.find_ray(0)
    stored = path.read_bytes()
    with pytest.raises(RayMapError, match="leave out --append, or --no-rays"):
        record(parsed, path, rays=100, no_rays=True, append=True)
    with pytest.raises(RayMapError, match="recorded with --no-rays and cannot be continued"):
        record(parsed, path, rays=100, append=True)
    with raymap.open(path) as sums:
        assert query.detector_image(sums, "left").total == before.total
    assert stored == path.read_bytes()
    with pytest.raises(RayMapError, match="--force"):
        record(parsed, path, rays=100, no_rays=True)


def test_its_run_says_how_rays_ended(tmp_path: Path, run: Any) -> None:
    path = tmp_path / "sums.raymap"
    run("record", scene(tmp_path), "-o", path, "--no-rays", "--rays", 2_000)
    code, out, _ = run("info", path, "--json")
    assert code == 0
    said = json.loads(out)
    assert (said["rays"], said["without_rays"]) == (0, True)
    audit = said["runs"][0]["statistics"]["audit"]
    assert audit["red"]["left"] + audit["blue"]["left"] == 2_000


def test_a_map_without_objects_has_no_ghosts(tmp_path: Path, run: Any) -> None:
    path = tmp_path / "rays.raymap"
    record(parse_scene(SCENE.format(share=3.0)), path, rays=500)
    code, out, error = run("ghosts", path)
    assert (code, error) == (0, "")
    assert out.startswith("no ghosts: ")
    code, out, _ = run("query", path, 'hit("*")', "--count")
    assert code == 0
    assert out.startswith("0 of 500 rays")
