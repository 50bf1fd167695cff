"""Path tables, studies, pictures and reports against sums over single rays."""

from __future__ import annotations

import threading
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import query
import raymap
from query import select
from raymap import RayMapError
from raymap.errors import CriterionError, RayNotFound
from raymap.events import FAMILIES, Event
from tests.naive.interpreter import Interpreter, Ray, rays_of
from tests.query.random_maps import write_random_map

KINDS: dict[str, dict[str, Any]] = {
    "merged": {"rays": 300, "paths": 60},
    "unfinished": {"rays": 300, "paths": 60, "finish": False},
    "weighted": {"rays": 300, "paths": 60, "weights": True, "gaps": True},
    "split": {"rays": 300, "paths": 60, "weights": True, "emissions": True},
    "plain": {"rays": 200, "plain": True},
}


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder: Path = tmp_path_factory.mktemp("answers")
    opened = {
        name: raymap.open(write_random_map(folder / f"{name}.raymap", seed, **options))
        for seed, (name, options) in enumerate(KINDS.items(), 10)
    }
    yield opened
    for map in opened.values():
        map.close()


@pytest.fixture(params=list(KINDS))
def map(request: pytest.FixtureRequest, maps: dict[str, Any]) -> Any:
    return maps[request.param]


def flux_of(map: Any, rays: list[Ray]) -> float:
    sources = map.directory.sources
    return sum(sources[ray.source].flux / map.emitted[ray.source] * ray.weight for ray in rays)


def matching(map: Any, criterion: str) -> list[Ray]:
    oracle, tree = Interpreter(map), query.parse(criterion)
    return [ray for ray in rays_of(map) if oracle.ray(tree, ray)]


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


def test_the_remainder_makes_it_whole(map: Any) -> None:
    table = query.path_table(map, 'hit("*")')
    whole = select(map, 'hit("*")')
    for top in (0, 1, 3):
        rows = table.rows(top)
        assert len(rows) == top + 1
        assert rows[-1].path == "remainder"
        assert sum(row.share for row in rows) == pytest.approx(1)
    assert table.rows(0)[-1].flux == pytest.approx(whole.flux)
    assert table.rows(0)[-1].flux_se == pytest.approx(whole.flux_se)
    few = table.filter(min_share=0.1)
    assert all(row.share >= 0.1 for row in few.rows()[:-1])
    assert sum(row.share for row in few.rows()) == pytest.approx(1)


def test_a_table_prints_as_a_table(map: Any) -> None:
    table = query.path_table(map, 'hit("*")')
    head, *lines = str(table).splitlines()
    rows = table.rows(20)
    assert head.split()[0] == "rays"
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
        assert again.flux_se == pytest.approx(pairs[pair]["flux_se"])
    assert matrix.total == pytest.approx(sum(flux_of(map, rays) for rays in expected.values()))


def test_the_audit_closes(map: Any) -> None:
    audit = query.audit(map)
    classes = query.energy.CLASSES if hasattr(query, "energy") else None
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
    walls = select(map, 'last(hit("wall", surface_absorption))')
    if walls:
        assert audit.absorbed_rays["wall"].sum() == walls.matched


def test_illuminated_and_critical_objects(map: Any) -> None:
    result = query.illuminated(map, "screen")
    scattered = int(FAMILIES["scattered"])
    lit: Counter[int] = Counter()
    seen: Counter[int] = Counter()
    first_order: Counter[int] = Counter()
    for ray in rays_of(map):
        points = ray.points
        mine: list[set[int]] = [set(), set(), set()]
        for k, point in enumerate(points):
            if k == 0 or point.object < 0:
                continue
            if not any(p.event & scattered for p in points[1:k]):
                mine[0].add(point.object)
            for end in range(k, len(points)):
                arrives = any(m[0] == 0 and m[1] for m in points[end].meetings)
                if arrives and not any(p.event & scattered for p in points[k + 1 : end + 1]):
                    mine[1].add(point.object)
                    before = sum(bool(p.event & scattered) for p in points[1:k])
                    if point.event & scattered and not before:
                        mine[2].add(point.object)
        for counter, objects in zip((lit, seen, first_order), mine, strict=True):
            counter.update(objects)
    for number, row in enumerate(result.objects):
        assert row.lit_rays == lit[number]
        assert row.seen_rays == seen[number]
        assert row.first_order_rays == first_order[number]
    assert set(result.both) == set(result.illuminated) & set(result.critical)


def test_sweeps_tell_sources_apart(map: Any) -> None:
    for row in query.sweep(map, "screen"):
        found = select(map, f'source("{row.source}") & detected("screen")')
        assert row.rays == found.matched
        assert row.flux == pytest.approx(found.flux)
        assert row.flux_se == pytest.approx(found.flux_se)
        assert row.transmittance == pytest.approx(found.flux / row.source_flux)


def test_a_map_compared_with_itself_and_with_another(maps: dict[str, Any]) -> None:
    same = query.compare(maps["merged"], maps["merged"])
    assert not same.significant
    assert all(path.difference == 0 for path in same.paths)
    other = query.compare(maps["merged"], maps["weighted"])
    assert other.significant
    assert other.total.difference == pytest.approx(
        select(maps["weighted"]).flux - select(maps["merged"]).flux
    )
    z = [abs(path.z) for path in other.paths]
    assert z == sorted(z, reverse=True)


# Pictures.


def test_pictures_are_sums_over_registrations(map: Any) -> None:
    layers = {"all": None, "reflected": "event(reflected)", "part": 'hit("L*") & !event(left)'}
    pictures = query.detector_images(map, "screen", layers)
    for name, criterion in layers.items():
        width, height = 8, 6
        flux, rays = np.zeros((height, width)), np.zeros((height, width))
        for ray in rays_of(map) if criterion is None else matching(map, criterion):
            for point in ray.points:
                for detector, registered, uv in point.meetings:
                    if detector == 0 and registered:
                        cell = [
                            min(uv[k] * n // 65535, n - 1) for k, n in enumerate((width, height))
                        ]
                        flux[cell[1], cell[0]] += flux_of(map, [ray])
                        rays[cell[1], cell[0]] += 1
        picture = pictures[name]
        np.testing.assert_allclose(picture.flux, flux, rtol=1e-4, atol=1e-9)
        np.testing.assert_array_equal(picture.rays, rays)
        np.testing.assert_allclose(picture.irradiance, flux / 4e-6, rtol=1e-4, atol=1e-3)
        # 16 x 12 mm in 8 x 6 cells: 4 mm² each; luminous efficacies of the channels.
        efficacy = np.array([25.0, 680.0, 73.0])
        np.testing.assert_allclose(picture.illuminance, picture.channels @ efficacy / 4e-6)


def test_blocks_of_cells_are_sums(map: Any) -> None:
    fine = query.detector_image(map, "screen")
    coarse = query.detector_image(map, "screen", bin=2)
    assert coarse.detector.cells == (4, 3)
    for name in ("channels", "rays"):
        values = getattr(fine, name)
        blocks = values.reshape(3, 2, 4, 2, *values.shape[2:]).sum(axis=(1, 3))
        np.testing.assert_allclose(getattr(coarse, name), blocks, rtol=1e-6)
    np.testing.assert_allclose(coarse.irradiance.mean(), fine.irradiance.mean(), rtol=1e-6)
    # What one emission brings to several cells of a block goes together
    blocks = fine.variance.reshape(3, 2, 4, 2).sum(axis=(1, 3))
    assert (coarse.variance >= blocks * (1 - 1e-12)).all()
    with pytest.raises(RayMapError, match="sides that fit: 2"):
        query.detector_image(map, "screen", bin=3)


def test_the_grain_of_a_picture(maps: dict[str, Any]) -> None:
    picture = query.detector_image(maps["merged"], "screen")
    assert picture.grain == pytest.approx(
        1 / np.sqrt(np.median(picture.rays[picture.rays > 0])), rel=0.5
    )
    side, reached = picture.calmer()
    assert side == 2
    coarse = query.detector_image(maps["merged"], "screen", bin=2)
    assert reached == pytest.approx(coarse.grain, rel=0.1)
    assert picture.calmer(grain=1.0) is None
    eye = query.detector_image(maps["merged"], "eye", 'source("*") & !source("*")')
    assert (eye.grain, eye.calmer()) == (None, None)


def test_picture_files(maps: dict[str, Any], tmp_path: Path) -> None:
    picture = query.detector_image(maps["merged"], "screen")
    query.write_image(picture, tmp_path / "a.npy", "flux")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), picture.flux)
    query.write_image(picture, tmp_path / "a.png")
    query.write_image(picture, tmp_path / "b.png", "flux")
    image = pytest.importorskip("PIL.Image")
    with image.open(tmp_path / "a.png") as file:
        np.testing.assert_array_equal(np.asarray(file)[::-1], picture.srgb())
    with image.open(tmp_path / "b.png") as file:
        grey = np.asarray(file)[::-1].astype(float)
    np.testing.assert_allclose(grey / 65535, picture.flux / picture.flux.max(), atol=1e-5)
    for name, kind in (("a.jpg", "rgb"), ("a.png", "colour"), ("a.png", "spectral")):
        with pytest.raises(RayMapError):
            query.write_image(picture, tmp_path / name, kind)
    with pytest.raises(RayMapError, match="no folder"):
        query.write_image(picture, tmp_path / "missing" / "a.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npy", "a.png", "b.png"]


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
            assert [met["registered"] for met in point["detectors"]] == [m[1] for m in own.meetings]
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


# Filter strings.


@pytest.mark.parametrize(
    ("text", "criterion"),
    [
        ("H1", 'hit("L1")'),
        ("M4", '!hit("wall")'),
        ("L5", 'last(hit("eye"))'),
        ("R1 & !T2", 'hit("L1", reflected) & !hit("L2", transmitted)'),
        ("(H1 | S3) ^ O2", '(hit("L1") | hit("mesh\\.a", scattered)) ^ source("sun")'),
        ("G0 & O1", 'hit("*", specular_reflection) & source("lamp")'),
        ("B0", "event(volume_scatter)"),
        ("W2", "wavelength == 550 nm"),
        ("X_HITFACE(1, 2)", 'hit("L1.back")'),
        ("X_HITFACE2(1,1,2)", 'count(hit("L1.front")) == 2'),
        ("X_HITFACE(1,0)", 'hit("L1.rim")'),
        ("X_GHOST(1, 1)", 'count(hit("L1", specular_reflection)) == 1'),
        ("H1&H2|H3", 'hit("L1") & hit("L2") | hit("mesh\\.a")'),
    ],
)
def test_filter_strings(text: str, criterion: str, maps: dict[str, Any]) -> None:
    assert query.translate(text, maps["merged"]) == query.parse(criterion)


def test_filter_strings_of_volumes_and_paths(maps: dict[str, Any]) -> None:
    map = maps["merged"]
    inside = query.translate("B1", map)
    expected = []
    for ray in rays_of(map):
        last = -1
        hit = False
        for point in ray.points[1:]:
            hit |= bool(point.event & int(Event.VOLUME_SCATTER)) and last == 0
            last = point.object if point.object >= 0 else last
        if hit:
            expected.append(ray.id)
    assert set(select(map, inside).ray_ids.tolist()) <= set(expected)
    strongest = query.path_table(map, by="object").rows(1)[0]
    assert select(map, query.translate("_1", map)).matched == strongest.rays


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("D3", "D3 cannot be translated: diffraction"),
        ("H1 & E2", "E2 cannot be translated"),
        ("J1", "J1 cannot be translated"),
        ("X_WAVERANGE(1,2)", "X_WAVERANGE cannot be translated"),
        ("H9", "there is no object 9"),
        ("O7", "there is no source 7"),
        ("W9", "there is no channel 9"),
        ("_999", "there is no path 999"),
        ("X_HITFACE(1,9)", "has no face 9"),
        ("X_HITFACE2(1,2)", "takes 3 whole numbers"),
        ("H1 &", "ends too early"),
        ("(H1", "never closed"),
        ("H1)", "closes nothing"),
        ("h1", "no filter flag"),
        ("", "ends too early"),
        ("(" * 500 + "H1" + ")" * 500, "deeper"),
    ],
)
def test_filter_strings_that_cannot_be_translated(
    text: str, message: str, maps: dict[str, Any]
) -> None:
    with pytest.raises(CriterionError, match=message):
        query.translate(text, maps["merged"])


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
