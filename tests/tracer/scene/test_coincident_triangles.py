"""Meshes that lie on faces or on one another are warned about; those that keep apart are not."""

from __future__ import annotations

import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.tracer.transport.tracing import compiled
from tracer.geometry.shape_columns import ShapeColumns
from tracer.scene.arrangement.coincident_triangles import (
    CoincidentTriangles,
    find_coincident_triangles,
)
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene, parse_scene

trimesh = pytest.importorskip("trimesh")

SAMPLES = Path(__file__).parents[3] / "samples"

NO_FACES = ShapeColumns.of_shapes([])

SCENE = """
length_unit = "mm"
[media.g]
index = 1.5
[surfaces.white]
kind = "lambertian"
reflectance = 0.5
[bodies.block]
kind = "mesh"
file = "block.stl"
scale = 1
medium = "g"
{other}
[sources.s]
kind = "point"
position = [0, 0, 9]
"""

BOX = """
[bodies.{name}]
kind = "box"
size = [2, 2, 2]
position = [{place}]
medium = "g"
"""
MESH = """
[bodies.second]
kind = "mesh"
file = "{file}"
scale = 1
medium = "g"
position = [{place}]
"""

TOUCHING = {
    "a box on top": (BOX.format(name="box", place="0.5, 0.3, 2"), "box", 2),
    "a box beside": (BOX.format(name="box", place="2, 0, 0"), "box", 2),
    "a small disc within a triangle": (
        '[bodies.spot]\nkind = "disc"\nouter = 0.05\nposition = [0.4, -0.5, 1]\n'
        'surface = "white"\n',
        "spot",
        1,
    ),
    "a table under it": (
        '[bodies.table]\nkind = "rectangle"\nsize = [9, 9]\nposition = [0, 0, -1]\n'
        'surface = "white"\n',
        "table",
        2,
    ),
    "a mesh on top": (MESH.format(file="block.stl", place="0.9, 0.9, 2"), "second", 2),
    "a mesh of fine triangles": (MESH.format(file="fine.stl", place="0.2, 0, 2"), "second", 2),
}
APART = {
    "a box a micrometre above": BOX.format(name="box", place="0, 0, 2.001"),
    "a box that overlaps by a micrometre": BOX.format(name="box", place="0, 0, 1.999"),
    "a box in the same planes": BOX.format(name="box", place="3, 0, 0"),
    "a mesh above": MESH.format(file="fine.stl", place="0, 0, 2.001"),
    "a mesh inside": MESH.format(file="small.stl", place="0, 0, 0"),
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path) -> Path:
    box = trimesh.creation.box(extents=[2, 2, 2])
    box.export(tmp_path / "block.stl")
    box.subdivide().subdivide().subdivide().export(tmp_path / "fine.stl")
    trimesh.creation.box(extents=[1, 1, 1]).export(tmp_path / "small.stl")
    return tmp_path


@pytest.mark.parametrize("case", TOUCHING)
def test_touching_bodies_are_named_with_the_remedy(case: str, folder: Path) -> None:
    other, name, count = TOUCHING[case]
    with pytest.warns(CoincidentTriangles, match="overlap by a micrometre") as caught:
        compile_scene(parse_scene(SCENE.format(other=other), folder=folder))
    (message,) = [str(item.message) for item in caught]
    assert f"bodies 'block' and {name!r} coincide along {count} triangle" in message
    assert "\n" not in message


@pytest.mark.parametrize("case", APART)
def test_bodies_apart_are_left_alone(case: str, folder: Path) -> None:
    compile_scene(parse_scene(SCENE.format(other=APART[case]), folder=folder))


def test_turned_faces_are_found_too(folder: Path) -> None:
    text = SCENE.format(other=MESH.format(file="fine.stl", place="0, 0, 0"))
    text = text.replace('file = "block.stl"', 'file = "block.stl"\nrotation = [30, 40, 50]')
    up = _rotation(30, 40, 50)[:, 2] * 2.0
    text = text.replace(
        "position = [0, 0, 0]", f"position = {up.tolist()}\nrotation = [30, 40, 50]"
    )
    with pytest.warns(CoincidentTriangles, match="coincide along 2 triangles"):
        compile_scene(parse_scene(text, folder=folder))


def _rotation(x: float, y: float, z: float) -> np.ndarray:
    from tracer.description.fields import Placed

    return Placed(rotation=(x, y, z)).frame()[1]


def test_the_samples_do_not_touch() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("keyboard/keyboard.toml", "led_lens/led_lens.toml"):
            compile_scene(load_scene(SAMPLES / name))


def test_large_meshes_are_compared_in_a_moment() -> None:
    from tracer.geometry.mesh import TriangleMesh

    balls = {}
    for name, shift in (("a", 0.0), ("b", 2.0 * 0.999)):
        ball = trimesh.creation.icosphere(subdivisions=6)
        balls[name] = TriangleMesh(
            name=name,
            vertices=np.asarray(ball.vertices) + np.array([shift, 0.0, 0.0]),
            triangles=np.asarray(ball.faces, np.int32),
            face=np.zeros(len(ball.faces), np.int32),
            face_names=("all",),
        )
    began = time.process_time()
    assert find_coincident_triangles(balls, NO_FACES, [], ["a", "b"], 3.0) == []
    twin = {"a": balls["a"], "c": balls["a"]}
    assert find_coincident_triangles(twin, NO_FACES, [], ["a", "c"], 3.0) == [
        ("a", "c", len(balls["a"].triangles))
    ]
    assert time.process_time() - began < 20.0


def test_analytic_faces_need_no_warning() -> None:
    two = BOX.format(name="one", place="0, 0, 0") + BOX.format(name="two", place="0, 0, 2")
    lamp = '[sources.s]\nkind = "point"\nposition = [0, 0, 9]\n'
    coincident = compiled("[media.g]\nindex = 1.5\n" + two + lamp).arrays.coincident
    assert coincident is not None
    assert len(coincident.face) > 0


ROD = """
[bodies.rod]
kind = "mesh"
file = "rod.stl"
scale = 1
medium = "g"
position = [{place}]
"""
LAMP = '[media.g]\nindex = 1.5\n[sources.s]\nkind = "point"\nposition = [0, 0, 90]\n'
CURVED = {
    "in a bore of its size": (
        ROD.format(name="rod", place="0, 0, 0"),
        'kind = "cylinder"\nradius = 1\nlength = 6\nposition = [0, 0, -3]\n',
        96,
    ),
    "half in it": (
        ROD.format(name="rod", place="0, 0, 3"),
        'kind = "cylinder"\nradius = 1\nlength = 6\nposition = [0, 0, -3]\n',
        96,
    ),
    "end to end": (
        ROD.format(name="rod", place="0, 0, 4"),
        'kind = "cylinder"\nradius = 1\nlength = 6\nposition = [0, 0, -3]\n',
        48,
    ),
    "a ball in a ball": (
        ROD.format(name="rod", place="1, 2, 3").replace("rod.stl", "ball.stl"),
        'kind = "sphere"\nradius = 1\nposition = [1, 2, 3]\n',
        320,
    ),
    "a ball on the face of a lens": (
        ROD.format(name="rod", place="0, 0, 1").replace("rod.stl", "ball.stl"),
        'kind = "lens"\nthickness = 3\nposition = [0, 0, -3]\nfront = { semi_diameter = 1 }\n'
        "back = { radius = 1, semi_diameter = 0.9 }\n",
        None,
    ),
}


@pytest.mark.parametrize("case", CURVED)
def test_triangles_along_a_curved_face_are_named(case: str, folder: Path) -> None:
    mesh, other, count = CURVED[case]
    trimesh.creation.cylinder(radius=1, height=2, sections=48).export(folder / "rod.stl")
    trimesh.creation.icosphere(subdivisions=2).export(folder / "ball.stl")
    text = f'length_unit = "mm"\n{LAMP}{mesh}[bodies.other]\n{other}medium = "g"\n'
    with pytest.warns(
        CoincidentTriangles, match="by more than the triangles stand off it"
    ) as caught:
        compile_scene(parse_scene(text, folder=folder))
    (message,) = [str(item.message) for item in caught]
    found = re.search(r"'rod' and 'other' coincide along (\d+) triangles", message)
    assert found is not None
    if count is not None:
        assert int(found[1]) == count
    else:
        # Triangles with a middle within the face: fewer than half of the ball
        assert 60 < int(found[1]) < 160


def test_triangles_beside_a_curved_face_are_left_alone(folder: Path) -> None:
    trimesh.creation.cylinder(radius=1, height=2, sections=48).export(folder / "rod.stl")
    for other in (
        'kind = "cylinder"\nradius = 1.001\nlength = 6\nposition = [0, 0, -3]\n',
        'kind = "cylinder"\nradius = 1\nlength = 6\nposition = [0, 0, 1.001]\n',
        'kind = "sphere"\nradius = 1.41421356237\n',  # through the rims of both ends
    ):
        text = f'length_unit = "mm"\n{LAMP}{ROD.format(place="0, 0, 0")}[bodies.other]\n{other}'
        compile_scene(parse_scene(text + 'medium = "g"\n', folder=folder))
