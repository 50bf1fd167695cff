"""Differences of two maps: closed forms of what changed, and errors that hold.

Light of a lamp meets a mirror of reflectance R, so that R of its flux arrives: the difference of
two maps is that of R. Each ray is a Bernoulli trial, which gives every error in closed form.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import query
import raymap
from raymap.model.errors import SceneMismatch
from tracer.run.recording import record
from tracer.scene.load import parse_scene

SCENE = """
length_unit = "mm"
[surfaces.mirror]
kind = "mirror"
reflectance = {R}
[bodies.mirror]
kind = "disc"
outer = 5
position = [0, 0, 10]
surface = "mirror"
[sources.lamp]
kind = "collimated"
diameter = 2
position = [0, 0, 1]
direction = [0, 0, 1]
flux = 1
[sources.side]
kind = "collimated"
diameter = 1
position = [3, 0, 1]
direction = [0, 0, 1]
flux = {side}
[detectors.screen]
position = [0, 0, 0]
looks = [0, 0, 1]
size = [40, 40]
cells = [8, 8]
blocking = true
"""
ARRIVES = 'detected("screen")'
RAYS = 100_000

Recorder = Callable[..., Any]


@pytest.fixture
def recorded(tmp_path: Path) -> Any:
    opened = []

    def record_scene(R: float = 0.7, side: float = 0.5, rays: int = RAYS, **options: Any) -> Any:
        path = tmp_path / f"{len(opened)}.raymap"
        record(parse_scene(SCENE.format(R=R, side=side)), path, rays=rays, **options)
        opened.append(raymap.open(path))
        return opened[-1]

    yield record_scene
    for map in opened:
        map.close()


def test_equal_seeds_are_differenced_emission_by_emission(recorded: Recorder) -> None:
    a, b = recorded(0.7), recorded(0.705)
    result = query.compare(a, b, ARRIVES, different_scenes=True)
    assert result.relation.kind == "paired"
    # 0.5 % of the rays are reflected in the second map alone: variance p (1 - p) / N of each source
    p, total = 0.005, 1.5
    emitted = a.emitted
    error = math.sqrt(sum(f**2 * p * (1 - p) / n for f, n in zip((1, 0.5), emitted, strict=True)))
    assert result.total.se == pytest.approx(error, rel=0.15)
    assert result.total.difference == pytest.approx(p * total, abs=4 * error)
    # In quadrature it would be sqrt(2 R (1 - R) / N)
    quadrature = math.hypot(result.total.se_a, result.total.se_b)
    assert result.total.se < 0.15 * quadrature
    assert result.ratio == pytest.approx(0.705 / 0.7, abs=4 * error)
    assert result.ratio_se == pytest.approx(error / (0.7 * total), rel=0.1)
    for path in result.paths:
        assert path.significant
        assert path.se < 0.15 * math.hypot(path.se_a, path.se_b)


def test_portions_of_other_sizes_pair_the_same(recorded: Recorder) -> None:
    a, b = recorded(0.7, rays=20_000), recorded(0.72, rays=20_000)
    small = recorded(0.72, rays=20_000, portion_rays=997)
    some, others = (query.compare(a, map, different_scenes=True) for map in (b, small))
    assert others.relation.kind == "paired"
    assert others.total.se == pytest.approx(some.total.se, rel=1e-12)
    for row, same in zip(some.paths, others.paths, strict=True):
        assert row.path == same.path
        assert row.se == pytest.approx(same.se, rel=1e-9)


def test_paired_errors_hold(recorded: Recorder) -> None:
    # Differences of 40 pairs of equal seeds, each by its own error, are N(0, 1)
    z = []
    for seed in range(40):
        a, b = recorded(0.6, rays=4000, seed=seed), recorded(0.65, rays=4000, seed=seed)
        total = query.compare(a, b, ARRIVES, different_scenes=True).total
        z.append((total.difference - 0.05 * 1.5) / total.se)
    assert 0.001 < stats.chi2.cdf(np.square(z).sum(), len(z)) < 0.999


def test_errors_of_independent_maps_hold(recorded: Recorder) -> None:
    z = []
    for seed in range(40):
        a, b = recorded(rays=2000, seed=seed), recorded(rays=2000, seed=1000 + seed)
        result = query.compare(a, b, ARRIVES)
        assert result.relation.kind == "independent"
        assert result.total.se == math.hypot(result.total.se_a, result.total.se_b)
        z.append(result.total.z)
    assert 0.001 < stats.chi2.cdf(np.square(z).sum(), len(z)) < 0.999


@pytest.mark.parametrize("criterion", [None, ARRIVES])
def test_identical_maps_differ_by_exactly_nothing(recorded: Recorder, criterion: Any) -> None:
    a, b = recorded(rays=5000), recorded(rays=5000)
    result = query.compare(a, b, criterion)
    for row in (result.total, *result.paths):
        assert (row.difference, row.se, row.z, row.significant) == (0.0, 0.0, 0.0, False)
    assert (result.ratio, result.ratio_se) == (1.0, 0.0)


def test_maps_that_share_some_emissions_are_not_independent(recorded: Recorder) -> None:
    some, more = recorded(rays=1000), recorded(rays=2000)
    result = query.compare(some, more, ARRIVES)
    assert result.relation.kind == "overlapping"
    assert "not independent" in result.relation.sentence
    assert result.total.se == result.total.se_a + result.total.se_b
    # Another allotment of rays to sources
    other = query.compare(some, recorded(rays=1000, side=0.9), different_scenes=True)
    assert other.relation.kind == "overlapping"


def test_the_other_rays_of_a_seed_are_independent(recorded: Recorder, tmp_path: Path) -> None:
    some = recorded(rays=1000)
    scene = parse_scene(SCENE.format(R=0.7, side=0.5))
    path = tmp_path / "later.raymap"
    _later_rays(scene, path, 1000)
    with raymap.open(path) as later:
        assert query.compare(some, later).relation.kind == "independent"


def _later_rays(scene: Any, path: Path, first: int) -> None:
    """A map of the 1,000 rays from ``first`` on, of the seed that is usual."""
    from raymap import RayMapWriter
    from tracer.run.running import DEFAULT_SEED
    from tracer.scene.compile import compile_scene
    from tracer.transport.wavefront import Wavefront

    compilation = compile_scene(scene)
    portion = Wavefront(compilation.arrays, DEFAULT_SEED).trace(first, 1000)
    with RayMapWriter.create(path, compilation.directory, first_ray=first) as writer:
        writer.add_channel_set(compilation.channel_set)
        writer.start_run(seed=DEFAULT_SEED)
        writer.append(portion)
        writer.finish()


def test_seeds_that_are_not_known_are_said(recorded: Recorder, tmp_path: Path) -> None:
    from raymap import RayMapWriter

    known = recorded(rays=1000)
    path = tmp_path / "foreign.raymap"
    with RayMapWriter.create(path, known.directory) as writer:
        writer.add_channel_set(known.channel_sets[0])
        for portion in known.portions:
            writer.append(portion.read())
        writer.finish()
    with raymap.open(path) as foreign:
        result = query.compare(known, foreign)
    assert result.relation.kind == "unknown"
    assert "not known" in result.relation.sentence
    assert result.total.se == result.total.se_a + result.total.se_b


def test_selections_of_a_map_are_not_independent_of_it(recorded: Recorder, tmp_path: Path) -> None:
    whole = recorded(rays=3000)
    query.select(whole, ARRIVES).write(tmp_path / "some.raymap")
    with raymap.open(tmp_path / "some.raymap") as some:
        assert query.compare(whole, some).relation.kind == "overlapping"
        own = query.compare(some, some)
    assert own.relation.kind == "paired"
    assert own.total.se == 0.0


def test_runs_of_several_seeds(recorded: Recorder) -> None:
    maps = []
    for _ in range(2):
        maps.append(recorded(rays=1000, seed=5))
        path = maps[-1].path
        record(parse_scene(SCENE.format(R=0.7, side=0.5)), path, rays=1000, seed=6, append=True)
        maps[-1].refresh()
    result = query.compare(*maps)
    assert result.relation.kind == "paired"
    assert "seeds 5, 6" in result.relation.sentence
    assert result.total.se == 0.0
    # Of seed 5 these are the first rays, of seed 6 those from 1,000 on
    for seed, kind in ((5, "overlapping"), (6, "independent"), (7, "independent")):
        assert query.compare(maps[0], recorded(rays=1000, seed=seed)).relation.kind == kind


def test_nothing_differs_between_other_scenes(recorded: Recorder) -> None:
    # A millionth more is reflected: one ray in a thousand maps shows it, none of these does
    result = query.compare(
        recorded(0.7, rays=1000), recorded(0.700001, rays=1000), ARRIVES, different_scenes=True
    )
    assert result.total.difference == result.total.se == 0.0
    # Rule of three: 3 / N of all light
    assert result.bound_95 == pytest.approx(3 * 1.5 / 1000, rel=0.01)
    assert "no emission differs" in result.head()


def test_what_cannot_be_compared_is_refused(recorded: Recorder, tmp_path: Path) -> None:
    a, b = recorded(0.7, rays=1000), recorded(0.8, rays=1000)
    with pytest.raises(SceneMismatch, match=r"surface 'mirror' differs.*--different-scenes"):
        query.compare(a, b)
    lumen = tmp_path / "lumen.raymap"
    text = SCENE.format(R=0.7, side=0.5).replace("[surfaces", 'flux_unit = "lm"\n[surfaces', 1)
    record(parse_scene(text), lumen, rays=1000)
    with raymap.open(lumen) as other, pytest.raises(SceneMismatch, match=r"flux in W, .* in lm"):
        query.compare(a, other, different_scenes=True)


def test_the_command_opens_with_scenes_totals_and_ratio(recorded: Recorder, run: Any) -> None:
    a, b = recorded(0.7, rays=1000), recorded(0.8, rays=1000)
    code, out, err = run("compare", a.path, b.path)
    assert (code, out) == (1, "")
    assert "--different-scenes" in err
    code, out, _ = run("compare", a.path, b.path, ARRIVES, "--different-scenes")
    assert code == 0
    first, one, two, ratio, errors, *_ = out.splitlines()
    assert first.startswith("the scenes differ: surface 'mirror'")
    assert str(a.path) in one
    assert str(b.path) in two
    assert ratio.startswith("ratio 1.1")
    assert "emission by emission" in errors
    code, out, _ = run("compare", a.path, b.path, ARRIVES, "--different-scenes", "--json")
    answer = json.loads(out)
    assert answer["relation"] == "paired"
    assert answer["total"]["ratio"] == pytest.approx(0.8 / 0.7, abs=0.05)
    assert answer["total"]["ratio_se"] > 0
    assert answer["scene_difference"].startswith("surface 'mirror'")


def test_rows_above_thirty_percent_are_marked(recorded: Recorder, run: Any) -> None:
    # 1 % of 3,000 rays are absorbed (18 %), 0.1 % in the other map (58 %)
    a, b = recorded(0.99, side=1e-9, rays=3000), recorded(0.999, side=1e-9, rays=3000)
    _, out, _ = run("compare", a.path, b.path, "--different-scenes")
    rows = [line for line in out.splitlines() if line.startswith("│")]
    marked = [line for line in rows if "?" in line]
    assert len(marked) == 1
    assert "lamp mirror.face:surface_absorption" in marked[0]
    assert "standard error above 30 %" in out
