"""A lens as one object of a recorded trace, against the same lens of ordinary faces."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import raymap
from raymap.file.checks import check_portion
from raymap.model.errors import MapExists, SceneError
from raymap.model.events import Event
from tracer import compile_scene, parse_scene
from tracer.lens import LensError
from tracer.lens.record import LensTracer, LensTreeTrace, record_lens_trees
from tracer.polarized.record import Polarization, record_polarized
from tracer.run.results import StoppedLight

SCENE = """
length_unit = "mm"
[spectrum]
kind = "rgb"
[surfaces.clear]
kind = "dielectric"
[surfaces.black]
kind = "absorber"
[media.glass]
cauchy = [1.5, 0.005]
absorption = 0.01
[bodies.L1]
kind = "lens"
medium = "glass"
thickness = 6.0
surface = "clear"
rim = "black"
front = { radius = 50.0, semi_diameter = 12.5 }
back = { radius = -50.0, semi_diameter = 12.5 }
[bodies.L2]
kind = "lens"
medium = "glass"
position = [0.0, 0.0, 12.0]
thickness = 3.0
surface = "clear"
rim = "black"
front = { radius = -40.0, semi_diameter = 12.5 }
back = { radius = 60.0, semi_diameter = 12.5 }
[sources.lamp]
kind = "collimated"
position = [0.0, 0.0, -30.0]
direction = [0.0, 0.05, 1.0]
diameter = 24.0
[detectors.film]
position = [0.0, 0.0, 80.0]
looks = [0.0, 0.0, -1.0]
size = [60.0, 60.0]
cells = [3, 3]
blocking = true
[detectors.back]
position = [0.0, 0.0, -20.0]
looks = [0.0, 0.0, 1.0]
size = [80.0, 80.0]
cells = [2, 2]
"""


def test_branches_of_an_emission_carry_all_its_light() -> None:
    compilation = compile_scene(parse_scene(SCENE))
    portion = LensTracer(compilation, 3, depth=6, min_flux=1e-5).trace(0, 200)
    check_portion(portion, compilation.directory, compilation.channel_set)
    assert portion.weight is not None
    assert portion.emission is not None
    emission = portion.emission // LensTreeTrace.max_branches
    total = np.bincount(emission, weights=portion.weight.astype(float), minlength=200)
    np.testing.assert_allclose(total, 1.0, atol=2e-6)
    assert portion.n_rays > 10 * 200
    assert portion.emitted.sum() == 200
    # Hits inside the lenses are recorded like any others
    last = np.cumsum(portion.records_per_ray) - 1
    seen = portion.event[last]
    for ending in ("LEFT_SCENE", "SURFACE_ABSORPTION", "VOLUME_ABSORPTION", "DEPTH_LIMIT"):
        assert np.any(seen & int(Event[ending]) != 0)
    assert np.any(portion.event & int(Event.TIR) != 0)
    inside = portion.medium == compilation.directory.media.index(
        next(m for m in compilation.directory.media if m.name == "glass")
    )
    assert 0.3 < inside.mean() < 0.9
    step = np.linalg.norm(np.diff(portion.position.astype(float), axis=0), axis=1)
    path = portion.extra["optical_path"].astype(float)
    within = np.ones(len(step), np.bool_)
    within[last[:-1]] = False
    ratio = np.diff(path)[within] / np.where(step[within] > 0.1, step[within], np.nan)
    assert np.nanmin(ratio) > 0.99
    assert np.nanmax(ratio) < 1.55


def test_the_primitive_and_ordinary_faces_have_equal_fluxes(tmp_path: Path) -> None:
    scene = parse_scene(SCENE)
    trees, faces = tmp_path / "trees.raymap", tmp_path / "faces.raymap"
    emissions, rays = 1500, 60_000
    with pytest.warns(StoppedLight, match=r"trees of 6 levels .* give trace\.lens_trees"):
        result = record_lens_trees(scene, trees, emissions=emissions, depth=6, min_flux=1e-4)
    analog = record_polarized(scene, faces, polarization=Polarization(states="natural"), rays=rays)
    assert result.rays > emissions
    # How the light ended, and where it was absorbed
    ended, ended_faces = result.audit["lamp"], analog.audit["lamp"]
    for name in ("absorbed", "detected", "left"):
        a, b = ended[name] / emissions, ended_faces[name] / rays
        error = math.sqrt(max(b, 1e-4) / rays) + math.sqrt(max(a * (1 - a), 1e-4) / emissions)
        assert abs(a - b) < 4.0 * error
    assert ended["stopped"] / emissions < 2e-3
    # What the detectors got, cell by cell and channel by channel
    with raymap.open(trees) as one, raymap.open(faces) as other:
        assert one.directory.scene_hash == other.directory.scene_hash
        for name in ("film", "back"):
            (sums, _), (sums2, squares) = one.detector_result(name), other.detector_result(name)  # type: ignore[misc]
            mine, theirs = sums / emissions, sums2 / rays
            error = np.sqrt(squares) / rays + np.sqrt(np.maximum(mine, 1e-5) / emissions)
            assert np.all(np.abs(mine - theirs) < 4.5 * error)
            assert mine.sum() > 1e-3
        # Ghosts: reflected at the back of L2, then at the front of L1
        ghosts = {}
        for label, ray_map, count in (("trees", one, emissions), ("faces", other, rays)):
            total = 0.0
            for stored in ray_map.portions:
                portion = stored.read()
                total += _ghost(portion)
            ghosts[label] = total / count
        expected = ghosts["trees"]
        assert expected > 1e-5
        assert abs(ghosts["faces"] - expected) < 5.0 * math.sqrt(expected / rays) + 1e-5


def _ghost(portion: raymap.Portion) -> float:
    """Weight of rays reflected at L2.back and later at L2.front."""
    reflected = (portion.event & int(Event.SPECULAR_REFLECTION)) != 0
    owner = np.repeat(np.arange(portion.n_rays), portion.records_per_ray)
    on_back = reflected & (portion.object == 1) & (portion.triangle == 1)
    on_front = reflected & (portion.object == 1) & (portion.triangle == 0)
    both = np.intersect1d(np.unique(owner[on_back]), np.unique(owner[on_front]))
    assert portion.weight is not None
    return float(portion.weight[both].astype(float).sum())


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("radius = 60.0, semi", "radius = 60.0, conic = -1.0, semi", r"L2\.back"),
        ("60.0, semi_diameter = 12.5", "60.0, semi_diameter = 12.0", "L2"),
        ('kind = "dielectric"', 'kind = "mirror"\nreflectance = 1.0', r"L1\.front"),
        (
            "[detectors.film]",
            '[bodies.ball]\nkind = "sphere"\nradius = 1.0\nposition = [0.0, 0.0, 40.0]\n'
            'surface = "black"\n[detectors.film]',
            r"bodies\.ball",
        ),
    ],
)  # fmt: skip
def test_scenes_without_primitive_lenses_are_refused(old: str, new: str, named: str) -> None:
    compilation = compile_scene(parse_scene(SCENE.replace(old, new)))
    with pytest.raises(LensError, match=named):
        LensTracer(compilation, 1)


def test_options_are_checked(tmp_path: Path) -> None:
    compilation = compile_scene(parse_scene(SCENE))
    with pytest.raises(LensError, match="depth"):
        LensTracer(compilation, 1, depth=0)
    with pytest.raises(LensError, match="min_flux"):
        LensTracer(compilation, 1, min_flux=-1.0)
    path = tmp_path / "there.raymap"
    path.write_bytes(b"")
    with pytest.raises(MapExists):
        record_lens_trees(compilation, path, emissions=1)


EYE = """
[detectors.eye]
kind = "pinhole"
position = [0, 0, -60]
looks = [0, 0, 1]
field_deg = 50
cells = [4, 4]
"""


def test_lens_trees_refuse_pinholes(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"detectors\.eye: the tracer of whole lenses"):
        record_lens_trees(parse_scene(SCENE + EYE), tmp_path / "a.raymap", emissions=100)
    assert not (tmp_path / "a.raymap").exists()
