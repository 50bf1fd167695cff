"""Rays and meshes: nothing leaks through edges, nothing hits the surface that it leaves."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from tracer.geometry.mesh import TriangleMesh, make_mesh, smooth_normals
from tracer.geometry.mesh_arrays import MeshArrays, MeshScratch, mesh_scratch
from tracer.geometry.mesh_hits import nearest_on_meshes
from tracer.geometry.mesh_scene import MeshScene, Placement, count_crossing_edges
from tracer.geometry.mesh_triangles import mesh_normal, mesh_shading_normal
from tracer.rays.random import advance, stream_state, uniform

CUBE_V = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE_T = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def icosphere(steps: int, name: str = "ball") -> TriangleMesh:
    """A sphere of radius 1 from an icosahedron whose triangles are split in four."""
    golden = (1 + 5**0.5) / 2
    vertices = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0)]
    vertices += [(0, -1, golden), (0, 1, golden), (0, -1, -golden), (0, 1, -golden)]
    vertices += [(golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)]
    v = np.array(vertices) / np.hypot(1, golden)
    t = np.array(
        [
            [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11],
            [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
            [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9],
            [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
        ]
    )  # fmt: skip
    for _ in range(steps):
        a, b, c = t.T
        corners = np.stack((v[a], v[b], v[c]), 1)
        middles = corners + np.roll(corners, -1, axis=1)
        middles /= np.linalg.norm(middles, axis=2, keepdims=True)
        n = len(v)
        v = np.concatenate((v, middles.reshape(-1, 3)))
        ab, bc, ca = n + np.arange(3 * len(t)).reshape(-1, 3).T
        t = np.concatenate(
            [np.stack(x, 1) for x in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        )
    return make_mesh(v, t, name=name)


def cube(transform: NDArray[np.float64] | None = None) -> MeshScene:
    return MeshScene([Placement(mesh=make_mesh(CUBE_V, CUBE_T, name="cube"), transform=transform)])


def shoot(
    m: MeshArrays,
    origin: NDArray[np.float64],
    direction: NDArray[np.float64],
    own: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    n = len(origin)
    rays = np.ascontiguousarray(np.concatenate((origin, direction), axis=1).T, float)
    t = np.full(n, np.inf)
    none = np.full(n, -1, np.int64)
    body, primitive, point = none.copy(), none.copy(), np.zeros((3, n))
    own_body, own_primitive = own or (none, none)
    normal, scratch = point.copy(), mesh_scratch()
    nearest_on_meshes(
        m, rays, own_body, own_primitive, t, body, primitive, point, normal, n, scratch
    )
    return t, body, primitive, point.T


@kernel
def _bounce(
    m: MeshArrays, state: int, n: int, bounces: int, scratch: MeshScratch
) -> tuple[int, int, int]:
    """Diffuse rays inside a closed shape: (lost, hit from outside, hit their own triangle)."""
    stream = stream_state(state, 0)
    rays = np.zeros((6, n))
    own = np.full(n, -1)
    own_primitive = np.full(n, -1)
    body = np.full(n, -1)
    primitive = np.full(n, -1)
    point = np.zeros((3, n))
    normal = np.zeros((3, n))
    t = np.zeros(n)
    lost, outside, again = 0, 0, 0
    for i in range(n):
        rays[0, i], rays[1, i], rays[2, i] = m.center
    for _ in range(bounces):
        for i in range(n):
            # A direction uniform over the sphere, turned inward
            z = 2 * uniform(stream) - 1
            phi = 2 * np.pi * uniform(advance(stream))
            stream = advance(advance(stream))
            s = np.sqrt(1 - z * z)
            d = (s * np.cos(phi), s * np.sin(phi), z)
            sign = 1.0
            if own[i] >= 0:
                nx, ny, nz = mesh_normal(m, own[i], own_primitive[i])
                sign = -1.0 if d[0] * nx + d[1] * ny + d[2] * nz > 0 else 1.0
            rays[3, i], rays[4, i], rays[5, i] = sign * d[0], sign * d[1], sign * d[2]
            t[i] = np.inf
            body[i] = -1
        nearest_on_meshes(
            m, rays, own, own_primitive, t, body, primitive, point, normal, n, scratch
        )
        for i in range(n):
            if body[i] < 0:
                lost += 1
                rays[0, i], rays[1, i], rays[2, i] = m.center
                own[i] = -1
                continue
            nx, ny, nz = mesh_normal(m, body[i], primitive[i])
            if rays[3, i] * nx + rays[4, i] * ny + rays[5, i] * nz < 0:
                outside += 1
            if body[i] == own[i] and primitive[i] == own_primitive[i]:
                again += 1
            own[i], own_primitive[i] = body[i], primitive[i]
            rays[0, i], rays[1, i], rays[2, i] = point[0, i], point[1, i], point[2, i]
    return lost, outside, again


def wedge() -> TriangleMesh:
    """A prism with an edge of 5 degrees: rays are caught near the edge."""
    x, y = 1.0, float(np.tan(np.radians(5)))
    v = np.array([[0, 0, z] for z in (0, 1)] + [[x, 0, z] for z in (0, 1)]
                 + [[x, y, z] for z in (0, 1)], float)  # fmt: skip
    t = np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3], [0, 1, 5], [0, 5, 4],
                  [0, 4, 2], [1, 3, 5]])  # fmt: skip
    return make_mesh(v, t, name="wedge")


@pytest.mark.parametrize("shift", [0.0, 1e4])
@pytest.mark.parametrize("shape", ["cube", "ball", "wedge"])
def test_closed_shapes_do_not_leak(shape: str, shift: float) -> None:
    mesh = {
        "cube": lambda: make_mesh(CUBE_V, CUBE_T),
        "ball": lambda: icosphere(4),
        "wedge": wedge,
    }[shape]()
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    transform = np.column_stack((turn, np.full(3, shift)))
    scene = MeshScene([Placement(mesh=mesh, transform=transform)])
    lost, outside, again = _bounce(scene.arrays, 11, 1000, 300, mesh_scratch())
    assert (lost, outside, again) == (0, 0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("steps", [0, 6])
def test_millions_of_rays_stay_inside(steps: int) -> None:
    scene = MeshScene([Placement(mesh=icosphere(steps))])
    assert _bounce(scene.arrays, 5, 10_000, 400, mesh_scratch()) == (0, 0, 0)


def test_rays_at_edges_and_corners_of_a_cube_hit() -> None:
    scene = cube()
    corners = CUBE_V
    middles = np.array([(a + b) / 2 for a in CUBE_V for b in CUBE_V if np.abs(a - b).sum() == 1])
    targets = np.concatenate((corners, middles))
    origin = np.broadcast_to([0.3, 0.4, 0.45], targets.shape)
    vector = targets - origin
    length = np.linalg.norm(vector, axis=1)
    t, body, _, point = shoot(scene.arrays, origin, vector / length[:, None])
    assert np.all(body == 0)
    np.testing.assert_allclose(t, length, rtol=1e-9)
    np.testing.assert_allclose(point, targets, atol=1e-9)


def test_hits_are_exact_in_float64_even_from_far_away() -> None:
    scene = cube()
    rng = np.random.default_rng(2)
    target = np.column_stack((np.zeros(2000), rng.uniform(0.01, 0.99, (2000, 2))))
    origin = np.array([-1e6, 0.5, 0.5]) + np.zeros((2000, 3))
    vector = target - origin
    length = np.linalg.norm(vector, axis=1)
    t, body, _, point = shoot(scene.arrays, origin, vector / length[:, None])
    assert np.all(body == 0)
    assert np.abs(point - target).max() < 1e-9
    assert np.abs(t - length).max() < 1e-8


def test_a_farther_mesh_does_not_replace_a_nearer_hit() -> None:
    scene = cube()
    rays = np.array([[-1.0, 0.5, 0.4, 1.0, 0.0, 0.0]]).T
    none = np.full(1, -1, np.int64)
    for limit, expected in ((0.5, -1), (2.0, 0)):
        t = np.array([limit])
        body, primitive = none.copy(), none.copy()
        nearest_on_meshes(
            scene.arrays,
            rays,
            none,
            none,
            t,
            body,
            primitive,
            np.zeros((3, 1)),
            np.zeros((3, 1)),
            1,
            mesh_scratch(),
        )
        assert body[0] == expected
        assert t[0] == pytest.approx(min(limit, 1.0))


def test_instances_equal_baked_copies() -> None:
    mesh = smooth_normals(icosphere(3))
    rng = np.random.default_rng(8)
    placements = []
    for number in range(5):
        matrix = rng.normal(size=(3, 3)) * 0.3 + np.eye(3)
        if number == 4:
            matrix[:, 0] *= -1  # a mirrored copy
        placements.append(
            Placement(mesh=mesh, transform=np.column_stack((matrix, [4.0 * number, 0, 0])))
        )
    baked = MeshScene(placements)
    shared = MeshScene(placements, instance_above=0)
    assert shared.arrays.placed.all()
    assert not baked.arrays.placed.any()
    origin = rng.uniform([-3, -4, -4], [20, 4, 4], (20_000, 3))
    direction = rng.normal(size=(20_000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    t0, body0, _, point0 = shoot(baked.arrays, origin, direction)
    t1, body1, primitive1, point1 = shoot(shared.arrays, origin, direction)
    assert (body0 >= 0).sum() > 1000
    assert (body0 != body1).sum() == 0
    hit = body0 >= 0
    np.testing.assert_allclose(t1[hit], t0[hit], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(point1[hit], point0[hit], atol=1e-8)
    # Outward normals, flat and smooth, in the world
    rows = np.flatnonzero(hit)[:300]
    for i in rows:
        flat = np.array(mesh_normal(shared.arrays, body1[i], primitive1[i]))
        smooth = np.array(mesh_shading_normal(shared.arrays, body1[i], primitive1[i], *point1[i]))
        assert np.linalg.norm(smooth) == pytest.approx(1)
        assert smooth @ flat > 0.8
    lost, outside, again = _bounce(
        MeshScene([placements[4], placements[4]], instance_above=0).arrays, 3, 50, 1, mesh_scratch()
    )
    assert (lost, outside, again) == (0, 0, 0)


def test_smooth_normals_of_a_sphere_are_radial() -> None:
    scene = MeshScene([Placement(mesh=smooth_normals(icosphere(4)))])
    rng = np.random.default_rng(4)
    direction = rng.normal(size=(500, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    _, body, primitive, point = shoot(scene.arrays, np.zeros((500, 3)), direction)
    for i in range(500):
        normal = np.array(mesh_shading_normal(scene.arrays, body[i], primitive[i], *point[i]))
        assert normal @ direction[i] > 1 - 1e-5


def test_crossing_edges_are_counted() -> None:
    assert count_crossing_edges(make_mesh(CUBE_V, CUBE_T)) == 0
    assert count_crossing_edges(icosphere(3)) == 0
    both = make_mesh(
        np.concatenate((CUBE_V, CUBE_V + np.array([0.4, 0.3, 0.6]))),
        np.concatenate((CUBE_T, CUBE_T + 8)),
    )
    assert count_crossing_edges(both) > 5
