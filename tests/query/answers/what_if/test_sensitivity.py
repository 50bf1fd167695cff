"""Derivatives of light against finite differences: of changed maps, and of scenes traced again."""

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
from raymap.laws.law import InChannels, Law, Shares
from raymap.laws.rough import RoughLaw
from raymap.laws.smooth import FresnelLaw
from raymap.model.errors import RayMapError
from raymap.passes.revised import RevisedMap
from raymap.passes.reweighting import ChangedLaws
from tests.query.answers.what_if.test_what_if import CLEAR, SCENE, traced

ROUGH = """
[surfaces.frosted]
kind = "rough_dielectric"
roughness = 0.3
[bodies.frost]
kind = "box"
position = [14, 14, 0]
size = [6, 6, 2]
medium = "glass"
surface = "frosted"
[bodies.stop]
kind = "box"
position = [-14, -14, 0]
size = [8, 8, 2]
surface = "absorber"
"""
TEXT = SCENE.replace("[detectors.wall]", ROUGH + "[detectors.wall]")
CRITERIA = (None, 'detected("wall")', 'hit("plate", reflected) & detected("wall")', "length > 60")
STEP = 1e-4


@pytest.fixture(scope="module", params=["W", "lm"])
def base(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    text = TEXT.replace("UNIT", request.param)
    path = tmp_path_factory.mktemp("base") / "a.raymap"
    with traced(path, text, 1, rays=12_000) as ray_map:
        yield ray_map


class _MoreFresnel(FresnelLaw):
    """Bare interfaces that reflect more."""

    more: float = 1.0

    def _shares(self, channels: InChannels, n_i: Any, n_o: Any, cos_i: Any) -> Shares:
        return _more_of(super()._shares(channels, n_i, n_o, cos_i)[0], self.more)


class _MoreRough(RoughLaw):
    """The same of each facet."""

    more: float = 1.0

    def _shares(self, channels: InChannels, n_i: Any, n_o: Any, cos_i: Any) -> Shares:
        return _more_of(super()._shares(channels, n_i, n_o, cos_i)[0], self.more)


def _more_of(back: Any, factor: float) -> Shares:
    back = np.where(back < 1.0, np.minimum(1.0, factor * back), 1.0)
    return back, 1.0 - back


def _with_law(ray_map: raymap.RayMap, body: str, change: Any) -> RevisedMap:
    faces = ray_map.directory.faces
    known = ray_map.laws()
    assert known is not None
    chosen: dict[int, tuple[Law, Law]] = {}
    for face, name in enumerate(faces.names):
        if name.startswith(body + "."):
            old = known.surfaces[int(faces.surface[face])]
            assert old is not None
            chosen[face] = old, change(old)
    return RevisedMap(ray_map, lambda _: ChangedLaws(faces=chosen))


def _more(body: str, factor: float) -> Any:
    form = {"plate": _MoreFresnel, "frost": _MoreRough}[body]
    return lambda old: form(**old.model_dump(), more=factor)


def _views(ray_map: raymap.RayMap, name: str) -> list[RevisedMap]:
    if name in ("plate", "frost"):
        return [_with_law(ray_map, name, _more(name, 1.0 + x)) for x in (STEP, -STEP)]
    changes = {"screen": ("paint.reflectance", 0.5), "glass": ("glass.absorption", 0.02)}
    key, value = changes[name]
    return [query.what_if(ray_map, {key: value * (1.0 + x)}) for x in (STEP, -STEP)]


@pytest.mark.parametrize("name", ["screen", "glass", "plate", "frost"])
def test_derivatives_are_those_of_changed_maps(base: Any, name: str) -> None:
    """The same rays, R or µ a little larger and a little smaller: exact but for the third order."""
    views = _views(base, name)
    for criterion in CRITERIA:
        found = query.sensitivity(base, criterion, by="object")
        assert found.unknown == ()
        rows = {row.name: row for row in found.rows}
        more, less = (query.effect(base, view, criterion) for view in views)
        slope = (more.after.flux - less.after.flux) / (2.0 * STEP)
        row = rows[name]
        assert row.derivative == pytest.approx(slope, rel=2e-4, abs=2e-7 * found.flux.flux)
        assert row.derivative_se == pytest.approx(more.difference_se / STEP, rel=0.01)
        assert found.flux.flux == pytest.approx(more.before.flux, rel=1e-12)


def test_faces_and_surfaces_add_up_to_objects(base: Any) -> None:
    sums = []
    for by in ("face", "object", "surface"):
        found = query.sensitivity(base, 'detected("wall")', by=by)
        sums.append(sum(row.derivative for row in found.rows))
    np.testing.assert_allclose(sums, sums[0], rtol=1e-9)


def test_the_derivative_is_that_of_scenes_traced_again(tmp_path: Path) -> None:
    criterion = 'count(hit("*", reflected)) >= 2 & detected("wall")'
    text = SCENE.replace("UNIT", "W")
    fluxes = []
    for seed, reflectance in ((1, 0.2), (2, 0.15), (3, 0.25)):
        scene = text.replace(CLEAR, f"{CLEAR}\nreflectance = {reflectance}")
        with traced(tmp_path / f"{seed}.raymap", scene, seed, rays=40_000) as ray_map:
            told = query.select(ray_map, criterion, rays=False)
            fluxes.append((told.flux, told.flux_se))
            if seed == 1:
                rows = query.sensitivity(ray_map, criterion, by="surface").rows
    row = next(row for row in rows if row.name == "clear")
    # Central difference of R = 0.2 ± 25 %; its curvature is below a thirtieth of the error
    slope = (fluxes[2][0] - fluxes[1][0]) / 0.5
    error = np.hypot(fluxes[2][1], fluxes[1][1]) / 0.5
    assert abs(slope) > 8.0 * error
    assert abs(row.derivative - slope) < 4.0 * np.hypot(row.derivative_se, error)
    assert row.mean == pytest.approx(0.2, abs=1e-9)


def test_what_reflects_nothing_has_bounds(base: Any) -> None:
    """Black paint of R: what ended there is missing, and comes back at most once."""
    last = 'last(hit("stop"))'
    rows = {row.name: row for row in query.sensitivity(base, last, by="object").rows}
    ended = query.select(base, last).flux
    low, high = rows["stop"].from_zero or (0.0, 0.0)
    assert rows["stop"].derivative == 0.0
    assert low == pytest.approx(-ended, rel=1e-6)
    assert high == pytest.approx(0.0, abs=0.02 * ended)
    rows = {row.name: row for row in query.sensitivity(base, 'detected("wall")', by="object").rows}
    low, high = rows["stop"].from_zero or (0.0, 0.0)
    # The criterion's own rays that ended there are lost; all others may come to satisfy it
    both = query.select(base, f'{last} & detected("wall")').flux
    assert low == pytest.approx(-both, rel=1e-6, abs=1e-12)
    assert high == pytest.approx(ended - both, rel=0.02)


def test_split_light_sums_by_emission(tmp_path: Path) -> None:
    text = SCENE.replace("UNIT", "W") + '[trace]\nmode = "weighted"\nsplit_depth = 2\n'
    with traced(tmp_path / "a.raymap", text, 1, rays=3_000) as ray_map:
        views = [query.what_if(ray_map, {"glass.absorption": 0.02 * x}) for x in (1.001, 0.999)]
        more, less = (query.effect(ray_map, view, CRITERIA[1]) for view in views)
        rows = {row.name: row for row in query.sensitivity(ray_map, CRITERIA[1]).rows}
    slope = (more.after.flux - less.after.flux) / 2e-3
    assert rows["glass"].derivative == pytest.approx(slope, rel=1e-3)
    assert rows["glass"].derivative_se == pytest.approx(more.difference_se / 1e-3, rel=0.01)


def test_views_are_asked_like_maps(base: Any) -> None:
    """At other paint the derivative is that there: of a straight line it is in proportion to R."""
    once = 'count(hit("screen", reflected)) == 1'
    rows = []
    for value in (0.5, 0.25):
        view = query.what_if(base, {"paint.reflectance": value})
        found = query.sensitivity(view, once + ' & not last(hit("screen"))', by="object")
        rows.append(next(row for row in found.rows if row.name == "screen"))
    assert rows[1].derivative == pytest.approx(rows[0].derivative / 2.0, rel=1e-4)


def test_maps_without_laws_are_refused(tmp_path: Path) -> None:
    from tests.query.random_maps import write_random_map

    write_random_map(tmp_path / "a.raymap", 1)
    with (
        raymap.open(tmp_path / "a.raymap") as ray_map,
        pytest.raises(RayMapError, match="does not say"),
    ):
        query.sensitivity(ray_map)


def test_the_command_prints_what_python_says(base: Any) -> None:
    command = ["sensitivity", str(base.path), 'detected("wall")', "--by", "object"]
    shown = CliRunner().invoke(application(), [*command, "--json"])
    assert shown.exit_code == 0, shown.output
    told = json.loads(shown.stdout)
    rows = query.sensitivity(base, 'detected("wall")', by="object").rows
    assert [row["name"] for row in told["rows"]] == [row.name for row in rows]
    printed = CliRunner().invoke(application(), command).stdout
    assert "diffuse reflectance" in printed
    assert "more; --top" not in printed
