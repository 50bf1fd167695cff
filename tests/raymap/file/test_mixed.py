"""Mixes of maps against one trace with all their sources, and against sums."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import query
import raymap
from raymap.cli import application
from raymap.file.verify import verify
from raymap.model.errors import RayMapError
from tracer import parse_scene
from tracer.run.recording import record

SCENE = """
length_unit = "mm"
flux_unit = "lm"
[spectrum]
kind = "spectral"
wavelengths_nm = [480, 620]
[surfaces.paint]
kind = "lambertian"
reflectance = 0.5
[bodies.screen]
kind = "box"
position = [0, 0, 20]
size = [60, 60, 2]
surface = "paint"
[detectors.wall]
position = [0, 0, 15]
looks = [0, 0, -1]
size = [40, 40]
cells = [3, 3]
both_sides = true
"""
LAMP = "[sources.lamp]\nkind = 'point'\nposition = [0, 0, -10]\nflux = 2.0\n"
SPOT = (
    "[sources.spot]\nkind = 'collimated'\nposition = [5, 5, -10]\ndirection = [0, 0, 1]\n"
    "diameter = 4\nflux = 3.0\nspectrum = { blackbody = 2800 }\n"
)
CRITERIA = (None, 'detected("wall")', 'source("spot*")', 'hit("screen", reflected)', "length > 40")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("mixed")
    for name, text, seed in (("a", LAMP, 1), ("b", SPOT, 2), ("both", LAMP + SPOT, 3)):
        path = place / f"{name}.raymap"
        record(parse_scene(SCENE + text), path, rays=5_000, portion_rays=2_000, seed=seed)
    return place


@pytest.fixture(scope="module")
def mixed(folder: Path) -> Iterator[Any]:
    maps = [(folder / "a.raymap", 0.3), (folder / "b.raymap", 1.0)]
    raymap.write_mix(folder / "m.raymix", maps)
    with raymap.open(folder / "m.raymix") as found:
        yield found


@pytest.mark.parametrize("criterion", CRITERIA)
def test_light_is_that_of_the_maps_by_their_factors(
    folder: Path, mixed: Any, criterion: str | None
) -> None:
    flux = variance = 0.0
    rays = 0
    for name, factor in (("a", 0.3), ("b", 1.0)):
        if criterion == 'source("spot*")' and name == "a":
            continue
        with raymap.open(folder / f"{name}.raymap") as own:
            told = query.select(own, criterion)
        flux += factor * told.flux
        variance += (factor * told.flux_se) ** 2
        rays += told.matched
    found = query.select(mixed, criterion)
    assert found.matched == rays == len(set(found.ray_ids.tolist()))
    assert found.flux == pytest.approx(flux, rel=1e-12)
    assert found.flux_se == pytest.approx(variance**0.5, rel=1e-9)
    slow = query.select(mixed, criterion, use_merged=False)
    assert slow.flux == pytest.approx(flux, rel=1e-12)


def test_it_is_the_trace_with_all_sources(folder: Path, mixed: Any) -> None:
    with raymap.open(folder / "both.raymap") as both:
        dimmed = query.what_if(both, {"lamp.flux": 0.6})
        pictures = [query.detector_image(each, "wall") for each in (mixed, dimmed)]
        tables = [
            {row.path: row for row in query.path_table(each).rows(9)} for each in (mixed, dimmed)
        ]
        deviations = [
            abs(tables[0][path].flux - tables[1][path].flux)
            / np.hypot(tables[0][path].flux_se, tables[1][path].flux_se)
            for path in set(tables[0]) & set(tables[1]) - {"remainder"}
        ]
    assert len(deviations) > 4
    assert max(deviations) < 4.0
    spread = np.sqrt(pictures[0].variance + pictures[1].variance)
    assert (np.abs(pictures[0].flux - pictures[1].flux) < 4.5 * spread).all()


def test_other_questions_and_views_take_it(mixed: Any, tmp_path: Path) -> None:
    ids = query.select(mixed, 'source("spot") & detected("wall")').ray_ids
    report = query.report(mixed, int(ids[-1]))
    assert (report["ray_id"], report["source"]) == (int(ids[-1]), "spot")
    assert query.audit(mixed).flux.sum() == pytest.approx(0.6 + 3.0, rel=0.02)
    view = query.what_if(mixed, {"lamp.flux": 0.1, "paint.reflectance": 0.25})
    lamp = query.effect(mixed, view, 'source("lamp")')
    assert (lamp.before.flux, lamp.after.flux) == (pytest.approx(0.6), pytest.approx(0.1, rel=0.02))
    once = query.effect(mixed, view, 'source("spot") & hit("screen", reflected)')
    assert once.ratio == pytest.approx(0.5, rel=1e-6)
    query.select(mixed, 'detected("wall")').write(tmp_path / "kept.raymap")
    with raymap.open(tmp_path / "kept.raymap") as kept:
        told = query.select(mixed, 'detected("wall")').flux
        assert query.select(kept, None).flux == pytest.approx(told, rel=1e-9)
        assert not verify(kept).damage
    assert not verify(mixed).damage


def test_sources_of_one_name_are_told_apart(folder: Path, tmp_path: Path) -> None:
    raymap.write_mix(
        tmp_path / "m.raymix", [(folder / "a.raymap", 1.0), (folder / "both.raymap", 2.0)]
    )
    with raymap.open(tmp_path / "m.raymix") as found:
        names = {source.name: source.flux for source in found.directory.sources}
        assert names == {"lamp": 2.0, "lamp (2)": 4.0, "spot": 6.0}
        assert query.select(found, None).flux == pytest.approx(12.0)


@pytest.mark.parametrize(
    ("maps", "said"),
    [
        ([("a.raymap", 1.0), ("a.raymap", 1.0)], "twice"),
        ([("a.raymap", -1.0)], "from 0 on"),
        ([("a.raymap", float("nan"))], "from 0 on"),
        ([("nowhere.raymap", 1.0)], "nowhere"),
        ([("other.raymap", 1.0), ("a.raymap", 1.0)], "more than its sources"),
        ([("green.raymap", 1.0), ("a.raymap", 1.0)], "channels"),
        ([], "name the maps"),
    ],
)
def test_what_cannot_be_mixed_is_refused_in_one_line(
    folder: Path, tmp_path: Path, maps: Any, said: str
) -> None:
    if any(name in ("other.raymap", "green.raymap") for name, _ in maps):
        old, new = ("[60, 60, 2]", "[50, 60, 2]") if "other" in maps[0][0] else ("620]", "520]")
        text = (SCENE + LAMP).replace(old, new)
        record(parse_scene(text), folder / maps[0][0], rays=100, force=True)
    with pytest.raises(RayMapError, match=said) as caught:
        raymap.write_mix(tmp_path / "m.raymix", [(folder / name, f) for name, f in maps])
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "m.raymix").exists()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"raymap_mix": 1, "maps": []}',
        '{"raymap_mix": 1, "maps": [3]}',
        '{"raymap_mix": 1, "maps": [{"map": "."}]}',
        '{"raymap_mix": 1, "maps": [{"map": "a", "factor": "x"}]}',
    ],
)
def test_files_that_are_no_mix_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.raymix").write_text(text)
    with pytest.raises(RayMapError) as caught:
        raymap.open(tmp_path / "m.raymix")
    assert "\n" not in str(caught.value)


def test_the_command(folder: Path, tmp_path: Path) -> None:
    command = ["mix", f"{folder / 'a.raymap'}:0.3", str(folder / "b.raymap"), "-o"]
    shown = CliRunner().invoke(application(), [*command, str(tmp_path / "m.raymix"), "--json"])
    assert shown.exit_code == 0, shown.output
    told = json.loads(shown.stdout)
    assert [row["factor"] for row in told["maps"]] == [0.3, 1.0]
    assert told["shared_seeds"] == []
    assert told["maps"][0]["sources"] == {"lamp": pytest.approx(0.6)}
    again = CliRunner().invoke(application(), [*command, str(tmp_path / "m.raymix")])
    assert again.exit_code == 1
    for asked in (["info"], ["query"], ["verify"], ["audit"], ["image", "wall"]):
        words = [asked[0], str(tmp_path / "m.raymix"), *asked[1:]]
        words += ["-o", str(tmp_path / "a.png")] if asked[0] == "image" else []
        result = CliRunner().invoke(application(), words)
        assert result.exit_code == 0, result.output
    refused = CliRunner().invoke(
        application(), ["repair", str(tmp_path / "m.raymix"), "-o", str(tmp_path / "n.raymap")]
    )
    assert refused.exit_code == 1
