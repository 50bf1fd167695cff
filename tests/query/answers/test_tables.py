"""Path tables and studies against sums over single rays."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import pytest

import query
from query import select
from query.cli.terminal import _shorter
from raymap import RayMapError
from raymap.model.doubt import FOOTNOTE, is_doubtful
from raymap.model.events import FAMILIES, Event
from tests.naive.rays import Ray, rays_of
from tests.query.by_hand import flux_of, flux_se_of, matching

# The path table.


@pytest.mark.parametrize("by", ["face", "object"])
@pytest.mark.parametrize("criterion", [None, 'detected("screen", rect(0, 0, 4, 6))', "event(left)"])
def test_every_row_selects_its_rays(map: Any, by: str, criterion: str | None) -> None:
    table = query.path_table(map, criterion, by=by)
    whole = select(map, criterion)
    rows = table.rows()
    assert sum(row.rays for row in rows) == whole.matched
    assert sum(row.share for row in rows) == pytest.approx(1)
    assert sum(row.flux for row in rows) == pytest.approx(whole.flux)
    assert table.total == pytest.approx(whole.flux)
    for row in rows[:-1][:25]:
        asked = row.criterion if criterion is None else f"{row.criterion} & {criterion}"
        again = select(map, asked)
        assert again.matched == row.rays
        assert again.flux == pytest.approx(row.flux)
        assert again.flux_se == pytest.approx(row.flux_se)
    for row in rows[:2]:
        asked = row.criterion if criterion is None else f"{row.criterion} & {criterion}"
        if asked is not None:
            assert row.flux_se == pytest.approx(flux_se_of(map, matching(map, asked)), abs=1e-12)


def test_the_remainder_makes_it_whole(map: Any) -> None:
    table = query.path_table(map, 'hit("*")')
    whole = select(map, 'hit("*")')
    for top in (0, 1, 3):
        rows = table.rows(top)
        assert len(rows) == top + 1
        assert rows[-1].path == "remainder"
        assert sum(row.share for row in rows) == pytest.approx(1)
    assert table.rows(0)[-1].flux == pytest.approx(whole.flux)
    by_hand = flux_se_of(map, matching(map, 'hit("*")'))
    assert table.rows(0)[-1].flux_se == pytest.approx(by_hand)
    few = table.filter(min_share=0.1)
    assert all(row.share >= 0.1 for row in few.rows()[:-1])
    assert sum(row.share for row in few.rows()) == pytest.approx(1)


def test_a_table_prints_as_a_table(map: Any) -> None:
    table = query.path_table(map, 'hit("*")')
    head, *lines = str(table).splitlines()
    rows = table.rows(20)
    assert head.split()[0] == "rays"
    if any(is_doubtful(row.flux, row.flux_se) for row in rows):
        assert lines.pop() == FOOTNOTE
    assert len(lines) == len(rows)
    for row, line in zip(rows, lines, strict=True):
        assert line.split()[0] == f"{row.rays:,}"
        assert line.endswith(row.path)


def test_rows_know_their_reflections_and_ends(map: Any) -> None:
    names = [item.name for item in map.directory.objects]
    rays = {ray.id: ray for ray in rays_of(map)}
    for row in query.path_table(map).rows(12)[:-1]:
        ray = rays[int(select(map, row.criterion, limit=1).ray_ids[0])]
        met = [p.object for p in ray.points[1:] if p.object >= 0]
        assert row.first_object == (names[met[0]] if met else None)
        assert row.last_object == (names[met[-1]] if met else None)
        reflected = int(FAMILIES["reflected"])
        assert row.reflections == sum(bool(p.event & reflected) for p in ray.points)
        assert row.source == map.directory.sources[ray.source].name


def test_peaks_are_those_of_the_picture(map: Any) -> None:
    table = query.path_table(map, 'detected("screen")', sort="peak", peak="screen")
    rows = table.rows(10)[:-1]
    peaks = [row.peak_flux for row in rows]
    assert peaks == sorted(peaks, reverse=True)
    for row in rows:
        picture = query.detector_image(map, "screen", row.criterion)
        assert row.peak_flux == pytest.approx(picture.flux.max())
        assert row.peak is not None
        assert picture.flux[row.peak[1], row.peak[0]] == pytest.approx(row.peak_flux)


def test_tables_refuse_what_they_cannot_do(maps: dict[str, Any]) -> None:
    for options in ({"by": "triangle"}, {"sort": "size"}, {"peak": "scren"}, {"sort": "peak"}):
        with pytest.raises(RayMapError):
            query.path_table(maps["merged"], **options)


def test_the_merged_dictionary_answers_alone(maps: dict[str, Any]) -> None:
    map = maps["merged"]
    query.path_table(map).rows(5)
    read = map.bytes_read
    found = select(map, 'detected("screen") & hit("L1", reflected)', rays=False)
    query.path_table(map, 'detected("screen")').rows(5)
    assert map.bytes_read == read
    assert found.portions_read == 0


# Studies.


def test_ghosts_by_pair_of_faces(map: Any) -> None:
    matrix = query.ghost_matrix(map)
    faces = map.directory.faces.names
    names = [item.name for item in map.directory.objects]
    expected: dict[Any, list[Ray]] = defaultdict(list)
    for ray in matching(map, 'count(hit("*", specular_reflection)) == 2 & !event(scattered)'):
        at = [
            faces[p.face] if p.face >= 0 else names[p.object]
            for p in ray.points[1:]
            if p.event & int(Event.SPECULAR_REFLECTION) and p.object >= 0
        ]
        expected[tuple(at)].append(ray)
    pairs = {(pair["first"], pair["second"]): pair for pair in matrix.pairs()}
    assert set(pairs) == set(expected)
    for pair, rays in expected.items():
        assert pairs[pair]["rays"] == len(rays)
        assert pairs[pair]["flux"] == pytest.approx(flux_of(map, rays))
        again = select(map, pairs[pair]["criterion"])
        assert again.matched == len(rays)
        assert pairs[pair]["flux_se"] == pytest.approx(flux_se_of(map, rays), abs=1e-12)
    assert matrix.total == pytest.approx(sum(flux_of(map, rays) for rays in expected.values()))


def test_the_audit_closes(map: Any) -> None:
    audit = query.audit(map)
    classes = query.answers.reports.energy.CLASSES if hasattr(query, "energy") else None
    assert classes is None or len(classes) == audit.rays.shape[1]
    assert (audit.rays.sum(axis=1) + audit.missing == map.emitted).all()
    np.testing.assert_allclose(
        audit.flux.sum(axis=1) + audit.missing_flux, [s.flux for s in map.directory.sources]
    )
    for column, text in enumerate(
        (
            'last(absorbed) & !last(hit("eye", surface_absorption))',
            'last(hit("eye", surface_absorption))',
            "last(left)",
            "last(event(depth_limit, roulette_kill))",
            "last(geometry_error)",
        )
    ):
        found = select(map, text)
        assert audit.rays[:, column].sum() == found.matched
        assert audit.flux[:, column].sum() == pytest.approx(found.flux)
        se = np.sqrt((audit.flux_se[:, column] ** 2).sum())
        assert se == pytest.approx(found.flux_se, abs=1e-12)
    # Of a source whose light all ended here nothing is missing, and that is sure
    for number in range(len(audit.sources)):
        mine = [ray for ray in rays_of(map) if ray.source == number]
        missing = audit.missing_flux[number] != 0.0
        expected = flux_se_of(map, mine) if missing else 0.0
        assert audit.missing_se[number] == pytest.approx(expected, abs=1e-12)
    walls = select(map, 'last(hit("wall", surface_absorption))')
    if walls:
        assert audit.absorbed_rays["wall"].sum() == walls.matched
        assert audit.absorbed_se["wall"] == pytest.approx(walls.flux_se)


def test_illuminated_and_critical_objects(map: Any) -> None:
    result = query.illuminated(map, "screen")
    scattered = int(FAMILIES["scattered"])
    met: dict[Any, list[Ray]] = defaultdict(list)
    for ray in rays_of(map):
        points = ray.points
        mine: list[set[int]] = [set(), set(), set()]
        for k, point in enumerate(points):
            if k == 0 or point.object < 0:
                continue
            if not any(p.event & scattered for p in points[1:k]):
                mine[0].add(point.object)
            for end in range(k, len(points)):
                arrives = any(m[0] == 0 and m[1] for m in points[end].crossings)
                if arrives and not any(p.event & scattered for p in points[k + 1 : end + 1]):
                    mine[1].add(point.object)
                    before = sum(bool(p.event & scattered) for p in points[1:k])
                    if point.event & scattered and not before:
                        mine[2].add(point.object)
        for kind, objects in zip(("lit", "seen", "first_order"), mine, strict=True):
            for number in objects:
                met[kind, number].append(ray)
    for number, row in enumerate(result.objects):
        for kind in ("lit", "seen", "first_order"):
            rays = met[kind, number]
            assert getattr(row, f"{kind}_rays") == len(rays)
            assert getattr(row, f"{kind}_flux") == pytest.approx(flux_of(map, rays))
            se = getattr(row, f"{kind}_flux_se")
            assert se == pytest.approx(flux_se_of(map, rays), abs=1e-12)
    assert set(result.both) == set(result.illuminated) & set(result.critical)


def test_sweeps_tell_sources_apart(map: Any) -> None:
    for row in query.sweep(map, "screen"):
        found = select(map, f'source("{row.source}") & detected("screen")')
        assert row.rays == found.matched
        assert row.flux == pytest.approx(found.flux)
        rays = matching(map, f'source("{row.source}") & detected("screen")')
        assert row.flux_se == pytest.approx(flux_se_of(map, rays), abs=1e-12)
        assert row.transmittance == pytest.approx(found.flux / row.source_flux)


def test_a_map_compared_with_itself_and_with_another(maps: dict[str, Any]) -> None:
    same = query.compare(maps["merged"], maps["merged"])
    assert not same.significant
    assert all(path.difference == 0 for path in same.paths)
    other = query.compare(maps["merged"], maps["weighted"], different_scenes=True)
    assert other.significant
    assert other.total.difference == pytest.approx(
        select(maps["weighted"]).flux - select(maps["merged"]).flux
    )
    z = [abs(path.z) for path in other.paths]
    assert z == sorted(z, reverse=True)


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("lamp a:tir b:tir a:tir b:tir a:tir b:refracted :left",
         "lamp (a:tir b:tir){2} a:tir b :left"),
        ("lamp a:tir a:tir a:tir a:tir @eye", "lamp (a:tir){4} @eye"),
        ("lamp a:tir a:tir a:tir @eye", "lamp a:tir a:tir a:tir @eye"),
        (r"big\ lamp pipe\.body.face_1:refracted :left", r"big\ lamp pipe.body.face_1 :left"),
    ],
)  # fmt: skip
def test_what_repeats_in_a_path_is_shown_once(path: str, shown: str) -> None:
    assert _shorter(path) == shown
