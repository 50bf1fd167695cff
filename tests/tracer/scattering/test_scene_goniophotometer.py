"""The general tracer and the compiled plate walk measure the same plate."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import raymap
from raymap.model.errors import SceneError
from tracer.scattering.plates.goniophotometer import AngularGrid, measure_plate
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_exact import reflectance_transmittance
from tracer.scattering.scene_goniophotometer import measure_scene
from tracer.scene.load import parse_scene
from tracer.scene.model import Scene

PLATE = """
length_unit = "mm"
[limits]
depth = 100000
[surfaces.smooth]
kind = "dielectric"
[media.opal]
index = 1.49
absorption = {p}
[media.opal.scattering]
mean_free_path = {m}
phase = {{ kind = "generalized", g = {g}, gamma = {gamma} }}
[bodies.plate]
kind = "box"
size = [4000, 4000, {d}]
position = [0, 0, {half}]
medium = "opal"
surface = "smooth"
[sources.beam]
kind = "collimated"
diameter = 0.1
aim = [0, 0, 0]
distance = 5
direction = [{dx}, 0, {dz}]
"""
GRID = AngularGrid(theta_edges_deg=np.linspace(0.0, 90.0, 10), n_phi=6)


def plate_scene(medium: ScatteringMedium, thickness: float, angle: float) -> Scene:
    text = PLATE.format(
        m=medium.mean_free_path_mm,
        p=medium.absorption_per_mm,
        g=medium.g,
        gamma=medium.gamma,
        d=thickness,
        half=thickness / 2,
        dx=math.sin(math.radians(angle)),
        dz=math.cos(math.radians(angle)),
    )
    return parse_scene(text)


@pytest.mark.parametrize(
    ("m", "p", "g", "gamma", "thickness", "angle"),
    [(0.35, 0.01, 0.35, 10.0, 2.05, 30.0), (0.5, 0.05, 0.8, 1.5, 1.0, 0.0)],
)
def test_general_tracer_equals_the_plate_walk(
    m: float, p: float, g: float, gamma: float, thickness: float, angle: float
) -> None:
    medium = ScatteringMedium(mean_free_path_mm=m, absorption_per_mm=p, g=g, gamma=gamma)
    general = measure_scene(plate_scene(medium, thickness, angle), rays=20_000, grid=GRID)
    walk = measure_plate(medium, thickness, angle, rays=100_000, grid=GRID)
    exact = reflectance_transmittance(medium, thickness, angle)
    assert len(general) == 3
    for light in general:
        assert light.incidence_deg == pytest.approx(angle, abs=1e-3)
        for name in ("reflectance", "transmittance"):
            value, error = getattr(light, name), getattr(light, f"{name}_se")
            # Rays leave to a side, or they do not: the error of a share of all
            assert error == pytest.approx(math.sqrt(value * (1.0 - value) / 20_000), rel=1e-3)
            assert abs(value - getattr(exact, name)[0, 0]) < 4.5 * error + 2e-4
        assert light.reflectance + light.transmittance + light.absorbed == pytest.approx(1.0)
        assert light.scatterings == pytest.approx(walk.scatterings, rel=0.05)
    for name in ("brdf", "btdf"):
        difference = getattr(general[0], name) - getattr(walk, name)
        error = np.hypot(getattr(general[0], f"{name}_se"), getattr(walk, f"{name}_se"))
        z = difference / np.maximum(error, 1e-3)
        assert np.abs(z).max() < 6.0
        assert np.mean(z**2) < 2.0


def test_the_measurement_leaves_a_ray_map_on_request(tmp_path: Path) -> None:
    scene = plate_scene(ScatteringMedium(mean_free_path_mm=1.0, g=0.5), 1.0, 20.0)
    recorded = measure_scene(scene, rays=3_000, grid=GRID, path=tmp_path / "plate.raymap")
    plain = measure_scene(scene, rays=3_000, grid=GRID)
    assert recorded[0].reflectance == pytest.approx(plain[0].reflectance, rel=1e-9)
    np.testing.assert_allclose(recorded[0].btdf, plain[0].btdf, atol=1e-6)
    with raymap.open(tmp_path / "plate.raymap") as stored:
        assert stored.rays == 3_000


def test_scenes_that_cannot_be_measured_are_refused() -> None:
    scene = plate_scene(ScatteringMedium(mean_free_path_mm=1.0), 1.0, 0.0)
    with pytest.raises(SceneError, match="rays"):
        measure_scene(scene, rays=5)
    with pytest.raises(SceneError, match="behind"):
        measure_scene(scene, rays=1000, normal=(0.0, 0.0, 1.0))
