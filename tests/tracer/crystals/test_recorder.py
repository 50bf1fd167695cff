"""Recorded paths: fluxes against the full tree, events by which they can be asked for."""

from __future__ import annotations

import numpy as np
import pytest

import raymap
from raymap.model.errors import SceneError
from raymap.model.events import Event
from tracer.optics.crystals.media import isotropic
from tracer.render.branching import trace_tree
from tracer.render.scenes import bodies_of
from tracer.run.recording import record
from tracer.scene.load import parse_scene

SCENE = """
length_unit = "mm"

[spectrum]
kind = "spectral"
wavelengths_nm = [500.0, 600.0]

[limits]
depth = 12

[media.calcite]
crystal = { material = "calcite" }

[bodies.rhomb]
kind = "rhomb"
medium = "calcite"
edge = 30.0
position = [0.0, 0.0, 0.01]
rotation = [0.0, 0.0, 20.0]

[sources.pencil]
kind = "collimated"
position = [4.0, -3.0, 60.0]
direction = [0.1, 0.05, -1.0]
diameter = 1e-9

[detectors.screen]
position = [0.0, 0.0, -10.0]
looks = [0.0, 0.0, 1.0]
size = [60.0, 60.0]
cells = [32, 32]
blocking = true

[detectors.gate]
position = [0.0, 0.0, -5.0]
looks = [0.0, 0.0, 1.0]
size = [60.0, 60.0]
cells = [64, 64]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    scene = bodies_of(parse_scene(SCENE))
    path = tmp_path_factory.mktemp("maps") / "calcite.raymap"
    summary = record(parse_scene(SCENE), path, rays=8000, seed=3, threads=2, portion_rays=3000)
    return scene, path, summary


def test_every_ray_ends_once(recorded):
    _, path, summary = recorded
    audit = summary.audit["pencil"]
    assert audit["emitted"] == 8000 == sum(audit.values()) - audit["emitted"]
    assert audit["errors"] == 0
    with raymap.open(path) as ray_map:
        assert ray_map.rays == 8000
        sums, _ = ray_map.detector_result("screen")
        assert sums.sum() == audit["detected"]


def test_shares_of_the_first_paths_are_those_of_the_tree(recorded):
    scene, path, _ = recorded
    direct = {}
    for wavelength in (500.0, 600.0):
        exits = trace_tree(
            scene, isotropic(1.0), (4.0, -3.0, 60.0), (0.1, 0.05, -1.0),
            wavelength_nm=wavelength, max_events=2,
        )  # fmt: skip
        for events, share in zip(exits.events, exits.share, strict=True):
            direct.setdefault(int(events), []).append(0.5 * share)
    counts = {1: 0, 2: 0}
    with raymap.open(path) as ray_map:
        for portion in ray_map.portions:
            offsets = portion.record_offsets()
            events = np.asarray(portion.column("event"))
            bends = int(Event.SPECULAR_REFRACTION | Event.SPECULAR_REFLECTION | Event.TIR)
            for k in range(portion.n_rays):
                mine = events[offsets[k] : offsets[k + 1]]
                met = int(np.count_nonzero(mine & bends))
                if met in counts:
                    counts[met] += 1
    for events, count in counts.items():
        expected = sum(direct[events])
        sigma = np.sqrt(expected * (1.0 - expected) / 8000)
        assert abs(count / 8000 - expected) < 4.0 * sigma


def test_paths_tell_ordinary_from_extraordinary(recorded):
    _, path, _ = recorded
    with raymap.open(path) as ray_map:
        events = np.concatenate([np.asarray(p.column("event")) for p in ray_map.portions])
    o = np.count_nonzero(events & int(Event.ORDINARY))
    e = np.count_nonzero(events & int(Event.EXTRAORDINARY))
    assert o > 3000
    assert e > 3000
    split = events & int(Event.BIREFRINGENT_SPLIT) != 0
    assert np.all((events[split] & int(Event.ORDINARY | Event.EXTRAORDINARY)) != 0)


def test_the_same_map_whatever_the_portions(recorded, tmp_path):
    _, path, _ = recorded
    again = tmp_path / "again.raymap"
    record(parse_scene(SCENE), again, rays=8000, seed=3, threads=1, portion_rays=8000)
    with raymap.open(path) as first, raymap.open(again) as second:
        for name in ("event", "position", "color_code"):
            a = np.concatenate([np.asarray(p.column(name)) for p in first.portions])
            b = np.concatenate([np.asarray(p.column(name)) for p in second.portions])
            np.testing.assert_array_equal(a, b)


def test_a_wave_on_a_binormal_becomes_a_cone(tmp_path):
    text = """
length_unit = "mm"
[spectrum]
kind = "spectral"
wavelengths_nm = [589.3]

[media.strong.crystal]
indices = [1.3, 1.4, 1.5]
axes = [[{c}, 0.0, {s}], [0.0, 1.0, 0.0], [{ms}, 0.0, {c}]]

[bodies.plate]
kind = "box"
medium = "strong"
size = [20.0, 20.0, 10.0]

[sources.pencil]
kind = "collimated"
position = [0.0, 0.0, 20.0]
direction = [0.0, 0.0, -1.0]
diameter = 1e-9

[detectors.screen]
position = [0.0, 0.0, -5.001]
looks = [0.0, 0.0, 1.0]
size = [5.0, 5.0]
cells = [64, 64]
blocking = true
"""
    x, y, z = (1.0 / np.array([1.3, 1.4, 1.5])) ** 2
    v = np.arctan(np.sqrt((x - y) / (y - z)))
    values = {"c": repr(np.cos(v).item()), "s": repr(np.sin(v).item())}
    scene = parse_scene(text.format(ms=repr(-np.sin(v).item()), **values))
    path = tmp_path / "cone.raymap"
    record(scene, path, rays=2000, threads=1)
    with raymap.open(path) as ray_map:
        portion = ray_map.portions[0]
        events = np.asarray(portion.column("event"))
        assert np.count_nonzero(events & int(Event.CONICAL_REFRACTION)) > 1500
        offsets = portion.record_offsets()
        position = np.asarray(portion.column("position"))
        last = offsets[1:] - 1
        direct = (np.diff(offsets) == 4) & (np.abs(position[last, 2] + 5.001) < 1e-3)
    spots = position[last[direct], :2]
    centre = 0.5 * (spots.min(axis=0) + spots.max(axis=0))
    radius = np.linalg.norm(spots - centre, axis=1)
    assert np.linalg.norm(centre) == pytest.approx(0.7175, abs=2e-3)
    np.testing.assert_allclose(radius, 0.7175, atol=3e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("direction = [0.1, 0.05, -1.0]", "direction = [0, 0, 0]", "direction must"),
        ("cells = [32, 32]", "cells = [0, 32]", "cells"),
        ("depth = 12", "depth = 0", "depth"),
        ("wavelengths_nm = [500.0, 600.0]", "wavelengths_nm = [-5.0]", "wavelengths_nm"),
        ('kind = "rhomb"', 'kind = "ball"', "ball"),
    ],
)
def test_scenes_that_cannot_be_are_refused(old, new, message, tmp_path):
    with pytest.raises(SceneError, match=message):
        record(parse_scene(SCENE.replace(old, new)), tmp_path / "x.raymap", rays=10)
