"""Triangle meshes in the engine: named faces, no leaks, the same physics as analytic bodies."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from raymap.model.errors import SceneError
from raymap.model.events import Event
from tests.tracer.transport.tracing import HEAD, Trace, trace
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene

trimesh = pytest.importorskip("trimesh")


def traced(text: str, folder: Path, n_rays: int) -> Trace:
    return trace(compile_scene(parse_scene(HEAD + text, folder=folder)), n_rays)


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    trimesh.creation.icosphere(subdivisions=4, radius=5.0).export(tmp_path / "ball.stl")
    return tmp_path


CAVITY = """
[surfaces.wall]
kind = "lambertian"
reflectance = 0.9
[bodies.cavity]
kind = "mesh"
file = "ball.stl"
scale = 1
surface = "wall"
[sources.lamp]
kind = "point"
position = [1, 0.5, -0.3]
"""


def test_no_ray_gets_out_of_a_closed_mesh(ball: Path) -> None:
    found = traced(CAVITY, ball, 20_000)
    assert found.endings(Event.SURFACE_ABSORPTION) == 20_000
    hits = found.portion.records_per_ray - 1
    assert abs(hits.mean() - 10.0) < 4.5 * math.sqrt(90.0) / math.sqrt(20_000)


def test_normals_and_triangles_are_those_of_the_mesh(ball: Path) -> None:
    found = traced(CAVITY, ball, 500)
    p = found.portion
    met = p.object == 0
    outward = p.position[met] / np.linalg.norm(p.position[met], axis=1, keepdims=True)
    assert np.all(np.sum(outward * p.normal[met] / 32767.0, axis=1) > 0.99)
    mesh = found.compilation.meshes[0]
    corners = mesh.vertices[mesh.triangles[p.triangle[met]]]
    away = np.sum((p.position[met] - corners[:, 0]) * p.normal[met] / 32767.0, axis=1)
    assert np.abs(away).max() < 1e-3


GLASS = """
[media.glass]
index = 1.5
[bodies.ball]
kind = "{kind}"
medium = "glass"
{shape}
[sources.beam]
kind = "collimated"
position = [0, 0, -20]
direction = [0, 0, 1]
diameter = 6
[detectors.screen]
position = [0, 0, 8]
looks = [0, 0, -1]
size = [4, 4]
cells = [4, 4]
blocking = true
"""


def test_a_smooth_glass_ball_of_triangles_focuses_as_the_sphere(ball: Path) -> None:
    triangles = traced(
        GLASS.format(kind="mesh", shape='file = "ball.stl"\nscale = 1\nsmooth_deg = 30'),
        ball,
        40_000,
    )
    sphere = traced(GLASS.format(kind="sphere", shape="radius = 5"), ball, 40_000)
    assert triangles.count(Event.GEOMETRY_ERROR) <= 4
    a, b = triangles.ended_on("screen"), sphere.ended_on("screen")
    assert abs(a - b) < 0.02 * b


def test_copies_and_placement(ball: Path) -> None:
    text = """
[bodies.one]
kind = "mesh"
file = "ball.stl"
scale = 1
surface = "absorber"
position = [-20, 0, 0]
[bodies.two]
kind = "mesh"
file = "ball.stl"
scale = 1
surface = "absorber"
position = [20, 0, 0]
rotation = [0, 90, 0]
[sources.beam]
kind = "collimated"
position = [20, 0, -30]
direction = [0, 0, 1]
diameter = 2
"""
    found = traced(text, ball, 500)
    assert found.ended_on("two") == 500
    assert found.portion.position[found.last, 2].max() < -4.8


def test_box_faces_are_named_by_their_edges(tmp_path: Path) -> None:
    trimesh.creation.box(extents=[2, 2, 2]).export(tmp_path / "box.stl")
    text = """
[bodies.box]
kind = "mesh"
file = "box.stl"
scale = 1
name_by = "angle"
surface = "absorber"
[sources.lamp]
kind = "point"
"""
    found = traced(text, tmp_path, 500)
    faces = found.compilation.directory.objects[0].faces
    assert len(faces) == 6
    assert all(face.primitive_count == 2 for face in faces)
    assert found.ended_on("box") == 500


def test_missing_files_and_scales_are_refused(tmp_path: Path) -> None:
    body = '[bodies.a]\nkind = "mesh"\nfile = "a.stl"\n{}\n[sources.s]\nkind = "point"\n'
    with pytest.raises(SceneError, match=r"bodies\.a\.scale: is missing"):
        parse_scene(HEAD + body.format(""))
    with pytest.raises(SceneError, match=r"a\.stl"):
        compile_scene(
            parse_scene(HEAD + body.format('scale = 1\nsurface = "absorber"'), folder=tmp_path)
        )
