"""What a scene sets is obeyed or refused by name, whichever tracer takes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from raymap.model.errors import RayMapError, SceneError
from tracer import compile_scene, parse_scene
from tracer.lens.record import record_lens_trees
from tracer.polarized.record import record_polarized
from tracer.render.load import load_render_text
from tracer.scattering.scene_goniophotometer import measure_scene
from tracer.scene.supported import NaturalLight
from tracer.studies.lens import examine

WEIGHTED = '[trace]\nmode = "weighted"\nmin_reflection = 0.3\n'
PLATE = """
length_unit = "mm"
[media.glass]
index = 1.52
[surfaces.clear]
kind = "dielectric"
[surfaces.coated]
kind = "dielectric"
coating = { between = ["air", "glass"], layers = [{ index = 2.3, thickness_nm = 70 }] }
[surfaces.measured]
kind = "dielectric"
[surfaces.measured.coating]
wavelength_nm = [400, 700]
angle_deg = [0, 90]
reflectance = [[0.1, 0.1], [0.1, 0.1]]
transmittance = [[0.9, 0.9], [0.9, 0.9]]
[surfaces.silver]
kind = "mirror"
metal = { n = 0.06, k = 3.6 }
[surfaces.rough]
kind = "rough_dielectric"
roughness = 0.2
[surfaces.hazy]
kind = "dielectric"
scatter = { abg = [1e-4, 0.01, 2.0] }
[surfaces.sheet]
kind = "filter"
transmittance = 0.9
[surfaces.half]
kind = "dielectric"
reflectance = 0.5
[surfaces.ideal]
kind = "mirror"
reflectance = 0.9
[surfaces.white]
kind = "lambertian"
reflectance = 0.5
[bodies.plate]
kind = "box"
size = [20, 20, 2]
medium = "glass"
surface = "SURFACE"
[sources.lamp]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 1
"""
CRYSTAL = """
length_unit = "mm"
[spectrum]
kind = "spectral"
wavelengths_nm = [550]
[media.calcite]
crystal = { material = "calcite" }
[bodies.rhomb]
kind = "rhomb"
medium = "calcite"
edge = 30
[sources.pencil]
kind = "collimated"
position = [0, 0, 60]
direction = [0, 0, -1]
diameter = 1
[detectors.screen]
position = [0, 0, -40]
looks = [0, 0, 1]
size = [20, 20]
cells = [10, 10]
"""
LENS = """
length_unit = "mm"
[media.glass]
index = 1.5
[bodies.lens]
kind = "lens"
medium = "glass"
thickness = 4
diameter = 10
front = { radius = 50 }
back = { radius = -50 }
[sources.lamp]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 1
[detectors.screen]
position = [0, 0, 50]
looks = [0, 0, -1]
size = [20, 20]
cells = [10, 10]
blocking = true
"""


def plate(surface: str = "clear", more: str = "") -> str:
    return PLATE.replace("SURFACE", surface) + more


@pytest.mark.parametrize(
    "surface",
    ["clear", "half", "ideal", "white", "coated", "silver", "rough", "hazy", "sheet"],
)
def test_polarised_light_takes_faces_of_every_law(surface: str) -> None:
    unused = plate(surface)
    assert record_polarized(parse_scene(unused), None, rays=200).rays == 200


def _trees(path: Path) -> Any:
    return record_lens_trees(parse_scene(LENS + WEIGHTED), path, emissions=10)


def _goniophotometer(path: Path) -> Any:
    return measure_scene(parse_scene(plate(more=WEIGHTED)), normal=(0, 0, -1), rays=1000)


def _render(path: Path) -> Any:
    picture = """
[room]
low = [-50, -50, -50]
high = [50, 50, 50]
all = [1, 1, 1]
[camera]
position = [0, 0, 45]
target = [0, 0, 0]
sensor = [10, 10]
focal_length = 10
pixels = [4, 4]
"""
    return load_render_text(CRYSTAL + WEIGHTED + picture)


@pytest.mark.parametrize("engine", [_trees, _goniophotometer, _render])
def test_a_tracer_without_weights_refuses_the_weighted_mode(engine: Any, tmp_path: Path) -> None:
    target = tmp_path / "map.raymap"
    with pytest.raises(SceneError, match=r"trace\.mode: .*min_reflection.*no effect"):
        engine(target)
    assert not target.exists()


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        (
            '[bodies.rhomb]\nkind = "rhomb"\n',
            '[surfaces.s]\nkind = "dielectric"\nreflectance = 0.2\n'
            '[bodies.rhomb]\nkind = "rhomb"\nsurface = "s"\n',
            "bodies.rhomb: 's'",
        ),
        (
            '[bodies.rhomb]\nkind = "rhomb"\n',
            '[surfaces.s]\nkind = "dielectric"\nscatter = { abg = [1e-4, 0.01, 2] }\n'
            '[bodies.rhomb]\nkind = "rhomb"\nsurface = "s"\n',
            "bodies.rhomb: 's'",
        ),
    ],
)
def test_crystals_refuse_what_they_do_not_know(old: str, new: str, key: str) -> None:
    assert old in CRYSTAL
    with pytest.raises(SceneError, match=key):
        examine(parse_scene(CRYSTAL.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("diameter = 10\n", "diameter = 10\nhole = 1\n", "hole"),
        ("diameter = 10\n", 'diameter = 10\nrim = "bare"\n', "rim"),
        ("blocking = true", 'blocking = true\nsurface = "bare"', "screen.surface"),
        ("index = 1.5", "index = 1.5\nscattering = { mean_free_path = 1 }", "scatters"),
        ("diameter = 1\n", "diameter = 1\npolarisation = [1, 0, 0]\n", "lamp.polarisation"),
    ],
)
def test_lens_trees_refuse_what_they_do_not_know(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    assert old in LENS
    target = tmp_path / "map.raymap"
    with pytest.raises(RayMapError, match=said):
        record_lens_trees(parse_scene(LENS.replace(old, new)), target, emissions=10)
    assert not target.exists()


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('states = "natural"', r"states goes with light = 'polarised'"),
        ("phases = true", r"phases goes with light = 'polarised'"),
        ('polarisers = { "lens.front" = [0, 1, 0] }', r"polarisers are surfaces now"),
        ("min_flux = 1e-3", r"min_flux goes with lens_trees"),
        ('lens_trees = 4\nlight = "polarised"', r"lens_trees start from natural light"),
        ("min_reflection = 0.1", r"min_reflection goes with mode = 'weighted'"),
    ],
)
def test_keys_of_other_light_are_refused(keys: str, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        parse_scene(f"{LENS}[trace]\n{keys}\n")


@pytest.mark.parametrize("key", ['light = "polarised"', "lens_trees = 4"])
def test_crystals_refuse_light_of_another_kind(key: str, tmp_path: Path) -> None:
    from tracer.run.recording import record

    with pytest.raises(SceneError, match=rf"trace\.{key.split(' ', maxsplit=1)[0]}"):
        record(parse_scene(f"{CRYSTAL}[trace]\n{key}\n"), tmp_path / "a.raymap", rays=10)


def test_the_former_command_says_what_to_write(run: Any) -> None:
    code, _, error = run("record-polarized", "scene.toml", "-o", "a.raymap", "--lens-trees", "4")
    assert code == 1
    assert error.count("\n") == 1
    assert "light = 'polarised'" in error


@pytest.mark.parametrize(
    "keys",
    [
        "kind = 'polariser'\nabsorbs = [1, 0, 0]",
        "kind = 'retarder'\nslow = [1, 0, 0]\nretardance_nm = 100",
    ],
)
def test_sheets_for_polarised_light_are_warned_about_in_natural_light(keys: str) -> None:
    with pytest.warns(NaturalLight, match=r"surfaces\.film: a \w+ does to natural light"):
        examine(parse_scene(plate(more=f"[surfaces.film]\n{keys}\n")))


def test_a_vibration_that_natural_light_does_not_heed_is_warned_about() -> None:
    lit = plate(more="polarisation = [1, 0, 0]\n")
    with pytest.warns(NaturalLight, match=r"sources\.lamp\.polarisation has no effect"):
        examine(parse_scene(lit))
    assert compile_scene(parse_scene(lit))


@pytest.mark.parametrize(
    ("key", "value", "needed"), [("aim_share", 0.2, "aim"), ("rays_per_emission", 8, "split_depth")]
)
def test_settings_of_what_is_not_done_are_refused(key: str, value: float, needed: str) -> None:
    with pytest.raises(SceneError, match=f"{key} goes with {needed}"):
        parse_scene(plate(more=f"{WEIGHTED}{key} = {value}\n"))
