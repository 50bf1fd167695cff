"""Bodies: smooth normals, edges, cuts and silhouettes."""

from __future__ import annotations

import numpy as np
import pytest

from raymap import DisplayMesh
from tests.viewer.small_map import LENS, SENSOR, TUBE, lens_mesh, make_directory, make_meshes
from viewer.drawn.bodies import Body, cut_body, make_body, silhouette
from viewer.drawn.scene import bodies_box, load_bodies, scene_box, visible_bodies
from viewer.drawn.state import Section, ViewState


def cube() -> DisplayMesh:
    """Twelve triangles, a vertex for each corner of each side."""
    sides, triangles, face = [], [], []
    for axis in range(3):
        for value in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            quad = np.zeros((4, 3))
            quad[:, axis] = value
            quad[:, u], quad[:, v] = [-1, 1, 1, -1], [-1, -1, 1, 1]
            base = 4 * len(sides)
            sides.append(quad)
            triangles += [[base, base + 1, base + 2], [base, base + 2, base + 3]]
            face += [len(sides) - 1] * 2
    return DisplayMesh(
        vertices=np.concatenate(sides).astype(np.float32),
        triangles=np.array(triangles, np.int32),
        face=np.array(face, np.int32),
    )


def sphere(n: int = 24) -> DisplayMesh:
    theta, phi = np.linspace(0, np.pi, n + 1), np.linspace(0, 2 * np.pi, 2 * n + 1)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    points = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)
    index = np.arange((n + 1) * (2 * n + 1)).reshape(n + 1, 2 * n + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    triangles = triangles.reshape(-1, 3).astype(np.int32)
    return DisplayMesh(
        vertices=points.reshape(-1, 3).astype(np.float32),
        triangles=triangles,
        face=np.zeros(len(triangles), np.int32),
    )


def body(mesh: DisplayMesh) -> Body:
    return make_body(mesh, name="it", index=0, color=np.ones(3, np.float32), opacity=0.5)


def area(corners: np.ndarray) -> float:
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(cross.astype(np.float64), axis=1).sum() / 2)


def test_a_cube_has_twelve_edges_and_flat_sides() -> None:
    made = body(cube())
    assert len(made.edges) == 12
    lengths = np.linalg.norm(made.edges[:, 0] - made.edges[:, 1], axis=1)
    np.testing.assert_allclose(lengths, 2.0)
    assert (np.abs(made.normals).max(axis=2) == 1).all()


def test_a_sphere_has_smooth_normals_and_a_round_silhouette() -> None:
    made = body(sphere())
    inner = np.abs(made.corners[:, :, 2]) < 0.99
    np.testing.assert_allclose(
        np.abs(np.einsum("ijk,ijk->ij", made.normals, made.corners))[inner], 1, atol=0.02
    )
    for forward in (np.array([1.0, 0, 0]), np.array([0.6, 0.0, 0.8])):
        rim = silhouette(made, np.zeros(3), forward, parallel=True)
        assert len(rim) > 20
        assert np.abs(rim @ forward).max() < 0.25
        radius = np.linalg.norm(rim - (rim @ forward)[..., None] * forward, axis=-1)
        assert radius.min() > 0.96


@pytest.mark.parametrize("mesh", [cube(), sphere(), lens_mesh(24)])
def test_the_two_sides_of_a_cut_make_the_whole(mesh: DisplayMesh) -> None:
    whole = body(mesh)
    normal, offset = np.array([0.36, 0.48, 0.8]), 0.21
    one, other = cut_body(whole, normal, offset), cut_body(whole, -normal, -offset)
    assert area(one.corners) + area(other.corners) == pytest.approx(area(whole.corners), rel=1e-5)
    assert (one.corners.astype(float) @ normal).max() <= offset + 1e-5
    assert (other.corners.astype(float) @ normal).min() >= offset - 1e-5
    # The outline of the cut lies in the plane
    outline = one.edges[np.abs(one.edges.astype(float) @ normal - offset).max(axis=1) < 1e-5]
    assert len(outline) > 3


def test_a_cut_beyond_the_body_changes_nothing() -> None:
    whole = body(cube())
    kept = cut_body(whole, np.array([0, 0, 1.0]), 5.0)
    np.testing.assert_array_equal(kept.corners, whole.corners)
    assert len(cut_body(whole, np.array([0, 0, 1.0]), -5.0).corners) == 0


def test_bad_triangles_are_left_out() -> None:
    mesh = DisplayMesh(
        vertices=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0]], np.float32),
        triangles=np.array([[0, 1, 2], [0, 1, 9], [-1, 0, 1], [0, 1, 3], [0, 1, 1]], np.int32),
        face=np.zeros(5, np.int32),
    )
    assert len(body(mesh).corners) == 1


def test_scenes_become_bodies_by_material() -> None:
    bodies = load_bodies(make_directory(), make_meshes())
    by_name = {item.name: item for item in bodies}
    assert list(by_name) == ["L1", "tube", "sensor"]
    assert by_name["tube"].opacity < by_name["L1"].opacity < by_name["sensor"].opacity
    low, high = scene_box(bodies, make_directory(), np.empty((0, 2, 3)))
    np.testing.assert_allclose([low, high], [[-15, -15, -5], [15, 15, 50]], atol=1e-5)


def test_objects_are_hidden_faded_and_cut() -> None:
    bodies = load_bodies(make_directory(), make_meshes())
    state = ViewState(
        hidden=("tube",), opacities={"L1": 0.9}, section=Section(on=True, normal=(-1, 0, 0))
    )
    shown = visible_bodies(bodies, state)
    assert [item.name for item in shown] == ["L1", "sensor"]
    assert shown[0].opacity == pytest.approx(0.9)
    box = bodies_box(shown)
    assert box is not None
    assert box[0][0] == pytest.approx(0, abs=1e-6)


def test_without_meshes_the_rays_or_the_bounding_sphere_are_the_scene() -> None:
    directory = make_directory()
    assert load_bodies(directory, {}) == []
    low, high = scene_box([], directory, np.empty((0, 2, 3), np.float32))
    np.testing.assert_allclose([low, high], [[-80, -80, -60], [80, 80, 100]])
    low, high = scene_box([], directory, np.array([[[0, 0, 0], [1, 2, 3]]], np.float32))
    np.testing.assert_allclose(high, [1, 2, 3])


def test_only_some_objects_may_have_meshes() -> None:
    meshes = make_meshes()
    del meshes[TUBE]
    assert [item.index for item in load_bodies(make_directory(), meshes)] == [LENS, SENSOR]
