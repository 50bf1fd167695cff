"""Rays a second against a mesh of 80,000 triangles: python benchmarks/mesh_rays.py

Incoherent rays of diffuse reflections inside a bumpy ball. Embree's own single-ray rate on the same
rays (a compiled loop around rtcIntersect1 that keeps nothing but triangle and distance) against the
door that the engine uses, which decides every hit in float64. One thread; medians of several runs.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from tracer.geometry.embree import INVALID, intersect
from tracer.geometry.mesh import TriangleMesh, make_mesh
from tracer.geometry.mesh_arrays import MeshScratch, mesh_scratch
from tracer.geometry.mesh_hits import nearest_on_meshes
from tracer.geometry.mesh_scene import MeshScene, Placement

BUDGET = 0.70
F64 = NDArray[np.float64]


def bumpy_ball(rows: int, columns: int) -> TriangleMesh:
    """A closed ball of radius about 1 with 2 (rows - 1) columns triangles."""
    theta = np.pi * np.arange(1, rows) / rows
    phi = 2 * np.pi * np.arange(columns) / columns
    t, p = np.meshgrid(theta, phi, indexing="ij")
    r = 1 + 0.05 * np.sin(9 * t) * np.cos(7 * p)
    ring = np.stack((r * np.sin(t) * np.cos(p), r * np.sin(t) * np.sin(p), r * np.cos(t)), -1)
    vertices = np.concatenate((ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]))
    top, bottom = len(vertices) - 2, len(vertices) - 1
    k = np.arange(columns)
    after = (k + 1) % columns
    triangles = [np.stack((np.full(columns, top), k, after), 1)]
    for i in range(rows - 2):
        a, b, c, d = i * columns + k, i * columns + after, (i + 1) * columns + k, 0
        d = (i + 1) * columns + after
        triangles += [np.stack((a, c, d), 1), np.stack((a, d, b), 1)]
    last = (rows - 2) * columns
    triangles.append(np.stack((last + k, np.full(columns, bottom), last + after), 1))
    return make_mesh(vertices, np.concatenate(triangles), name="bumpy ball")


@lean_kernel
def embree_alone(
    handle: int, start: F64, primitive: NDArray[np.int64], t: F64, scratch: MeshScratch
) -> None:
    """Embree's single-ray rate: fill the ray, ask, keep triangle and distance."""
    words, bits, address = scratch.words, scratch.bits, np.uintp(scratch.address)
    for i in range(len(t)):
        words[0], words[1], words[2], words[3] = start[0, i], start[1, i], start[2, i], 0.0
        words[4], words[5], words[6], words[7] = start[3, i], start[4, i], start[5, i], 0.0
        words[8] = np.inf
        bits[9], bits[10], bits[11] = INVALID, 0, 0
        bits[18], bits[19] = INVALID, INVALID
        intersect(np.uintp(handle), address, np.uintp(0))
        primitive[i] = np.int64(bits[17]) if bits[18] != INVALID else -1
        t[i] = words[8]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=200_000)
    parser.add_argument("--repeat", type=int, default=7)
    arguments = parser.parse_args()
    mesh = bumpy_ball(201, 200)
    scene = MeshScene([Placement(mesh=mesh)])
    m, n, scratch = scene.arrays, arguments.rays, mesh_scratch()
    rng = np.random.default_rng(1)
    none = np.full(n, -1, np.int64)
    body, primitive, point, normal = none.copy(), none.copy(), np.zeros((3, n)), np.zeros((3, n))
    # The first rays only find places on the wall; diffuse rays start from there
    way = rng.normal(size=(n, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    rays = np.ascontiguousarray(np.concatenate((np.zeros((n, 3)), way), axis=1).T)
    nearest_on_meshes(
        m, rays, none, none, np.full(n, np.inf), body, primitive, point, normal, n, scratch
    )
    own_body, own_primitive = body.copy(), primitive.copy()
    way = rng.normal(size=(n, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    way *= -np.sign((way * normal.T).sum(axis=1, keepdims=True))
    rays = np.ascontiguousarray(np.concatenate((point.T, way), axis=1).T)
    inside = rays.copy()
    inside[:3] -= 1e-6 * normal + m.center[:, None]
    alone, door = [], []
    for _ in range(arguments.repeat + 1):
        t = np.zeros(n)
        begin = time.thread_time()
        embree_alone(m.handle, inside, primitive, t, scratch)
        alone.append(n / (time.thread_time() - begin))
        t[:] = np.inf
        body[:] = -1
        begin = time.thread_time()
        nearest_on_meshes(
            m, rays, own_body, own_primitive, t, body, primitive, point, normal, n, scratch
        )
        door.append(n / (time.thread_time() - begin))
    lost = int((body < 0).sum())
    ratio = statistics.median(b / a for a, b in zip(alone[1:], door[1:], strict=True))
    print(f"{platform.processor() or platform.machine()}, embreex {version('embreex')}, seed 1")
    print(f"{len(mesh.triangles)} triangles, {n} incoherent rays, {lost} lost")
    print(f"Embree alone  {statistics.median(alone[1:]) / 1e6:6.2f} M rays/s")
    print(f"through door  {statistics.median(door[1:]) / 1e6:6.2f} M rays/s")
    print(f"ratio         {ratio:6.2f} (at least {BUDGET:g})")


if __name__ == "__main__":
    main()
