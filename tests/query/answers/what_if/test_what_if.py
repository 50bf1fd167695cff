"""Changes to a recorded map against the changed scene, traced again; and the laws of changing."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, norm
from typer.testing import CliRunner

import query
import raymap
from raymap.cli import application
from raymap.model.errors import RayMapError, UnknownName
from tracer import parse_scene
from tracer.run.recording import record
from tracer.run.results import StoppedLight

SCENE = """
length_unit = "mm"
flux_unit = "UNIT"
[spectrum]
kind = "spectral"
wavelengths_nm = [450, 550, 650]
[media.glass]
index = 1.6
absorption = 0.02
[media.milk]
index = 1.3
[media.milk.scattering]
mean_free_path = 4.0
albedo = 0.95
phase = { kind = "henyey_greenstein", g = 0.6 }
[surfaces.clear]
kind = "dielectric"
[surfaces.hazy]
kind = "dielectric"
scatter = { abg = [1e-3, 0.01, 2.0] }
[surfaces.layered]
kind = "dielectric"
coating = { between = ["air", "glass"], layers = [{ index = 2.3, thickness_nm = 70 }] }
[surfaces.paint]
kind = "lambertian"
reflectance = 0.5
[surfaces.silver]
kind = "mirror"
metal = { n = 0.06, k = 3.6 }
[bodies.plate]
kind = "box"
size = [20, 20, 4]
medium = "glass"
surface = "clear"
[bodies.screen]
kind = "box"
position = [0, 0, 20]
size = [60, 60, 2]
surface = "paint"
[bodies.mirror]
kind = "box"
position = [0, 0, -20]
size = [60, 60, 2]
surface = "silver"
[bodies.cup]
kind = "box"
position = [0, 14, 0]
size = [6, 6, 6]
medium = "milk"
surface = "clear"
[bodies.window]
kind = "box"
position = [14, 0, 0]
size = [6, 6, 4]
medium = "glass"
surface = "hazy"
[bodies.filter]
kind = "box"
position = [-14, 0, 0]
size = [6, 6, 4]
medium = "glass"
surface = "layered"
[sources.lamp]
kind = "point"
position = [0, 0, -10]
flux = 2.0
[sources.beam]
kind = "collimated"
position = [3, 3, -12]
direction = [0.2, 0, 1]
diameter = 2
flux = 1.0
[detectors.wall]
position = [0, 0, 15]
looks = [0, 0, -1]
size = [40, 40]
cells = [4, 4]
both_sides = true
[limits]
depth = 500
"""
RAYS = 40_000
CRITERIA = (
    None,
    'detected("wall")',
    'hit("plate") & detected("wall")',
    'count(hit("*", reflected)) >= 2',
    'last(hit("screen"))',
    "wavelength < 500",
    "length > 80",
    'hit("cup") & detected("wall", rect(0 mm, 0 mm, 20 mm, 20 mm))',
)
CLEAR = '[surfaces.clear]\nkind = "dielectric"'
FILM = """medium = "glass"
surface = "film"
[surfaces.film]
kind = "dielectric"
[surfaces.film.coating]
between = ["air", "glass"]
layers = [{ index = 1.38, thickness_nm = 100 }]
"""
CASES: dict[str, tuple[tuple[str, str], dict[str, Any]]] = {
    "reflectance": (
        (CLEAR, CLEAR + "\nreflectance = 0.2"),
        {"clear.reflectance": 0.2},
    ),
    "stack": (
        ('medium = "glass"\nsurface = "clear"', FILM),
        {
            "plate.coating": {
                "between": ["air", "glass"],
                "layers": [{"index": 1.38, "thickness_nm": 100}],
            }
        },
    ),
    "thinner": (
        ("index = 2.3, thickness_nm = 70", "index = 2.0, thickness_nm = 40"),
        {
            "filter.coating": {
                "between": ["air", "glass"],
                "layers": [{"index": 2.0, "thickness_nm": 40}],
            }
        },
    ),
    "paint": (("reflectance = 0.5", "reflectance = 0.3"), {"paint.reflectance": 0.3}),
    "coloured": (
        (
            "reflectance = 0.5",
            "reflectance = { wavelength_nm = [450, 550, 650], value = [0.1, 0.5, 0.8] }",
        ),
        {"screen.reflectance": [0.1, 0.5, 0.8]},
    ),
    "black": (('surface = "paint"', 'surface = "absorber"'), {"screen.black": True}),
    "metal": (("n = 0.06, k = 3.6", "n = 1.5, k = 7.0"), {"mirror.metal": {"n": 1.5, "k": 7.0}}),
    "haze": (
        ("[1e-3, 0.01, 2.0]", "[5e-4, 0.02, 1.5]"),
        {"window.scatter": {"abg": [5e-4, 0.02, 1.5]}},
    ),
    "absorption": (("absorption = 0.02", "absorption = 0.1"), {"glass.absorption": 0.1}),
    "scattering": (
        ("mean_free_path = 4.0\nalbedo = 0.95", "mean_free_path = 5.0\nalbedo = 0.9"),
        {"milk.scattering": 0.18, "milk.absorption": 0.02},
    ),
    "dimmed": (("flux = 2.0", "flux = 0.7"), {"lamp.flux": 0.7}),
    "off": (("flux = 2.0", "flux = 2.0\non = false"), {"lamp.on": False}),
    "two": (
        ("reflectance = 0.5", "reflectance = 0.3\n#"),
        {"paint.reflectance": 0.3, "beam.flux": 1.0},
    ),
}


def traced(path: Path, text: str, seed: int, rays: int = RAYS) -> raymap.RayMap:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StoppedLight)
        record(parse_scene(text), path, rays=rays, seed=seed, force=True)
    return raymap.open(path)


@pytest.fixture(scope="module", params=["W", "lm"])
def base(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    text = SCENE.replace("UNIT", request.param)
    with traced(tmp_path_factory.mktemp("base") / "a.raymap", text, 1) as ray_map:
        yield text, ray_map


@pytest.mark.parametrize("case", CASES)
def test_changes_are_those_of_the_scene_traced_again(base: Any, case: str, tmp_path: Path) -> None:
    text, ray_map = base
    (old, new), changes = CASES[case]
    assert old in text
    view = query.what_if(ray_map, changes)
    deviations, squares, n = [], 0.0, 0
    with traced(tmp_path / "b.raymap", text.replace(old, new, 1), 2) as again:
        for criterion in CRITERIA:
            found = query.effect(ray_map, view, criterion)
            told = query.select(again, criterion, rays=False)
            assert found.impossible == 0
            assert found.after.flux == pytest.approx(query.select(view, criterion).flux, rel=5e-5)
            error = np.hypot(found.after.se, told.flux_se)
            if error > 0.0 and found.effective >= query_fewest():
                deviations.append(abs(found.after.flux - told.flux) / error)
        tables = [{row.path: row for row in query.path_table(m).rows(80)} for m in (view, again)]
        for path in set(tables[0]) & set(tables[1]) - {"remainder"}:
            one, other = (table[path] for table in tables)
            spread = one.flux_se**2 + other.flux_se**2
            if min(one.rays, other.rays) > 100 and spread > 0.0:
                squares, n = squares + (one.flux - other.flux) ** 2 / spread, n + 1
        images = [query.detector_image(m, "wall") for m in (view, again)]
    # Of all questions in all cases, none is a hundred times rarer than one in so many
    assert len(deviations) >= 4
    assert 2.0 * norm.sf(max(deviations)) > 1e-2 / (2 * len(CASES) * len(CRITERIA))
    assert n > 5
    assert chi2.sf(squares, n) > 1e-3 / len(CASES)
    spread = images[0].variance + images[1].variance
    cells = spread > 0.0
    flux = [image.flux for image in images]
    squares = float(((flux[0] - flux[1])[cells] ** 2 / spread[cells]).sum())
    assert chi2.sf(squares, int(cells.sum())) > 1e-3 / len(CASES)


def query_fewest() -> int:
    from query.answers.what_if.effect import FEWEST

    return FEWEST


def test_changing_back_gives_the_numbers_of_the_recording(base: Any) -> None:
    _, ray_map = base
    view = query.what_if(ray_map, {"paint.reflectance": 0.5, "lamp.flux": 2.0})
    for criterion in CRITERIA:
        found = query.effect(ray_map, view, criterion)
        assert found.after.flux == pytest.approx(found.before.flux, rel=1e-12)
        assert found.difference_se == pytest.approx(0.0, abs=1e-6 * found.before.flux)


def test_changes_commute(base: Any) -> None:
    _, ray_map = base
    one = {"paint.reflectance": 0.3, "glass.absorption": 0.1, "clear.reflectance": 0.1}
    fluxes = [
        [query.effect(ray_map, query.what_if(ray_map, changes), c).after.flux for c in CRITERIA[:3]]
        for changes in (one, dict(reversed(one.items())))
    ]
    np.testing.assert_allclose(*fluxes, rtol=1e-12)


def test_changes_on_top_of_changes_are_the_changes_together(base: Any) -> None:
    _, ray_map = base
    place = "plane(z=10, size=[40, 40])"
    first = {"paint.reflectance": 0.1, "lamp.flux": 1.0, "lamp.spectrum": [0.6, 0.3, 0.1]}
    second = {
        "paint.reflectance": 0.3, "glass.absorption": 0.1, "beam.flux": 0.5,
        "beam.spectrum": [0.2, 0.2, 0.6],
    }  # fmt: skip
    together = query.what_if(ray_map, {**first, **second})
    one_by_one = query.what_if(query.what_if(ray_map, first), second)
    with_plane = query.what_if(query.with_detectors(query.what_if(ray_map, first), place), second)
    for criterion in CRITERIA[:5]:
        told = query.select(together, criterion).flux
        assert query.select(one_by_one, criterion).flux == pytest.approx(told, rel=1e-9)
        assert query.select(with_plane, criterion).flux == pytest.approx(told, rel=5e-5)
        assert query.effect(ray_map, one_by_one, criterion).after.flux == pytest.approx(
            told, rel=1e-4
        )
    slopes = [query.sensitivity(each, CRITERIA[2]).rows[0] for each in (together, with_plane)]
    assert slopes[0].derivative == pytest.approx(slopes[1].derivative, rel=1e-4)


def test_light_of_all_rays_keeps_its_sum(base: Any) -> None:
    """Whatever is changed without opening what was never drawn, no light is lost or made."""
    _, ray_map = base
    for changes in (
        {"paint.reflectance": 0.2},
        {"clear.reflectance": 0.2},
        {"glass.absorption": 0.1},
    ):
        found = query.effect(ray_map, query.what_if(ray_map, changes), None)
        if ray_map.directory.flux_unit == "W":
            assert abs(found.difference) < 4.0 * found.difference_se + 1e-9


def test_the_error_of_the_difference_is_that_of_shared_rays(base: Any) -> None:
    _, ray_map = base
    view = query.what_if(ray_map, {"paint.reflectance": 0.49})
    found = query.effect(ray_map, view, 'detected("wall")')
    assert 0.0 < found.difference_se < 0.1 * np.hypot(found.before.se, found.after.se)


def test_errors_cover_what_they_should(tmp_path: Path) -> None:
    """Differences from the truth, over their errors, are normal: 30 small maps and a long trace."""
    text = SCENE.replace("UNIT", "W")
    changes = {"clear.reflectance": 0.2, "paint.reflectance": 0.3}
    new = text.replace("reflectance = 0.5", "reflectance = 0.3").replace(
        CLEAR, CLEAR + "\nreflectance = 0.2"
    )
    criterion = 'hit("plate") & detected("wall")'
    with traced(tmp_path / "long.raymap", new, 99, rays=400_000) as ray_map:
        truth = query.select(ray_map, criterion, rays=False)
    inside = 0
    for seed in range(30):
        with traced(tmp_path / "a.raymap", text, seed, rays=3_000) as ray_map:
            after = query.effect(ray_map, query.what_if(ray_map, changes), criterion).after
        inside += abs(after.flux - truth.flux) < np.hypot(after.se, truth.flux_se)
    # 68 % of 30, three standard deviations about it
    assert 12 <= inside <= 28


@pytest.mark.parametrize(
    "changes",
    [
        {"paint.reflectance": 0.3},
        {"paint.reflectance": 0.3, "lamp.flux": 1.0},
        {"paint.reflectance": [0.1, 0.5, 0.8]},
    ],
)
def test_sums_of_the_dictionary_are_those_of_the_rays(base: Any, changes: Any) -> None:
    """Where all rays of a path change alike no ray is looked at, and the answer is the same."""
    _, ray_map = base
    view, plain = (query.what_if(ray_map, changes) for _ in range(2))
    alike = len(set(np.atleast_1d(changes["paint.reflectance"]).tolist())) == 1
    assert (view.path_factors() is not None) == alike
    plain.path_factors = lambda: None  # type: ignore[method-assign]
    for name in ("sum_w", "sum_w2", "sum_wy2"):
        quick, slow = (getattr(each.merged.paths, name) for each in (view, plain))
        if quick is not None:
            np.testing.assert_allclose(quick, slow, rtol=2e-4, atol=1e-12)
    for criterion in CRITERIA:
        quick, slow = (query.effect(ray_map, each, criterion) for each in (view, plain))
        assert quick.rays == slow.rays
        assert quick.opened == slow.opened == ()
        for name in ("difference", "difference_se", "effective"):
            assert getattr(quick, name) == pytest.approx(getattr(slow, name), rel=1e-4, abs=1e-9)
        assert quick.after.flux == pytest.approx(slow.after.flux, rel=1e-5)
        assert quick.after.se == pytest.approx(slow.after.se, rel=1e-5)


def test_what_was_never_drawn_is_named_and_bounded(tmp_path: Path) -> None:
    text = SCENE.replace("UNIT", "W").replace('surface = "paint"', 'surface = "absorber"')
    with traced(tmp_path / "a.raymap", text, 1) as ray_map:
        arrives = query.select(ray_map, 'last(hit("screen"))').flux
        found = query.effect(ray_map, query.what_if(ray_map, {"screen.lambertian": 0.25}), None)
    by_branch: dict[str, float] = {}
    for each in found.opened:
        assert each.face.startswith("screen.")
        by_branch[each.branch] = by_branch.get(each.branch, 0.0) + each.flux
    assert by_branch == {"scattered back": pytest.approx(0.25 * arrives, rel=1e-6)}


def test_lobes_that_directions_do_not_resolve_are_left_out_and_counted(tmp_path: Path) -> None:
    """Normals of 16 bits leave directions 5e-5 unsure: too much for a lobe of 1e-4."""
    narrow = SCENE.replace("UNIT", "W").replace("[1e-3, 0.01, 2.0]", "[5e-4, 1e-8, 2.0]")
    for text, some in ((narrow, True), (SCENE.replace("UNIT", "W"), False)):
        with traced(tmp_path / f"{some}.raymap", text, 1, rays=4_000) as ray_map:
            law = [5e-4, 4e-8, 2.0] if some else [5e-4, 0.02, 1.5]
            view = query.what_if(ray_map, {"window.scatter": {"abg": law}})
            criterion = 'hit("window", scattered)'
            found = query.effect(ray_map, view, criterion)
            assert found.rays > 5
            assert (found.vague >= found.rays) == some
            assert (found.vague == 0) != some
            if some:
                assert found.after.flux == pytest.approx(found.before.flux, rel=0.3)


def test_split_light_is_weighed_too(tmp_path: Path) -> None:
    text = SCENE.replace("UNIT", "W") + '[trace]\nmode = "weighted"\nsplit_depth = 2\n'
    new = text.replace(CLEAR, CLEAR + "\nreflectance = 0.2")
    with (
        traced(tmp_path / "a.raymap", text, 1, rays=15_000) as ray_map,
        traced(tmp_path / "b.raymap", new, 2, rays=15_000) as again,
    ):
        view = query.what_if(ray_map, {"clear.reflectance": 0.2})
        for criterion in ('detected("wall")', 'count(hit("plate", reflected)) >= 1'):
            found = query.effect(ray_map, view, criterion)
            told = query.select(again, criterion)
            error = np.hypot(found.after.se, told.flux_se)
            assert abs(found.after.flux - told.flux) < 4.0 * error


def test_every_question_takes_the_view(base: Any) -> None:
    _, ray_map = base
    view = query.what_if(ray_map, {"screen.black": True})
    assert query.select(view, 'hit("screen", reflected)').flux == 0.0
    assert query.audit(view).flux.shape == query.audit(ray_map).flux.shape
    assert not query.sweep(view, "wall")[0].flux > query.sweep(ray_map, "wall")[0].flux
    assert query.report(view, 5)["ray_id"] == 5
    whole = query.detector_image(view, "wall", None).flux.sum()
    assert whole == pytest.approx(query.detector_image(ray_map, "wall", None).flux.sum(), rel=0.5)


def test_weights_of_few_portions_are_kept(tmp_path: Path) -> None:
    text = SCENE.replace("UNIT", "W")
    path = tmp_path / "a.raymap"
    record(parse_scene(text), path, rays=4_000, portion_rays=100, seed=1)
    with raymap.open(path) as ray_map:
        view = query.what_if(ray_map, {"clear.reflectance": 0.2})
        assert len(view.portions) == 40
        before = query.select(view, "length > 30").flux
        assert sum(portion._factors is not None for portion in view.portions) <= 16
        assert query.select(view, "length > 30").flux == before


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scren.black": True}, "nearest: screen"),
        ({"plate.index": 1.7}, "bends light elsewhere"),
        ({"plate.reflectanc": 0.1}, "nearest: reflectance"),
        ({"plate.reflectance": 1.2}, "at most 1"),
        ({"plate.reflectance": [0.1, 0.2]}, "3 channels"),
        ({"screen.transmittance": 0.8}, "exceed 1"),
        ({"air.scattering": 0.1}, "did not scatter"),
        ({"plate.scatter": {"abg": [1e-3, 0.01, 2.0]}}, "did not scatter"),
        ({"lamp.flux": -1}, "not negative"),
        ({"lamp.flux": 10**400}, "no amount"),
        ({"lamp.flux": float("nan")}, "no amount"),
        ({"plate.reflectance": 10**400}, "numbers"),
        ({"lamp.spectrum": [1e308] * 3}, "from 0 to"),
        ({"plate.coating": {"layers": 5, "between": ["air", "glass"]}}, "layers ="),
        ({"lamp.on": 3}, "true or false"),
        ({"lamb.flux": 3.0}, "lamp"),
        ({"mirror.metal": 3.0}, "n = ..., k = ..."),
        ({"screen.coating": {"layers": []}}, "not that of an interface"),
    ],
)
def test_changes_that_cannot_be_are_refused_in_one_line(base: Any, changes: Any, said: str) -> None:
    _, ray_map = base
    with pytest.raises((RayMapError, UnknownName), match=said.replace(".", r"\.")) as caught:
        query.what_if(ray_map, changes)
    assert "\n" not in str(caught.value)


def test_the_command_prints_before_after_and_paths(base: Any) -> None:
    _, ray_map = base
    command = ["what-if", str(ray_map.path), 'detected("wall")', "--set", "paint.reflectance=30%"]
    shown = CliRunner().invoke(application(), [*command, "--json"])
    assert shown.exit_code == 0, shown.output
    told = json.loads(shown.stdout)
    assert told["flux"] < told["flux_before"]
    assert told["difference"] == pytest.approx(told["flux"] - told["flux_before"])
    assert told["changes"] == {"paint.reflectance": 0.3}
    assert all(
        abs(a["difference"]) >= abs(b["difference"])
        for a, b in zip(told["paths"], told["paths"][1:], strict=False)
    )
    printed = CliRunner().invoke(application(), command).stdout
    assert "difference" in printed
    assert "of equal weight" in printed
    refused = CliRunner().invoke(application(), command[:3])
    assert refused.exit_code != 0
