"""Kinds of another distribution in the tracer: a law of scatter, a surface, a body, a source and a
detector, each against what its formula says."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.plugins.installing import HERE, ROOT, install, run
from tracer import parse_scene
from tracer.surfaces.law import Law, check_law

BEAM = 'length_unit = "mm"\n[sources.beam]\nkind = "collimated"\ndiameter = 1\n'
SCENE = BEAM + '[surfaces.s]\nkind = "phong"\nglossy = 0.5\nexponent = 20\n'


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def told(site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    script = HERE / "laws_of_kinds.py"
    done = run(site, str(script), str(tmp_path_factory.mktemp("maps")), folder=ROOT)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def near(found: list[float], right: float, sigmas: float = 4.0) -> None:
    value, error = found
    assert 0.0 < error < 0.05 * right
    assert abs(value - right) < sigmas * error


def test_a_surface_sends_on_what_its_bsdf_says(told: dict[str, Any]) -> None:
    # At normal incidence: the integral of the diffuse part, and of cos^20 times the cosine
    near(told["phong"], 0.3 + 0.5 * 21.0 / 22.0)


def test_aimed_light_of_a_surface_is_the_light_of_the_analog_mode(told: dict[str, Any]) -> None:
    (analog, s1), (aimed, s2) = told["side"], told["aimed"]
    assert s2 < s1
    assert abs(analog - aimed) < 4.0 * math.hypot(s1, s2)


def test_a_pinhole_sees_a_surface_by_its_bsdf(told: dict[str, Any]) -> None:
    # Flux through a pinhole of 1 mm² from a spot of unit flux, 30 degrees from the normal
    cosine = 51.96 / math.hypot(30.0, 51.96)
    bsdf = 0.3 / math.pi + 0.5 * 21.0 / (2.0 * math.pi) * cosine**20
    right = bsdf * cosine / (30.0**2 + 51.96**2)
    assert told["seen"][0] == pytest.approx(right, rel=2e-3)


def test_a_law_of_scatter_takes_its_integral_from_the_mirror(told: dict[str, Any]) -> None:
    # 2 pi A times the integral of (1 + B² rho²)^-1.5 rho from 0 to 1
    a, b = 20.0, 50.0
    near(told["scattered"], 2.0 * math.pi * a / b**2 * (1.0 - 1.0 / math.sqrt(1.0 + b * b)))
    kind, parameters = told["stored"]
    assert kind == "mirror"
    assert parameters["scatter"] == {"k_correlation": [a, b, 3.0]}


def test_a_source_emits_by_its_law(told: dict[str, Any]) -> None:
    spreads = np.tan(np.radians([10.0, 25.0]))
    # The standard deviation of 20,000 normal numbers is known to 0.5 %
    np.testing.assert_allclose(told["slopes"], spreads, rtol=0.02)
    way = np.array([20.0, 30.0, 100.0])
    a, b = way[:2] / way[2] / spreads
    density = math.exp(-0.5 * (a * a + b * b)) / (2.0 * math.pi * spreads[0] * spreads[1])
    r2 = float(way @ way)
    right = density / (way[2] / math.sqrt(r2)) ** 3 / r2
    assert told["diode seen"][0] == pytest.approx(right, rel=2e-3)


def test_a_detector_registers_what_its_function_says(told: dict[str, Any]) -> None:
    # The side of a cylinder about a point: the sine of its half height
    right = 20.0 / math.hypot(20.0, 30.0)
    near(told["drum"], right)
    near(told["drum picture"], right)
    quantity, area = told["drum area"]
    assert quantity == "area"
    assert area == pytest.approx(1e-6 * 2.0 * math.pi * 30.0 * 40.0, rel=1e-6)


def test_a_body_has_its_volume_and_a_closed_surface(told: dict[str, Any]) -> None:
    assert told["volume"] == pytest.approx(10.0 * 10.0 * 12.0 / 3.0, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SCENE.replace("phong", "fong"), "there is no surface 'fong'"),
        (SCENE.replace("exponent", "exponant"), "a phong surface has no exponant; it takes"),
        (SCENE + "diffuse = 0.7", "diffuse and glossy are more than 1 together"),
        (
            BEAM + '[surfaces.s]\nkind = "mirror"\nscatter = { k_correlation = [1.0, 2.0] }',
            "write k_correlation = [A, B, C], a list of 3 numbers",
        ),
        (BEAM.replace("collimated", "diod"), "there is no source 'diod'; did you mean 'diode'"),
        (BEAM + '[bodies.p]\nkind = "pyramids"', "did you mean 'pyramid'"),
        (BEAM + '[detectors.d]\nkind = "drumm"', "did you mean 'drum'"),
    ],
)
def test_slips_are_told_as_with_kinds_of_our_own(
    site: Path, tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    done = run(site, "-m", "raymap", "check", "scene.toml", folder=tmp_path)
    assert done.returncode == 1
    assert message in done.stderr


@pytest.mark.parametrize("sort", ["surfaces", "scatter_laws", "bodies", "sources", "detectors"])
def test_the_tables_of_kinds_say_whose_they_are(site: Path, sort: str) -> None:
    done = run(site, "-m", "raymap", "kinds", sort)
    assert done.returncode == 0, done.stderr
    assert any(line.endswith("[raymap-example-kinds]") for line in done.stdout.splitlines())


def test_without_the_distribution_its_kinds_are_unknown() -> None:
    with pytest.raises(Exception, match="there is no surface 'phong'"):
        parse_scene(SCENE)


class Plain:
    """A function as if it were compiled."""

    def __init__(self, function: Any) -> None:
        self.py_func = function


@pytest.mark.parametrize(
    ("bsdf", "way", "density", "message"),
    [
        (1.0, (0.0, 0.0, 1.0), 1.0 / math.pi, "sends on 3.142 times the light of channel 0"),
        (0.1, (0.0, 0.0, 2.0), 1.0, "no unit vector"),
        (0.1, (0.0, 0.0, 1.0), 0.0, "has the density 0"),
        (math.nan, (0.0, 0.0, 1.0), 1.0, "sends on nan"),
    ],
)
def test_laws_that_do_not_fit_together_are_refused(
    bsdf: float, way: tuple[float, float, float], density: float, message: str
) -> None:
    law = Law(
        sample=Plain(lambda *_: way), evaluate=Plain(lambda *_: bsdf), pdf=Plain(lambda *_: density)
    )
    with pytest.raises(Exception, match=message):
        check_law(law, np.zeros(1), 1.0, 1.0, 1, "scene: surfaces.s")


def test_a_broken_neighbour_does_not_stop_scenes_that_do_without_it(tmp_path: Path) -> None:
    site = install(tmp_path, {"tracer.surfaces": {"broken": "raymap_example_kinds.nothing:Broken"}})
    text = BEAM + '[surfaces.s]\nkind = "retroreflector"\nreflectance = 0.9\n'
    text += '[bodies.b]\nkind = "rectangle"\nsize = [9, 9]\nsurface = "s"\nposition = [0, 0, 9]\n'
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    command = ("-m", "raymap", "record", "scene.toml", "-o", "a.raymap", "--rays", "100")
    done = run(site, *command, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    done = run(site, "-m", "raymap", "kinds", "surfaces", folder=tmp_path)
    assert done.returncode == 1
    assert "raymap-example-kinds" in done.stderr
