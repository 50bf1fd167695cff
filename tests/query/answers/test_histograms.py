"""Distributions of numbers of rays against sums over all rays, and times against group indices."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import query
import raymap
from raymap.cli import application
from raymap.model.errors import CriterionError, RayMapError
from tests.query.answers.what_if.test_what_if import SCENE, traced

SLAB = """
length_unit = "mm"
flux_unit = "W"
[spectrum]
kind = "spectral"
wavelengths_nm = [WAVELENGTHS]
[media.N-BK7]
glass = "N-BK7"
[media.flat]
index = 1.7
[surfaces.clear]
kind = "dielectric"
reflectance = 0.0
[bodies.slab]
kind = "box"
size = [20, 20, 10]
medium = "N-BK7"
surface = "clear"
[bodies.plate]
kind = "box"
position = [0, 0, 12]
size = [20, 20, 4]
medium = "flat"
surface = "clear"
[sources.beam]
kind = "collimated"
position = [0, 0, -20]
direction = [0, 0, 1]
diameter = 2
flux = 1.0
[detectors.end]
position = [0, 0, 30]
looks = [0, 0, -1]
size = [40, 40]
cells = [4, 4]
blocking = true
"""
CRITERION = 'detected("wall")'


@pytest.fixture(scope="module", params=["W", "lm"])
def base(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    path = tmp_path_factory.mktemp("base") / "a.raymap"
    with traced(path, SCENE.replace("UNIT", request.param), 1, rays=4_000) as ray_map:
        yield ray_map


def group_index_of_bk7(nm: float) -> float:
    """From the derivative of the Sellmeier formula, with the coefficients of the maker's sheet."""
    b = (1.03961212, 0.231792344, 1.01046945)
    c = (0.00600069867, 0.0200179144, 103.560653)
    x = (nm / 1000.0) ** 2
    n = math.sqrt(1.0 + sum(bk * x / (x - ck) for bk, ck in zip(b, c, strict=True)))
    # λ dn/dλ = x d(n²)/dx / n
    slope = sum(-bk * ck / (x - ck) ** 2 for bk, ck in zip(b, c, strict=True))
    return n - x * slope / n


@pytest.mark.parametrize("nm", [486.1, 587.6, 1064.0])
def test_times_are_those_of_pulses(tmp_path: Any, nm: float) -> None:
    with traced(tmp_path / "a.raymap", SLAB.replace("WAVELENGTHS", f"{nm}"), 1, rays=60) as ray_map:
        [one] = query.histogram(ray_map, "time").series
        way = 36.0 + group_index_of_bk7(nm) * 10.0 + 1.7 * 4.0
        assert one.count == 60
        assert one.mean == pytest.approx(way * 1e-3 / 299_792_458.0 * 1e12, rel=3e-7)
        assert one.spread < 1e-3
        assert query.select(ray_map, f"time < {one.mean + 0.01:.6f} ps").matched == 60
        assert query.select(ray_map, f"time < {(one.mean - 0.01) / 1000:.9f} ns").matched == 0


def test_colours_that_part_have_times_of_their_own(tmp_path: Any) -> None:
    """In a glass that disperses light of several channels has no single time."""
    text = SLAB.replace("WAVELENGTHS", "486.1, 587.6, 656.3")
    with traced(tmp_path / "a.raymap", text, 1, rays=60) as ray_map:
        found = query.histogram(ray_map, "time")
        single = query.select(ray_map, "wavelength > 0").matched
        assert found.undefined == ray_map.rays - single
        assert query.histogram(ray_map, "length").undefined == 0


def test_maps_that_do_not_state_group_indices_say_so(tmp_path: Any) -> None:
    with traced(tmp_path / "a.raymap", SLAB.replace("WAVELENGTHS", "587.6"), 1, rays=6) as ray_map:
        [channels] = ray_map.channel_sets
        media: list[Any] = [{} for _ in channels.laws["media"]]
        laws = {**channels.laws, "media": media}
        ray_map.channel_sets[0] = channels.model_copy(update={"laws": laws})
        found = query.histogram(ray_map, "time")
        assert found.series[0].count == 0
        assert found.undefined == ray_map.rays
        assert found.reason == "the map does not say the group index of N-BK7; record it again"


@functools.lru_cache(maxsize=1)
def _told(ray_map: raymap.RayMap) -> list[dict[str, Any]]:
    """What reports say of the rays that register, one by one."""
    ids = query.select(ray_map, CRITERION).ray_ids.tolist()
    return [query.report(ray_map, ray) for ray in ids]


def _numbers(ray_map: raymap.RayMap, quantity: str) -> tuple[Any, Any]:
    """Numbers of the rays that register, and their flux."""
    values, flux = [], []
    for told in _told(ray_map):
        number = {"length": told["length"], "bounces": len(told["points"]) - 2}
        values.append(number.get(quantity, told["flux"]))
        flux.append(told["flux"])
    return np.array(values), np.array(flux)


@pytest.mark.parametrize("quantity", ["length", "bounces", "flux"])
def test_sums_are_those_over_all_rays(base: Any, quantity: str) -> None:
    values, flux = _numbers(base, quantity)
    top = float(values.max()) * 1.0001
    [one] = query.histogram(base, quantity, CRITERION, bins=7, bounds=(0.0, top)).series
    expected, _ = np.histogram(values, np.linspace(0.0, top, 8), weights=flux)
    np.testing.assert_allclose([each.flux for each in one.bins], expected, rtol=1e-4, atol=1e-9)
    assert one.count == len(values)
    mean = np.average(values, weights=flux)
    assert one.mean == pytest.approx(mean, rel=1e-6)
    spread = np.average((values - mean) ** 2, weights=flux) ** 0.5
    assert one.spread == pytest.approx(spread, rel=1e-4)
    order = np.argsort(values)
    held = np.cumsum(flux[order]) / flux.sum()
    for share, value in one.quantiles.items():
        assert value == pytest.approx(values[order][np.searchsorted(held, float(share))], rel=1e-3)
    assert one.cumulative[-1] == pytest.approx(1.0)
    # What reports of single rays say adds up to what the selection says
    told = query.select(base, CRITERION)
    assert flux.sum() == pytest.approx(told.flux, rel=1e-6)
    assert one.flux == pytest.approx(told.flux, rel=1e-9)
    # Squares of what single rays bring, less the square of their sum over all that were emitted
    variance = 0.0
    for number, source in enumerate(base.directory.sources):
        own = np.array([ray["flux"] for ray in _told(base) if ray["source"] == source.name])
        variance += float((own**2).sum() - own.sum() ** 2 / base.emitted[number])
    assert one.flux_se == pytest.approx(math.sqrt(variance), rel=1e-5)


@pytest.mark.parametrize("by", ["path", "source", "object", "wavelength"])
@pytest.mark.parametrize("quantity", ["length", 'incidence(hit("screen"))', "wavelength"])
def test_series_add_up(base: Any, by: Any, quantity: str) -> None:
    [whole] = query.histogram(base, quantity, CRITERION, bins=6).series
    bounds = whole.bins[0].low, whole.bins[-1].high
    parts = query.histogram(base, quantity, CRITERION, bins=6, bounds=bounds, by=by).series
    assert len(parts) > 1
    sums = [sum(part.bins[k].flux for part in parts) for k in range(6)]
    np.testing.assert_allclose(sums, [each.flux for each in whole.bins], rtol=1e-9, atol=1e-12)
    if (by, quantity) == ("source", "length"):
        for part in parts:
            told = query.select(base, f'{CRITERION} & source("{part.name}")')
            assert part.flux == pytest.approx(told.flux, rel=1e-6)
            assert part.flux_se == pytest.approx(told.flux_se, rel=1e-6)
    if (by, quantity) == ("path", "length"):
        row = query.path_table(base, CRITERION).rows(1)[0]
        assert parts[0].name == row.path
        assert parts[0].flux == pytest.approx(row.flux, rel=1e-6)


def test_places_on_detectors_are_those_of_pictures(base: Any) -> None:
    criterion = 'hit("plate")'
    image = query.detector_image(base, "wall", criterion)
    for word, axis in (("u", 0), ("v", 1)):
        asked = f'{word}("wall")'
        [one] = query.histogram(base, asked, criterion, bins=4, bounds=(-20.0, 20.0)).series
        np.testing.assert_allclose(
            [each.flux for each in one.bins], image.flux.sum(axis=axis), rtol=1e-3
        )
    [placed] = query.histogram(base, 'u("plane(z=15, size=[40, 40])")', criterion).series
    assert placed.flux == pytest.approx(image.flux.sum(), rel=1e-3)
    # The beam leaves a plate as it came
    straight = 'path("beam plate.z_min:refracted plate.z_max:refracted @wall .*")'
    [angles] = query.histogram(base, 'angle("wall")', f"{straight} & bounces == 3").series
    assert angles.quantiles["0.5"] == pytest.approx(math.degrees(math.atan(0.2)), rel=1e-3)


def test_errors_of_means_cover_what_they_should(tmp_path: Any) -> None:
    text = SCENE.replace("UNIT", "W")
    with traced(tmp_path / "long.raymap", text, 99, rays=40_000) as ray_map:
        truth = query.histogram(ray_map, "length", CRITERION).series[0]
    inside = np.zeros(3)
    for seed in range(15):
        with traced(tmp_path / "a.raymap", text, seed, rays=1_000) as ray_map:
            one = query.histogram(ray_map, "length", CRITERION).series[0]
        inside += [
            abs(one.mean - truth.mean) < math.hypot(one.mean_se, truth.mean_se),
            abs(one.spread - truth.spread) < math.hypot(one.spread_se, truth.spread_se),
            abs(one.quantiles["0.95"] - truth.quantiles["0.95"])
            < math.hypot(one.quantiles_se["0.95"], truth.quantiles_se["0.95"]),
        ]
    # 68 % of 15, three standard deviations about it
    assert (inside >= 5).all()
    assert inside.sum() < 44


@pytest.mark.parametrize(
    ("quantity", "said"),
    [
        ("lenght", "did you mean length"),
        ('hit("plate")', "no number of a ray"),
        ('u("wal")', "wall"),
        ('x(hit("plat"))', "plate"),
        ("length > 3", "no number of a ray"),
        ("optical_path", "no column"),
    ],
)
def test_what_is_no_number_is_refused(base: Any, quantity: str, said: str) -> None:
    with pytest.raises((CriterionError, RayMapError), match=said):
        query.histogram(base, quantity)


def test_bins_that_cannot_be_are_refused(base: Any) -> None:
    with pytest.raises(RayMapError, match="low to high"):
        query.histogram(base, "length", bounds=(3.0, 3.0))
    with pytest.raises(RayMapError, match="above 0"):
        query.histogram(base, "length", bounds=(0.0, 3.0), log=True)
    with pytest.raises(RayMapError, match="are numbers"):
        query.histogram(base, "length", bounds=(0.0, math.nan))


def test_bins_of_equal_ratios_and_of_whole_numbers(base: Any) -> None:
    bins = query.histogram(base, "length", bins=5, log=True).series[0].bins
    ratios = [each.high / each.low for each in bins]
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-9)
    bins = query.histogram(base, "bounces", CRITERION, bins=500).series[0].bins
    assert all(each.high - each.low == 1.0 for each in bins)
    told = query.select(base, f"{CRITERION} & bounces == {bins[2].low + 0.5:g}")
    assert bins[2].flux == pytest.approx(told.flux, rel=1e-9)


def test_the_command_prints_what_python_says(base: Any) -> None:
    command = ["histogram", str(base.path), "length", CRITERION, "--bins", "4", "--by", "source"]
    told = json.loads(CliRunner().invoke(application(), [*command, "--json"]).stdout)
    found = query.histogram(base, "length", CRITERION, bins=4, by="source")
    assert told["unit"] == "mm"
    assert [each["flux"] for each in told["series"][0]["bins"]] == [
        each.flux for each in found.series[0].bins
    ]
    printed = CliRunner().invoke(application(), [*command, "--cumulative"]).stdout
    assert "100.0%" in printed


def test_columns_of_the_path_table_are_times_of_echoes(tmp_path: Any) -> None:
    """Light that is reflected twice within a plate comes later by a way there and back."""
    text = SLAB.replace("WAVELENGTHS", "905").replace("reflectance = 0.0", "reflectance = 0.3")
    with traced(tmp_path / "a.raymap", text, 1, rays=4_000) as ray_map:
        asked = 'detected("end")'
        found = query.path_numbers(ray_map, "time", asked)
        way = query.path_numbers(ray_map, "length", asked, by="object")
        rows = query.path_table(ray_map, asked).rows(10_000)
        command = ["paths", str(ray_map.path), asked, "--column", "time", "--column", "length"]
        told = json.loads(CliRunner().invoke(application(), [*command, "--json"]).stdout)
        shown = CliRunner().invoke(application(), command).stdout
    assert (found.unit, found.undefined) == ("ps", 0)
    c = 0.299792458
    inside = [2.0 * 1.7 * 4.0 / c, 2.0 * group_index_of_bk7(905.0) * 10.0 / c]
    direct = (50.0 - 14.0 + 1.7 * 4.0 + group_index_of_bk7(905.0) * 10.0) / c
    seen = 0
    for row in rows[:-1]:
        # Each plate that light is reflected twice in, and nowhere else
        plates = [row.path.count(f"{name}.z_min:specular_reflection") for name in ("plate", "slab")]
        back = [row.path.count(f"{name}.z_max:specular_reflection") for name in ("plate", "slab")]
        if plates != back or row.reflections != 2 * sum(plates) or max(plates) > 1:
            continue
        if sum(plates) == 2:
            # In both, or once between them
            continue
        seen += 1
        own = found.of[row.path]
        later = sum(n * each for n, each in zip(plates, inside, strict=True))
        assert own.mean == pytest.approx(direct + later, rel=1e-6)
        assert own.samples == row.rays
        assert own.spread == pytest.approx(0.0, abs=1e-3)
    assert seen == 3
    assert set(found.of) == {row.path for row in rows[:-1]}
    assert sum(each.samples for each in way.of.values()) == sum(row.rays for row in rows)
    assert told[0]["columns"]["time"]["mean"] == pytest.approx(found.of[told[0]["path"]].mean)
    assert told[-1]["columns"] == {"time": None, "length": None}
    assert "time [ps]" in shown


def test_columns_have_the_means_and_errors_of_series(base: Any) -> None:
    for quantity in ("length", 'incidence(hit("plate"))'):
        found = query.path_numbers(base, quantity, CRITERION)
        for series in query.histogram(base, quantity, CRITERION, by="path").series[:5]:
            own = found.of[series.name]
            assert own.samples == series.count
            for name in ("mean", "mean_se", "spread"):
                assert getattr(own, name) == pytest.approx(getattr(series, name), rel=1e-9)
    with pytest.raises(RayMapError, match="with_detectors"):
        query.path_numbers(base, 'u("plane(z=10, size=[9, 9])")', CRITERION)
