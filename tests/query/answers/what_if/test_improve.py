"""The faces that are best coated, against formulas of plates in a row."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import query
import raymap
from query.answers.what_if import improve as improving
from raymap.cli import application
from raymap.model.errors import RayMapError
from tracer import parse_scene
from tracer.run.recording import record

# Three windows of different glass in a row, met along the axis: six faces
INDICES = (1.5, 1.9, 1.7)
PLATES = "\n".join(
    f"[media.g{k}]\nindex = {n}\n[bodies.P{k}]\nkind = 'box'\nposition = [0, 0, {10 * k}]\n"
    f"size = [40, 40, 4]\nmedium = 'g{k}'\nsurface = 'clear'"
    for k, n in enumerate(INDICES)
)
SCENE = f"""
length_unit = "mm"
flux_unit = "W"
[spectrum]
kind = "spectral"
wavelengths_nm = [550]
[surfaces.clear]
kind = "dielectric"
{PLATES}
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 2
flux = 1.0
[detectors.sensor]
position = [0, 0, 40]
looks = [0, 0, -1]
size = [40, 40]
cells = [2, 2]
"""
GHOSTS = 'count(hit("*", reflected)) == 2 & detected("sensor")'
SIGNAL = 'count(hit("*", reflected)) == 0 & detected("sensor")'
NEW = 0.001
FACES = [f"P{k}.{side}" for k in range(3) for side in ("z_min", "z_max")]


def light(coated: tuple[str, ...]) -> tuple[float, float]:
    """Flux of twice reflected and of direct light behind plane faces, by their reflectances."""
    bare = [((n - 1.0) / (n + 1.0)) ** 2 for n in INDICES for _ in range(2)]
    r = np.array([NEW if name in coated else own for name, own in zip(FACES, bare, strict=True)])
    direct = float(np.prod(1.0 - r))
    twice = sum(
        direct * r[i] * r[j] * float(np.prod((1.0 - r[i + 1 : j]) ** 2))
        for i in range(6)
        for j in range(i + 1, 6)
    )
    return twice, direct


@pytest.fixture(scope="module")
def plates(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    path = tmp_path_factory.mktemp("improve") / "a.raymap"
    record(parse_scene(SCENE), path, rays=60_000, portion_rays=20_000, seed=4)
    with raymap.open(path) as ray_map:
        yield ray_map


@pytest.mark.parametrize("faces", [1, 2, 3])
def test_the_best_combination_is_that_of_the_formula(plates: Any, faces: int) -> None:
    found = query.improve(plates, GHOSTS, reflectance=NEW, faces=faces)
    assert found.exhaustive
    assert set(found.candidates) == set(FACES)
    assert found.tried == sum(len(list(combinations(FACES, k))) for k in range(1, faces + 1))
    best = min(light(each)[0] for each in combinations(FACES, faces))
    own = found.rows[0]
    # What was chosen is, in truth, within the error of choosing of the best there is
    assert light(own.faces)[0] == pytest.approx(best, rel=0.08)
    for row in found.rows:
        truth, before = light(row.faces)[0], light(())[0]
        assert abs(row.after - truth) < 4.0 * row.after_se
        assert abs(row.before - before) < 4.0 * row.before_se
        assert abs(row.difference - (truth - before)) < 4.0 * row.difference_se
        assert row.difference_se < np.hypot(row.before_se, row.after_se)


def test_light_that_stays_counts_against(plates: Any) -> None:
    found = query.improve(plates, GHOSTS, reflectance=NEW, faces=2, keep=SIGNAL)
    ratio = [a / b for a, b in (light(each) for each in combinations(FACES, 2))]
    a, b = light(found.rows[0].faces)
    assert a / b == pytest.approx(min(ratio), rel=0.08)
    before, _, after, after_se, difference, _ = found.rows[0].keep
    assert abs(after - b) < 4.0 * after_se
    assert difference == pytest.approx(after - before)


def test_more_light_is_asked_for_too(plates: Any) -> None:
    found = query.improve(plates, SIGNAL, reflectance=NEW, faces=2, more=True)
    best = max(light(each)[1] for each in combinations(FACES, 2))
    assert light(found.rows[0].faces)[1] == pytest.approx(best, rel=1e-9)


def test_what_is_found_one_by_one_is_no_worse(plates: Any, monkeypatch: Any) -> None:
    whole = query.improve(plates, GHOSTS, reflectance=NEW, faces=3)
    monkeypatch.setattr(improving, "MOST_COMBINATIONS", 10)
    found = query.improve(plates, GHOSTS, reflectance=NEW, faces=3)
    assert not found.exhaustive
    assert light(found.rows[0].faces)[0] <= 1.05 * light(whole.rows[0].faces)[0]


def test_other_rays_judge_than_chose(plates: Any) -> None:
    """Together they are all rays of the light; what is judged is half of it, twice as much."""
    found = query.improve(plates, GHOSTS, reflectance=NEW)
    rays = query.select(plates, GHOSTS, rays=False).matched
    assert found.chosen_by + found.judged_by == rays
    assert abs(found.chosen_by - rays / 2) < 4.0 * (rays / 4) ** 0.5
    view = query.what_if(plates, {f"{name}.reflectance": NEW for name in found.rows[0].faces})
    whole = query.effect(plates, view, GHOSTS)
    assert abs(found.rows[0].after - whole.after.flux) < 4.0 * whole.after.se


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"reflectance": 1.2}, "from 0 to 1"),
        ({"reflectance": NEW, "faces": 0}, "at least 1"),
        ({"reflectance": NEW, "of": ["P9"]}, "nearest: P"),
        ({"reflectance": NEW, "criterion": "length > 1e6"}, "no ray does what is asked"),
        ({"reflectance": NEW, "keep": "length > 1e6"}, "to stay"),
    ],
)
def test_bad_input_is_refused_in_one_line(plates: Any, options: Any, said: str) -> None:
    given = {"criterion": GHOSTS, **options}
    with pytest.raises(RayMapError, match=said) as caught:
        query.improve(plates, given.pop("criterion"), **given)
    assert "\n" not in str(caught.value)
    with pytest.raises(RayMapError, match="not from a view"):
        query.improve(query.what_if(plates, {"P0.black": True}), GHOSTS, reflectance=NEW)


def test_the_command(plates: Any, tmp_path: Path) -> None:
    command = ["improve", str(plates.path), GHOSTS, "--reflectance", "0.1%", "--faces", "2"]
    shown = CliRunner().invoke(application(), [*command, "--json", "--keep", SIGNAL])
    assert shown.exit_code == 0, shown.output
    told = json.loads(shown.stdout)
    assert len(told["settings"]) == 2
    assert told["rows"][0]["keep"]["flux_se"] >= 0.0
    printed = CliRunner().invoke(application(), [*command, "--of", "P1"]).stdout
    assert "2 faces; all 3 combinations" in printed
    assert "--set 'P1.z_min.reflectance=0.001'" in printed
    assert CliRunner().invoke(application(), [*command[:3], "--reflectance", "x"]).exit_code == 1
