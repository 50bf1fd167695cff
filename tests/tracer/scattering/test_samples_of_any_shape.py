"""The goniophotometer on meshes and on stacks of plates."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tracer.scattering.plates.goniophotometer import AngularGrid, Goniogram
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_exact import reflectance_transmittance
from tracer.scattering.scene_goniophotometer import measure_scene
from tracer.scene.load import load_scene, parse_scene

GRID = AngularGrid(theta_edges_deg=np.linspace(0.0, 90.0, 7), n_phi=4)
MEDIUM = ScatteringMedium(mean_free_path_mm=0.5, absorption_per_mm=0.02, g=0.7, gamma=1.5)

HEAD = """
length_unit = "mm"
[limits]
depth = 100000
[surfaces.smooth]
kind = "dielectric"
[media.opal]
index = 1.49
absorption = 0.02
[media.opal.scattering]
mean_free_path = 0.5
phase = {{ kind = "generalized", g = 0.7, gamma = 1.5 }}
[media.clear]
index = 1.5
[sources.beam]
kind = "collimated"
diameter = 0.1
aim = [0, 0, 0]
distance = 5
direction = [{dx}, 0, {dz}]
"""


def head(angle_deg: float) -> str:
    angle = math.radians(angle_deg)
    return HEAD.format(dx=math.sin(angle), dz=math.cos(angle))


def plate(name: str, low: float, high: float, medium: str) -> str:
    return (
        f"[bodies.{name}]\nkind = 'box'\nsize = [4000, 4000, {high - low!r}]\n"
        f"position = [0, 0, {(low + high) / 2!r}]\nmedium = '{medium}'\nsurface = 'smooth'\n"
    )


def mesh(file: str) -> str:
    return (
        f"[bodies.sample]\nkind = 'mesh'\nfile = '{file}'\nscale = 1.0\n"
        "medium = 'opal'\nsurface = 'smooth'\n"
    )


def assert_totals(light: Goniogram, reflectance: float, transmittance: float) -> None:
    for name, expected in (("reflectance", reflectance), ("transmittance", transmittance)):
        value, error = getattr(light, name), getattr(light, f"{name}_se")
        assert abs(value - expected) < 4.5 * error + 2e-4


def test_a_plate_given_as_a_mesh(tmp_path: Path) -> None:
    box = trimesh.creation.box((300.0, 300.0, 1.0))
    box.apply_transform(trimesh.transformations.rotation_matrix(0.4, (0.0, 0.0, 1.0)))
    box.apply_translation((0.0, 0.0, 0.5))
    box.export(tmp_path / "plate.stl")
    text = head(30.0) + mesh("plate.stl")
    (tmp_path / "plate.toml").write_text(text)
    light = measure_scene(load_scene(tmp_path / "plate.toml"), rays=20_000, grid=GRID)[0]
    assert light.incidence_deg == pytest.approx(30.0, abs=1e-3)
    exact = reflectance_transmittance(MEDIUM, 1.0, 30.0)
    assert_totals(light, exact.reflectance[0, 0], exact.transmittance[0, 0])


def test_a_scattering_sphere_keeps_all_light_that_it_does_not_absorb(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    ball.apply_translation((0.0, 0.0, 2.0))
    ball.export(tmp_path / "ball.stl")
    lossless = head(0.0).replace("absorption = 0.02", "absorption = 0.0")
    text = lossless + mesh("ball.stl")
    (tmp_path / "ball.toml").write_text(text)
    light = measure_scene(load_scene(tmp_path / "ball.toml"), rays=2_000, grid=GRID)[0]
    assert light.reflectance + light.transmittance == pytest.approx(1.0, abs=1e-12)
    assert min(light.reflectance, light.transmittance) > 0.1


@pytest.mark.parametrize("end", [0.5, 1.0], ids=["in contact", "overlapping"])
def test_plates_that_touch_are_one_plate(end: float) -> None:
    text = head(20.0) + plate("first", 0.0, end, "opal") + plate("second", 0.5, 1.5, "opal")
    light = measure_scene(parse_scene(text), rays=20_000, grid=GRID)[0]
    exact = reflectance_transmittance(MEDIUM, 1.5, 20.0)
    assert_totals(light, exact.reflectance[0, 0], exact.transmittance[0, 0])


@pytest.mark.parametrize("plates", [2, 4])
def test_a_stack_of_clear_plates(plates: int) -> None:
    """Incoherent pile of plates at normal incidence (Stokes 1862): 2 N r / (1 + (2 N - 1) r)."""
    text = head(0.0) + "".join(
        plate(f"p{k}", 2.0 * k, 2.0 * k + 1.0, "clear") for k in range(plates)
    )
    light = measure_scene(parse_scene(text), rays=20_000, grid=GRID)[0]
    r = 0.04
    expected = 2 * plates * r / (1 + (2 * plates - 1) * r)
    assert_totals(light, expected, 1.0 - expected)


def test_a_stack_of_opal_on_clear() -> None:
    """Opal over glass with a gap: more comes back than from the opal alone, none is lost."""
    lossless = head(0.0).replace("absorption = 0.02", "absorption = 0.0")
    alone, stack = (
        measure_scene(parse_scene(lossless + bodies), rays=20_000, grid=GRID)[0]
        for bodies in (
            plate("opal", 0.0, 1.0, "opal"),
            plate("opal", 0.0, 1.0, "opal") + plate("glass", 1.5, 3.5, "clear"),
        )
    )
    assert stack.reflectance + stack.transmittance == pytest.approx(1.0, abs=1e-12)
    gain = stack.reflectance - alone.reflectance
    assert gain > 5.0 * math.hypot(stack.reflectance_se, alone.reflectance_se)
