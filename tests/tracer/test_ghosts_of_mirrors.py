"""Ghosts of a plate behind folding mirrors: mirrors do not count, the plate's reflections add up.

The flux of each ghost is a term of the geometric series of a plate: r at the front, (1 - r)² r^k
after k reflections inside, times the reflectance of the mirrors.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from raymap import Surface
from raymap.model.errors import CriterionError
from tracer.run.recording import record
from tracer.scene.load import parse_scene

SCENE = """
length_unit = "mm"
[media.germanium]
index = 4
[surfaces.silver]
kind = "mirror"
reflectance = 0.9
[surfaces.total]
kind = "dielectric"
reflectance = 1
[bodies.primary]
kind = "disc"
outer = 5
position = [0, 0, 20]
rotation = [45, 0, 0]
surface = "silver"
[bodies.secondary]
kind = "disc"
outer = 5
position = [0, 20, 20]
rotation = [45, 0, 0]
surface = "total"
[bodies.window]
kind = "box"
size = [20, 20, 2]
position = [0, 20, 40]
medium = "germanium"
[detectors.sensor]
position = [0, 20, 60]
looks = [0, 0, -1]
size = [10, 10]
cells = [5, 5]
blocking = true
[sources.sun]
kind = "collimated"
direction = [0, 0, 1]
diameter = 1
"""
RAYS = 100_000
R = 0.36


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mirrors") / "telescope.raymap"
    record(parse_scene(SCENE), path, rays=RAYS, seed=3)
    return path


@pytest.mark.parametrize(
    ("reflections", "faces", "share"),
    [
        (2, ("window.z_max", "window.z_min"), 0.9 * (1 - R) ** 2 * R**2),
        (4, ("window.z_max", "window.z_min") * 2, 0.9 * (1 - R) ** 2 * R**4),
    ],
)
def test_ghosts_behind_mirrors(
    path: Path, reflections: int, faces: tuple[str, ...], share: float
) -> None:
    with raymap.open(path) as telescope:
        table = query.ghost_table(telescope, "sensor", reflections=reflections)
        assert table.faces == (faces,)
        assert table.total == pytest.approx(share, abs=4.5 * table.flux_se[0])
        assert table.flux_se[0] == pytest.approx((share * (1 - share) / RAYS) ** 0.5, rel=0.1)
        again = query.select(telescope, table.criterion(0) + ' & detected("sensor")')
        assert again.matched == table.rays[0]


def test_light_that_turns_back_once(path: Path) -> None:
    with raymap.open(path) as telescope:
        table = query.ghost_table(telescope, reflections=1)
        found = dict(zip(table.faces, table.flux, strict=True))
        assert set(found) == {("window.z_min",), ("window.z_max",)}
        assert found["window.z_min",] == pytest.approx(0.9 * R, abs=0.01)
        assert found["window.z_max",] == pytest.approx(0.9 * (1 - R) ** 2 * R, abs=0.01)
        with pytest.raises(CriterionError, match="1 or more reflections, not 0"):
            query.ghost_table(telescope, reflections=0)


def test_the_command_says_ghosts_or_why_there_are_none(path: Path, run: Any) -> None:
    code, out, _ = run("ghosts", path, "sensor")
    assert code == 0
    assert "two-reflection ghosts" in out
    assert "window.z_max" in out
    code, out, _ = run("ghosts", path, "sensor", "--reflections", "3")
    assert code == 0
    assert out.startswith("no ghosts: no ray of the selection was reflected exactly 3 times at ")
    assert "other numbers of reflections: 2 (rays: " in out
    code, out, _ = run("ghosts", path, "sensor", "--reflections", "4", "--json")
    said = json.loads(out)
    assert [row["faces"] for row in said["rows"]] == [["window.z_max", "window.z_min"] * 2]
    assert said["rows"][0]["share"] == 1.0


@pytest.mark.parametrize(
    ("surface", "transmits"),
    [
        (Surface(name="a", kind="mirror"), False),
        (Surface(name="a", kind="dielectric"), True),
        (Surface(name="a", kind="dielectric", parameters={"reflectance": 1}), False),
        (Surface(name="a", kind="dielectric", parameters={"reflectance": 0.995}), True),
        (
            Surface(name="a", kind="dielectric", parameters={"reflectance": {"rgb": [1, 1, 1]}}),
            False,
        ),
        (
            Surface(name="a", kind="dielectric", parameters={"reflectance": {"rgb": [1, 1, 0]}}),
            True,
        ),
        (Surface(name="a", kind="lambertian", parameters={"reflectance": 0.5}), False),
        (Surface(name="a", kind="lambertian", parameters={"transmittance": 0.5}), True),
        (Surface(name="a", kind="MIRROR of another tracer"), True),
        (Surface(name="a", kind="other", parameters={"transmits": 0}), False),
    ],
)
def test_surfaces_know_whether_light_passes(surface: Surface, transmits: bool) -> None:
    assert surface.transmits is transmits
