"""Flux, selections and reports against sums over single rays."""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from query import select
from raymap import RayMapError
from raymap.model.errors import CriterionError, MapExists, RayNotFound
from tests.naive.interpreter import Interpreter
from tests.naive.rays import rays_of
from tests.query.by_hand import flux_of, matching
from tests.query.random_maps import write_random_map

# Flux and its standard error.


def test_flux_and_error_are_those_of_the_formula(map: Any) -> None:
    found = select(map, 'hit("L1")')
    rays = matching(map, 'hit("L1")')
    assert found.matched == len(rays) > 0
    assert found.flux == pytest.approx(flux_of(map, rays))
    emissions: dict[int, Any] = {}
    for index, portion in enumerate(map.portions):
        groups = portion.column("emission") if portion.grouped else portion.ray_ids()
        for ray_id, group in zip(portion.ray_ids().tolist(), groups.tolist(), strict=True):
            emissions[ray_id] = index, group
    variance = 0.0
    for number, source in enumerate(map.directory.sources):
        sums: Counter[Any] = Counter()
        for ray in rays:
            if ray.source == number:
                sums[emissions[ray.id]] += ray.weight
        n = int(map.emitted[number])
        square, total = sum(w * w for w in sums.values()), sum(sums.values())
        variance += (source.flux / n) ** 2 * (square - total**2 / n)
    assert found.flux_se == pytest.approx(variance**0.5)


def test_nothing_matched_gives_a_bound(map: Any) -> None:
    found = select(map, 'hit("L1") & !hit("*")')
    assert found.matched == 0
    assert found.flux == 0
    assert found.flux_bound_95 == pytest.approx(
        3 * max(s.flux / n for s, n in zip(map.directory.sources, map.emitted, strict=True))
    )
    assert select(map, 'hit("L1")').flux_bound_95 is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("wavelength > 900 nm", "channels of this map are 450, 550, 650 nm"),
        ('count(hit("*")) < 0', "a count is a whole number"),
        ("bounces == 1.5", "a count is a whole number"),
        ('detected("screen", rect(9, 0, 10, 1))', "outside the 8 x 6 cells"),
        ('hit("L1", ordinary)', "rays meet it, but this never happens there"),
        ("event(fluorescence)", "no path of this map|no ray of this map"),
        ('hit("L1") & event(polariser) & event(fluorescence)', "event(fluorescence)"),
        ('event(left) & last(hit("wall"))', "no ray satisfies all of them"),
    ],
)
def test_the_reason_for_nothing(text: str, reason: str, maps: dict[str, Any]) -> None:
    for map in maps.values():
        found = select(map, text)
        if found.matched == 0:
            assert any(part in (found.reason or "") for part in reason.split("|"))
    assert select(maps["merged"], text).matched == 0


# Reports.


def test_reports_hold_what_the_rays_hold(map: Any) -> None:
    for ray in rays_of(map)[::37]:
        told = query.report(map, ray.id)
        assert told["source"] == map.directory.sources[ray.source].name
        assert told["weight"] == ray.weight
        assert len(told["points"]) == len(ray.points)
        oracle = Interpreter(map)
        assert told["length"] == pytest.approx(oracle.length(ray, optical=False))
        for k, (point, own) in enumerate(zip(told["points"], ray.points, strict=True)):
            assert point["position"] == pytest.approx(own.position)
            expected = None if own.object < 0 else map.directory.objects[own.object].name
            assert point["object"] == expected
            full = None if own.face < 0 else map.directory.faces.names[own.face]
            if full is not None:
                assert f"{point['object']}.{point['face']}" == full
            angle = oracle.incidence(ray.points, k)
            if angle is None:
                assert point["incidence_deg"] is None
            else:
                assert point["incidence_deg"] == pytest.approx(angle, abs=1e-5)
            assert [met["registered"] for met in point["detectors"]] == [
                m[1] for m in own.crossings
            ]
            assert sum(point["spectrum"].values()) == pytest.approx(1, abs=1e-4)
    with pytest.raises(RayNotFound):
        query.report(map, 10**9)


# Selections.


def test_selections_are_written_and_keep_their_flux(map: Any, tmp_path: Path) -> None:
    found = select(map, "event(reflected)")
    found.write(tmp_path / "part.raymap")
    with raymap.open(tmp_path / "part.raymap") as part:
        again = select(part)
        assert again.ray_ids.tolist() == found.ray_ids.tolist()
        assert again.flux == pytest.approx(found.flux)
        assert again.flux_se == pytest.approx(found.flux_se)
        assert select(part, 'hit("L1", tir)').ray_ids.tolist() == (
            select(map, 'event(reflected) & hit("L1", tir)').ray_ids.tolist()
        )
    table = found.to_arrow()
    assert sorted(set(table["ray_id"].to_pylist())) == found.ray_ids.tolist()
    columns = found.to_numpy()
    assert len(columns["ray_id"]) == table.num_rows
    for name in ("part.parquet", "part.arrow", "part.csv"):
        found.write(tmp_path / name)
    import pyarrow.parquet

    assert pyarrow.parquet.read_table(tmp_path / "part.parquet").num_rows == table.num_rows
    with pytest.raises(RayMapError, match="written to"):
        found.write(tmp_path / "part.xlsx")
    assert "rays" in found._repr_html_()
    assert repr(found).startswith("<Selection")
    assert sum(portion.n_rays for portion in found.portions()) == found.matched


@pytest.mark.parametrize("name", ["part.raymap", "part.csv"])
def test_an_existing_file_is_replaced_only_when_asked_for(
    map: Any, tmp_path: Path, name: str
) -> None:
    target = tmp_path / name
    target.write_bytes(b"old")
    found = select(map, "event(reflected)")
    with pytest.raises(MapExists, match="force=True"):
        found.write(target)
    assert target.read_bytes() == b"old"
    found.write(target, force=True)
    assert len(target.read_bytes()) > 3


def test_a_selection_never_replaces_the_map_that_it_comes_from(map: Any) -> None:
    before = map.path.read_bytes()
    with pytest.raises(MapExists, match="comes from"):
        select(map, "event(reflected)").write(map.path, force=True)
    assert map.path.read_bytes() == before


def test_a_search_can_be_cancelled_and_tells_its_progress(map: Any) -> None:
    seen: list[Any] = []
    whole = select(map, "length > 3", progress=seen.append, threads=2)
    assert seen[-1].portions_done == seen[-1].portions
    assert seen[-1].matched == whole.matched
    stop = threading.Event()
    stop.set()
    nothing = select(map, "length > 3", cancel=stop)
    assert not nothing.complete
    assert nothing.matched == 0
    calls = []

    def after_one() -> bool:
        calls.append(1)
        return len(calls) > 4

    part = select(map, "length > 3", cancel=after_one, threads=1)
    assert not part.complete
    assert set(part.ray_ids.tolist()) < set(whole.ray_ids.tolist())
    assert part.matched == len(part.ray_ids)


def test_several_criteria_in_one_pass(map: Any) -> None:
    texts = ["event(reflected)", "length > 10", 'detected("screen", rect(0, 0, 3, 3))', None]
    together = query.select_many(map, texts)
    for text, found in zip(texts, together, strict=True):
        alone = select(map, text)
        assert found.ray_ids.tolist() == alone.ray_ids.tolist()
        assert found.flux == pytest.approx(alone.flux)


def test_explanations_count_every_part(map: Any) -> None:
    text = 'hit("L1", reflected) & !detected("screen", rect(0, 0, 4, 4)) | count(hit("*")) > 2'
    told = query.explain(map, text)
    assert len(told.steps) == 7
    for step in told.steps:
        assert step.rays == select(map, step.text).matched
    assert told.steps[0].rays == select(map, text).matched
    assert str(told)
    nothing = query.explain(map, 'hit("wall") & wavelength > 900 nm')
    assert nothing.reason is not None


def test_limits_below_one_are_refused(maps: dict[str, Any]) -> None:
    with pytest.raises(CriterionError):
        select(maps["merged"], limit=0)


# Shards.


def test_shards_answer_as_one_map(tmp_path: Path) -> None:
    folder = tmp_path / "shards"
    folder.mkdir()
    options = {"rays": 60, "paths": 20}
    write_random_map(folder / "a.raymap", 31, **options)
    write_random_map(folder / "b.raymap", 32, first_ray=100_000, **options)
    texts = ["length > 5", 'hit("L1", reflected)', 'detected("screen", rect(0, 0, 4, 4))']
    with (
        raymap.open(folder) as whole,
        raymap.open(folder / "a.raymap") as a,
        raymap.open(folder / "b.raymap") as b,
    ):
        for text in texts:
            parts = [select(part, text).ray_ids.tolist() for part in (a, b)]
            found = select(whole, text)
            assert found.ray_ids.tolist() == sorted(parts[0] + parts[1])
            oracle, tree = Interpreter(whole), query.parse(text)
            assert found.matched == sum(oracle.ray(tree, ray) for ray in rays_of(whole))
            assert select(whole, text, limit=4).ray_ids.tolist() == found.ray_ids[:4].tolist()
        rows = query.path_table(whole).rows()
        assert sum(row.rays for row in rows) == whole.rays
        assert (query.audit(whole).emitted == a.emitted + b.emitted).all()
