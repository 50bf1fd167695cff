"""Rays of programs with a Python interface: the recorder, Mitsuba, pvtrace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import query
import raymap
from raymap.file.verify import verify
from raymap.foreign.recorder import Point, RayRecorder
from raymap.model.errors import InvalidPortion, MapExists
from raymap.model.events import Event

OBJECTS: dict[str, tuple[str, ...]] = {"ball": (), "floor": ("top", "bottom")}
START = Point(position=(0, 0, 3), event=Event.EMITTED)
END = Point(
    position=(0, 0, 0),
    event=Event.SURFACE_ABSORPTION,
    object="floor",
    face="bottom",
    normal=(0, 0, 5),
)


def recorder(path: Path, **more: Any) -> RayRecorder:
    options: dict[str, Any] = {
        "objects": OBJECTS,
        "sources": {"lamp": 2.0, "sun": 6.0},
        "radius": 9,
    }
    return RayRecorder(path, **(options | more))


def test_points_become_a_map(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.raymap", media={"air": 1.0, "glass": 1.5}) as record:
        for number in range(10):
            ball = Point(
                position=(0, 0, 2),
                event=Event.SPECULAR_REFRACTION,
                object="ball",
                medium="glass",
                color=(1, 2, 0),
            )
            points = (
                [START, ball, END] if number % 2 else [START, record.leave((0, 0, 3), (0, 3, 4))]
            )
            record.ray(points, source="sun" if number < 4 else "lamp")
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert not verify(ray_map).damage
        assert ray_map.emitted.tolist() == [6, 4]
        assert query.select(ray_map, "event(left)").flux == pytest.approx(6 / 2 + 2 / 2)
        assert query.select(ray_map, 'last(hit("floor.bottom", absorbed))').matched == 5
        points = query.report(ray_map, 1)["points"]
        assert points[1]["medium"] == "glass"
        shares = list(points[1]["spectrum"].values())
        np.testing.assert_allclose(shares, [1 / 3, 2 / 3, 0], atol=1e-4)
        np.testing.assert_allclose(points[2]["normal"], [0, 0, 1], atol=1e-4)
        assert np.linalg.norm(query.report(ray_map, 0)["points"][1]["position"]) == pytest.approx(9)


def test_many_rays_and_weights(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.raymap", wavelengths_nm=[500.0, 600.0]) as record:
        for number in range(40_000):
            record.ray([START, END], source="lamp", weight=0.5 + number % 2)
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert len(ray_map.portions) > 1
        assert query.select(ray_map).flux == pytest.approx(2.0)
        assert ray_map.channel_sets[0].wavelengths_nm == (500, 600)


@pytest.mark.parametrize(
    ("points", "source", "what"),
    [
        ([], None, "at least the point"),
        ([END], None, "begins with Event.EMITTED"),
        ([START, START], None, "one ending event"),
        ([START, END], "moon", "no source 'moon' was declared; there are lamp, sun"),
        (
            [START, Point(position=(0, 0, 0), event=Event.SURFACE_ABSORPTION, object="cube")],
            None,
            "no object 'cube'",
        ),
        (
            [START, Point(position=(0, 0, 0), event=128, object="floor", face="side")],
            None,
            "no face of 'floor' 'side'",
        ),
    ],
)
def test_what_no_ray_is(tmp_path: Path, points: list[Point], source: str | None, what: str) -> None:
    with recorder(tmp_path / "a.raymap") as record:
        with pytest.raises(InvalidPortion, match=what):
            record.ray(points, source=source)
        record.ray([START, END])
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert ray_map.rays == 1
    with pytest.raises(MapExists):
        recorder(tmp_path / "a.raymap")


@pytest.mark.peers
def test_mitsuba_scenes(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    from raymap.foreign.from_mitsuba import record_mitsuba

    mi.set_variant("scalar_rgb")
    albedo, rays = 0.6, 1500
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}
    scene = mi.load_dict(
        {
            "type": "scene",
            "shell": {"type": "sphere", "radius": 2.0, "flip_normals": True, "bsdf": grey},
            "lamp": {"type": "point", "intensity": {"type": "rgb", "value": [2.0, 1.0, 1.0]}},
        }
    )
    record_mitsuba(scene, tmp_path / "shell.raymap", rays, length_unit="m")
    with raymap.open(tmp_path / "shell.raymap") as ray_map:
        assert not verify(ray_map).damage
        # A point of intensity I emits 4 pi I
        assert ray_map.directory.sources[0].flux == pytest.approx(4 * np.pi * 4, rel=1e-4)
        assert query.select(ray_map, 'last(hit("shell", absorbed))').matched == rays
        # A closed shell of albedo a: a / (1 - a) reflections on average
        events = np.concatenate([p.column("event") for p in ray_map.portions])
        reflections = int(((events & int(Event.DIFFUSE_REFLECTION)) != 0).sum())
        mean = albedo / (1 - albedo)
        assert abs(reflections / rays - mean) < 5 * np.sqrt(mean * (1 + mean) / rays)
        assert 0 in ray_map.meshes
        assert np.linalg.norm(ray_map.meshes[0].vertices, axis=1).max() == pytest.approx(
            2, rel=1e-5
        )


@pytest.mark.peers
def test_pvtrace_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Its release 2.1.4 asks for names that NumPy has dropped
    monkeypatch.setattr(np, "float", float, raising=False)
    monkeypatch.setattr(np, "int", int, raising=False)
    pvtrace = pytest.importorskip("pvtrace")
    from raymap.foreign.from_pvtrace import record_pvtrace

    alpha, rays = 0.7, 1200
    world = pvtrace.Node(
        name="world",
        geometry=pvtrace.Sphere(radius=10.0, material=pvtrace.Material(refractive_index=1.0)),
    )
    dye = pvtrace.Absorber(coefficient=alpha)
    ball = pvtrace.Node(
        name="ball",
        geometry=pvtrace.Sphere(
            radius=1.0, material=pvtrace.Material(refractive_index=1.5, components=[dye])
        ),
        parent=world,
    )
    lamp = pvtrace.Node(
        name="lamp",
        light=pvtrace.Light(direction=lambda: pvtrace.isotropic(), wavelength=lambda: 555.0),
        parent=ball,
    )
    assert lamp.parent is ball
    np.random.seed(3)  # noqa: NPY002
    record_pvtrace(pvtrace.Scene(world), tmp_path / "ball.raymap", rays, flux=5.0)
    with raymap.open(tmp_path / "ball.raymap") as ray_map:
        assert not verify(ray_map).damage
        assert ray_map.directory.sources[0].flux == 5
        # From the centre every ray meets the surface at right angles
        through, reflected = np.exp(-alpha), ((1.5 - 1) / (1.5 + 1)) ** 2
        expected = {
            "event(volume_absorption) & bounces == 0": 1 - through,
            'hit("ball", refracted) & bounces == 1 & event(left)': through * (1 - reflected),
            'hit("ball", reflected)': through * reflected,
            'medium("ball")': 1.0,
        }
        for criterion, share in expected.items():
            found = query.select(ray_map, criterion).matched / rays
            assert abs(found - share) <= 5 * np.sqrt(share * (1 - share) / rays), criterion
        points = query.report(ray_map, int(query.select(ray_map, "event(left)").ray_ids[0]))
        assert points["points"][1]["refractive_index"] == pytest.approx(1.0)
        assert {"world", "ball"} == {medium.name for medium in ray_map.directory.media}
