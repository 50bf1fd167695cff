"""A shape of another distribution: what its formula says, in every way of following light."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tests.plugins.installing import HERE, ROOT, install, run
from tests.plugins.raymap_example_kinds.torus import Torus
from tracer.geometry.other_shapes import check_shape

RING, TUBE = 10.0, 3.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def told(site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    script = HERE / "shapes_of_kinds.py"
    done = run(site, str(script), str(tmp_path_factory.mktemp("maps")), folder=ROOT)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def near(found: list[float], right: float) -> None:
    value, error = found
    assert 0.0 < error < 0.05 * right
    assert abs(value - right) < 4.0 * error


def test_its_shadow_is_a_ring(told: dict[str, Any]) -> None:
    near(told["shadow"], ((RING + TUBE) ** 2 - (RING - TUBE) ** 2) / 20.0**2)


def test_light_goes_in_and_out_twice(told: dict[str, Any]) -> None:
    # A beam of 6 x 28 across the axis: both walls of the tube absorb
    y, z = np.meshgrid(*((np.arange(n) + 0.5) / n - 0.5 for n in (4000, 1000)))
    y, z = 28.0 * y, 6.0 * z
    half = np.sqrt(np.maximum(0.0, TUBE**2 - z * z))
    outer, inner = (np.sqrt(np.maximum(0.0, r * r - y * y)) for r in (RING + half, RING - half))
    chord = np.where(half > 0.0, 2.0 * (outer - inner), 0.0)
    near(told["absorbed"], 1.0 - float(np.exp(-0.05 * chord).mean()))


def test_light_is_reflected_about_the_normals_of_the_formula(told: dict[str, Any]) -> None:
    frame = np.array(told["frame"])
    reflected = 0
    for way, stored in zip(told["ways"], told["normals"], strict=True):
        points = np.array(way)
        local = (points - [1.0, 2.0, 60.0]) @ frame
        for k in range(1, len(points) - 1):
            x, y, z = local[k]
            across = math.hypot(x, y)
            assert abs(math.hypot(across - RING, z) - TUBE) < 1e-4
            n = frame @ np.array([x * (across - RING) / across, y * (across - RING) / across, z])
            n /= np.linalg.norm(n)
            np.testing.assert_allclose(np.array(stored[k - 1]) / 32767.0, n, atol=1e-4)
            before, after = points[k] - points[k - 1], points[k + 1] - points[k]
            before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
            if np.linalg.norm(points[k + 1] - points[k]) > 5.0:
                np.testing.assert_allclose(after, before - 2.0 * (before @ n) * n, atol=2e-4)
                reflected += 1
    assert reflected > 1000


def test_no_light_goes_astray_in_glass(told: dict[str, Any]) -> None:
    assert told["natural errors"] == told["polarised errors"] == 0.0
    (one, s1), (other, s2) = told["natural reflected"], told["polarised reflected"]
    assert one > 0.01
    assert abs(one - other) < 4.0 * math.hypot(s1, s2)


def test_aimed_light_and_pinholes_agree_with_the_analog_mode(told: dict[str, Any]) -> None:
    (analog, s1), (aimed, s2) = told["side"], told["aimed"]
    assert 0.0 < s2 < s1 < 0.1 * analog
    assert abs(analog - aimed) < 4.0 * math.hypot(s1, s2)
    # Through 1 mm² of the plane of the detector, of 400 mm², goes a 400th
    seen, error = told["seen"]
    assert abs(seen - analog / 400.0) < 4.0 * math.hypot(error, s1 / 400.0) + 0.03 * seen


def test_it_is_drawn_closed(told: dict[str, Any]) -> None:
    assert told["volume"] == pytest.approx(2.0 * math.pi**2 * RING * TUBE**2, rel=0.01)


def test_it_is_listed(site: Path) -> None:
    done = run(site, "-m", "raymap", "kinds", "shapes")
    assert "torus" in done.stdout
    assert "[raymap-example-kinds]" in done.stdout


def test_a_scene_of_it_cannot_be_traced_without_it(site: Path, tmp_path: Path) -> None:
    code = (
        "import pickle, sys; from tracer import compile_scene, parse_scene; "
        "from tests.plugins.shapes_of_kinds import BEAM, BLACK, HEAD, TORUS; "
        "text = HEAD + BEAM.format(spot='diameter = 4'); "
        "text += TORUS.format(axis='0, 0, 1', what=BLACK); "
        "pickle.dump(compile_scene(parse_scene(text)).arrays, open(sys.argv[1], 'wb'))"
    )
    done = run(site, "-c", code, str(tmp_path / "arrays"), folder=ROOT)
    assert done.returncode == 0, done.stderr
    code = (
        "import pickle, sys; from tracer.transport.wavefront import Wavefront; "
        "Wavefront(pickle.load(open(sys.argv[1], 'rb')), 1).trace(0, 10)"
    )
    done = run(tmp_path, "-c", code, str(tmp_path / "arrays"), folder=ROOT)
    assert done.returncode == 1
    assert "faces of a shape that is not installed here" in done.stderr


class Wrong(Torus):
    """A torus that lies elsewhere than it is met, or has long normals."""

    def __init__(self, box: float, drawn: float) -> None:
        super().__init__(np.zeros(3), np.eye(3), RING, TUBE)
        self.size, self.moved = box, drawn

    def box(self) -> Any:
        return (-self.size,) * 3, (self.size,) * 3

    def drawn(self, segments: int) -> Any:
        vertices, triangles = super().drawn(segments)
        return vertices + self.moved, triangles


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (Wrong(5.0, 0.0), "outside its box"),
        (Wrong(15.0, 1000.0), "no ray meets it where it is drawn"),
    ],
)
def test_functions_that_do_not_fit_together_are_refused(shape: Torus, message: str) -> None:
    with pytest.raises(SceneError, match=f"scene: bodies.t.*{message}"):
        check_shape(shape, "scene: bodies.t")
