"""The grid of cells leaves out only rays that meet nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tracer.geometry.mesh import make_mesh
from tracer.geometry.mesh_arrays import MeshArrays, mesh_scratch
from tracer.geometry.mesh_cells import find_cells
from tracer.geometry.mesh_hits import nearest_on_meshes
from tracer.geometry.mesh_scene import MeshScene, Placement

F64 = NDArray[np.float64]


def plate(tilt: float) -> MeshArrays:
    """Squares of many sizes in a plane, turned about the y axis by ``tilt`` [rad]."""
    rng = np.random.default_rng(4)
    vertices: list[tuple[float, float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for x in range(12):
        for y in range(8):
            half = rng.uniform(0.05, 0.4)
            k = len(vertices)
            vertices += [(x + half * a, y + half * b, 0.0) for a, b in
                         ((-1, -1), (1, -1), (1, 1), (-1, 1))]  # fmt: skip
            triangles += [(k, k + 1, k + 2), (k, k + 2, k + 3)]
    points = np.array(vertices)
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    mesh = make_mesh(points @ turn.T, np.array(triangles), name="plate", solid=False)
    return MeshScene([Placement(mesh=mesh)]).arrays


def shoot(m: MeshArrays, rays: F64, t: F64) -> list[F64]:
    n = rays.shape[1]
    none = np.full(n, -1, np.int64)
    body, primitive = none.copy(), none.copy()
    point, normal, t = np.zeros((3, n)), np.zeros((3, n)), t.copy()
    nearest_on_meshes(m, rays, none, none, t, body, primitive, point, normal, n, mesh_scratch())
    return [t, body.astype(float), primitive.astype(float), point, normal]


@pytest.mark.parametrize("tilt", [0.0, 0.3])
@pytest.mark.parametrize("away", [0.01, 5.0, 1e5])
def test_rays_meet_what_they_meet_where_every_cell_is_looked_into(tilt: float, away: float) -> None:
    m = plate(tilt)
    rng = np.random.default_rng(7)
    n = 20_000
    target = rng.uniform(m.box[:3], m.box[3:6], (n, 3))
    way = rng.normal(size=(n, 3))
    way[: n // 4] = np.eye(3)[rng.integers(0, 3, n // 4)]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    rays = np.ascontiguousarray(np.concatenate((target - away * way, way), axis=1).T)
    t = np.where(rng.uniform(size=n) < 0.5, np.inf, away * rng.uniform(0.5, 1.5, n))
    everything = m._replace(occupied=np.ones_like(m.occupied))
    found, expected = shoot(m, rays, t), shoot(everything, rays, t)
    assert 0.02 < np.mean(found[1] >= 0) < 0.9
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_every_point_of_a_box_lies_in_an_occupied_cell() -> None:
    rng = np.random.default_rng(2)
    low = rng.uniform(-3, 3, (200, 3)) * (1.0, 20.0, 0.1)
    high = low + rng.uniform(0, 0.2, (200, 3))
    cells = find_cells(low, high, 1e-6)
    points = rng.uniform(low, high, (50, 200, 3)).reshape(-1, 3)
    place = ((points - cells.box[:3]) * cells.box[6:]).astype(int)
    assert cells.occupied.size <= 2**15
    assert np.all(cells.occupied[tuple(place.T)] == 1)
    # Not much more than the boxes is occupied
    assert cells.occupied.mean() < 0.2


def test_a_single_flat_triangle_has_a_grid() -> None:
    cells = find_cells(np.zeros((1, 3)), np.array([[1.0, 1.0, 0.0]]), 1e-6)
    assert np.all(cells.occupied == 1)
    assert cells.occupied.shape[2] == 1
