"""Stops put into a recorded scene against traces of the scene that has them."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import query
import raymap
from raymap.cli import application
from raymap.file.verify import verify
from raymap.model.errors import RayMapError
from raymap.passes.stops import MeshStop, StopTable
from tests.query.answers.what_if.test_what_if import SCENE
from tracer import parse_scene
from tracer.run.recording import record
from tracer.run.results import StoppedLight

BASE = SCENE.replace("UNIT", "lm") + (
    "[detectors.lens]\nkind = 'camera'\nposition = [0, 0, 11]\nlooks = [0, 0, -1]\n"
    "cells = [8, 8]\nfield_deg = 60\naperture = 8\n"
    "[detectors.sky]\nkind = 'far_field'\ncells = [12, 6]\n"
)
STOPS = (
    "ring(z=8, inner=5, outer=20, name='baffle')",
    "rectangle(center=[6, 0, -6], axis=[1, 0, 1], size=[6, 3], name='vane')",
)
BODIES = """
[bodies.baffle]
kind = "ring"
position = [0, 0, 8]
inner = 5
outer = 20
surface = "absorber"
[bodies.vane]
kind = "rectangle"
position = [6, 0, -6]
axis = [1, 0, 1]
size = [6, 3]
surface = "absorber"
"""
CRITERIA = (
    None,
    'detected("wall")',
    'detected("lens")',
    'detected("sky")',
    'hit("baffle")',
    'last(hit("vane"))',
    '!hit("baffle") & hit("screen")',
    'hit("plate", refracted) -> detected("wall")',
    "length > 50",
    "wavelength < 500",
)


def traced(path: Path, text: str, **options: Any) -> raymap.RayMap:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StoppedLight)
        record(parse_scene(text), path, rays=6_000, portion_rays=2_500, seed=1, **options)
    return raymap.open(path)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    folder = tmp_path_factory.mktemp("stops")
    with (
        traced(folder / "a.raymap", BASE) as before,
        traced(folder / "b.raymap", BASE + BODIES) as after,
    ):
        yield before, query.what_if(before, stops=STOPS), after


def test_every_ray_is_the_one_that_meets_the_stops_in_a_trace(pair: Any) -> None:
    """Random numbers belong to rays, so that the same rays come to the same places."""
    _, view, again = pair
    assert len(view.portions) == 3
    for one, other in zip(view.portions, again.portions, strict=True):
        mine, theirs = one.read(), other.read()
        for name in (
            "source", "records_per_ray", "object", "triangle", "event", "medium",
            "descriptor_count",
        ):  # fmt: skip
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name), name)
        np.testing.assert_allclose(mine.position, theirs.position, atol=2e-5)
        assert np.abs(mine.normal.astype(int) - theirs.normal).max() <= 1
        np.testing.assert_array_equal(one.column("color"), other.column("color"))
        np.testing.assert_array_equal(one.column("face"), other.column("face"))
        np.testing.assert_array_equal(
            one.column("first_descriptor"), other.column("first_descriptor")
        )
        for name in ("detector", "cell", "registered"):
            np.testing.assert_array_equal(
                getattr(mine.descriptors, name), getattr(theirs.descriptors, name), name
            )
        rows = np.arange(one.n_records)
        np.testing.assert_allclose(
            one.normals_at(rows, one.column("face"), mine.position), theirs.normal, atol=1
        )


@pytest.mark.parametrize("criterion", CRITERIA)
def test_answers_are_those_of_the_trace(pair: Any, criterion: str | None) -> None:
    before, view, again = pair
    told = query.select(again, criterion)
    found = query.select(view, criterion)
    np.testing.assert_array_equal(found.ray_ids, told.ray_ids)
    assert found.flux == pytest.approx(told.flux, rel=1e-9)
    assert found.flux_se == pytest.approx(told.flux_se, rel=1e-6)
    effect = query.effect(before, view, criterion)
    assert effect.after.flux == pytest.approx(told.flux, rel=1e-9)
    if "baffle" not in str(criterion) and "vane" not in str(criterion):
        assert effect.before.flux == pytest.approx(query.select(before, criterion).flux, rel=1e-9)


def test_path_tables_and_pictures_are_those_of_the_trace(pair: Any) -> None:
    _, view, again = pair
    tables = [
        {row.path: (row.rays, round(row.flux, 9)) for row in query.path_table(each).rows(10_000)}
        for each in (view, again)
    ]
    assert tables[0] == tables[1]
    for detector in ("wall", "lens", "sky"):
        for criterion in (None, 'hit("plate")'):
            images = [query.detector_image(m, detector, criterion) for m in (view, again)]
            np.testing.assert_allclose(images[0].flux, images[1].flux, rtol=1e-9)
            np.testing.assert_allclose(images[0].variance, images[1].variance, rtol=1e-6)


def test_the_difference_has_the_error_of_the_light_that_is_lost(pair: Any) -> None:
    """One source: what is lost is counted, so that its variance is that of a binomial; in lumens
    single rays of a colour count a little more or less."""
    before, view, _ = pair
    text = 'source("beam") & detected("wall")'
    found = query.effect(before, view, text)
    kept = set(query.select(view, text).ray_ids.tolist())
    lost = len(set(query.select(before, text).ray_ids.tolist()) - kept)
    assert lost > 100
    n = int(before.emitted[1])
    per_ray = 1.0 / n
    assert found.difference == pytest.approx(-lost * per_ray, rel=1e-2)
    spread = per_ray * (lost - lost**2 / n) ** 0.5
    assert found.difference_se == pytest.approx(spread, rel=5e-2)


def test_meshes_stop_what_the_flat_stop_of_their_shape_does(pair: Any, tmp_path: Path) -> None:
    before, _, _ = pair
    corners = np.array([[-9.0, -4, 8], [9, -4, 8], [9, 4, 8], [-9, 4, 8]])
    mesh = trimesh.Trimesh(corners / 10.0, [[0, 1, 2], [0, 2, 3]], process=False)
    mesh.export(tmp_path / "baffle.stl")
    flat = query.what_if(before, stops=["rectangle(z=8, size=[18, 8])"])
    solid = query.what_if(before, stops=[f"mesh({tmp_path / 'baffle.stl'}, scale=10)"])
    for criterion in ('hit("stop_1")', 'detected("wall")'):
        ids = [query.select(each, criterion).ray_ids for each in (flat, solid)]
        assert len(ids[0]) > 50
        assert len(set(ids[0].tolist()) ^ set(ids[1].tolist())) <= 1
    assert set(solid.meshes) - set(before.meshes) == {len(before.directory.objects)}


def test_the_tree_of_triangles_finds_what_a_search_of_all_of_them_finds() -> None:
    random = np.random.default_rng(3)
    corners = random.normal(size=(300, 3, 3)) * 0.2 + random.normal(size=(300, 1, 3))
    stop = MeshStop(
        name="s", vertices=corners.reshape(-1, 3), triangles=np.arange(900).reshape(-1, 3)
    )
    ends = random.normal(size=(400, 2, 3)).astype(np.float32) * 1.5
    offsets = np.arange(401) * 2
    found = StopTable((stop,)).meet(ends.reshape(-1, 3), offsets, np.zeros(400, bool))
    nearest = np.full(400, np.inf)
    p, d = ends[:, 0].astype(float), ends[:, 1].astype(float) - ends[:, 0]
    for a, b, c in corners:
        # The segment p + t d and the plane through a, in coordinates of the triangle's sides
        sides = np.broadcast_to(np.stack((b - a, c - a), axis=1), (400, 3, 2))
        sums = np.concatenate((-d[:, :, None], sides), axis=2)
        t, u, v = np.linalg.solve(sums, (p - a)[:, :, None])[:, :, 0].T
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t <= 1)
        nearest = np.where(inside & (t < nearest), t, nearest)
    assert np.isfinite(nearest).sum() > 100
    np.testing.assert_array_equal(found.ray, np.flatnonzero(np.isfinite(nearest)))
    np.testing.assert_allclose(found.reach, nearest[found.ray], rtol=1e-9)


def test_stops_go_with_changes_and_with_detectors_after_the_trace(pair: Any) -> None:
    """A paint of half the reflectance, and a plane behind the stop, in whichever order."""
    before, view, _ = pair
    changes = {"paint.reflectance": 0.25}
    place = "plane(z=14, size=[30, 30], cells=[3, 3])"
    both = query.what_if(before, changes, stops=STOPS)
    other = query.what_if(query.what_if(before, changes), stops=STOPS)
    third = query.what_if(view, changes)
    fluxes = [query.effect(before, each, 'detected("wall")').after.flux for each in (both, other)]
    assert fluxes[0] == fluxes[1] == query.select(third, 'detected("wall")').flux
    # Of the light that met the paint once, and then the wall, half
    once = 'count(hit("screen", reflected)) == 1 & detected("wall")'
    assert query.select(both, once).flux == pytest.approx(0.5 * query.select(view, once).flux)
    placed = query.what_if(query.with_detectors(before, place), stops=STOPS)
    again = query.with_detectors(view, place)
    images = [query.detector_image(each, place).flux for each in (placed, again)]
    np.testing.assert_allclose(images[0], images[1])
    assert images[0].sum() > 0.0
    lit = query.detector_image(query.what_if(again, changes), place).flux
    np.testing.assert_allclose(lit, query.detector_image(both, place).flux)
    assert query.sensitivity(view, 'detected("wall")').flux.flux == pytest.approx(
        query.select(view, 'detected("wall")').flux
    )
    assert query.report(view, int(query.select(view, 'hit("baffle")').ray_ids[0]))["points"]


def test_a_view_is_written_as_a_map(pair: Any, tmp_path: Path) -> None:
    _, view, again = pair
    query.select(view, None).write(tmp_path / "kept.raymap")
    with raymap.open(tmp_path / "kept.raymap") as kept:
        assert not verify(kept).damage
        for criterion in ('hit("baffle")', 'detected("wall")'):
            told = query.select(again, criterion)
            assert query.select(kept, criterion).flux == pytest.approx(told.flux, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("disc(z=3)", "describes no stop"),
        ("ring(z=3)", "outer is missing"),
        ("ring(z=3, inner=5, outer=5)", "smaller radius"),
        ("ring(z=3, x=2, outer=5)", "one of x, y, z or center"),
        ("ring(z=3, outr=5)", "nearest: outer"),
        ("ring(z=3, outer=5, name='plate')", "no object is called"),
        ("rectangle(center=[0, 0, 1], size=[2, 2])", "axis is missing"),
        ("rectangle(z=1)", "size is missing"),
        ("rectangle(z=1, size=[2, 0])", "size lies from"),
        ("ring(z=1, outer=nan)", "outer lies from"),
        ("mesh(nowhere.stl)", "nowhere.stl"),
        ("mesh()", "file is missing"),
        ("mesh(file=3)", "file is missing"),
    ],
)
def test_stops_that_cannot_be_are_refused_in_one_line(pair: Any, text: str, said: str) -> None:
    with pytest.raises(RayMapError, match=said.replace(".", r"\.")) as caught:
        query.what_if(pair[0], stops=[text])
    assert "\n" not in str(caught.value)


def test_the_command_says_what_a_stop_takes_and_costs(pair: Any) -> None:
    before, view, _ = pair
    command = ["what-if", str(before.path), 'detected("wall")', "--stop", STOPS[0]]
    command += ["--stop", STOPS[1], "--keep", 'hit("plate")']
    shown = CliRunner().invoke(application(), [*command, "--json"])
    assert shown.exit_code == 0, shown.output
    told = json.loads(shown.stdout)
    assert told["flux"] == pytest.approx(query.select(view, 'detected("wall")').flux)
    assert told["keep"][0]["flux"] == pytest.approx(query.select(view, 'hit("plate")').flux)
    assert told["stops"] == list(STOPS)
    assert any(row["flux"] == 0.0 < row["flux_before"] for row in told["paths"])
    printed = CliRunner().invoke(application(), command).stdout
    assert "what they would scatter is not in this answer" in printed
    assert 'keep hit("plate"): -' in printed
