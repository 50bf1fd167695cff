"""Triangle meshes as arrays for compiled code, and the working memory of a search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel
from tracer.geometry.embree import RAYHIT_WORDS

__all__ = [
    "BLOCK",
    "MeshArrays",
    "MeshScratch",
    "mesh_scratch",
    "normal_to_world",
    "point_to_local",
    "point_to_world",
    "vector_to_local",
]

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

BLOCK = 128
"""Rays that are searched for together."""


class MeshArrays(NamedTuple):
    """All meshes of a scene, for compiled code [scene units].

    Attributes
    ----------
    handle : Embree's scene
    center : (3,) point that Embree sees as origin
    radius : of the sphere about ``center`` that holds all triangles
    corners : (n_triangles, 10) the three corners x, y, z of each triangle, local; offsets from an
        edge within which the triangles around are tried
    triangles : (n_triangles, 3) numbers of the corners
    face : (n_triangles,) named face of the mesh to which each triangle belongs
    first_around : (n_vertices + 1,) triangles that share vertex v are
        around[first_around[v]:first_around[v + 1]]
    around : (3 n_triangles,) rows of ``triangles``
    first_triangle : (n_objects,) row of the object's primitive 0
    placed : (n_objects,) 1 for an instance with a transform, else corners are in the world
    to_local : (n_objects, 12) world to local as a (3, 4) matrix, for placed objects
    closed : (n_objects,) 1 where the mesh bounds a volume
    first_corner : (n_objects,) row of ``corner_normals`` of primitive 0, -1 without smooth normals
    corner_normals : (n, 9) unit normals at the corners of each triangle, local
    box : (9,) lowest and highest corner of the box that holds all triangles, cells per length
    occupied : (n_x, n_y, n_z) 1 for the cells of the box that triangles may reach into
    """

    handle: int
    center: F64
    radius: float
    corners: F64
    triangles: I32
    face: I32
    first_around: I64
    around: I32
    first_triangle: I64
    placed: I64
    to_local: F64
    closed: I64
    first_corner: I64
    corner_normals: F64
    box: F64
    occupied: NDArray[np.uint8]


class MeshScratch(NamedTuple):
    """Working memory of one thread; see `mesh_scratch`.

    words and bits are one ray and hit as Embree lays them out, at ``address``; the others belong
    to the rays of a block: what Embree gets, and what it gave.
    """

    words: NDArray[np.float32]
    bits: NDArray[np.uint32]
    address: int
    shifted: F64
    begin: F64
    ways: F64
    bests: F64
    own_rows: I64
    best_rows: I64
    hit_body: I64
    hit_row: I64
    chosen: I64
    cells: I32


def mesh_scratch() -> MeshScratch:
    """Working memory for `nearest_on_meshes`: one per thread, to be kept and used again."""
    raw = np.zeros(RAYHIT_WORDS + 4, np.float32)
    skew = (16 - raw.ctypes.data % 16) % 16 // 4
    words = raw[skew : skew + RAYHIT_WORDS]
    return MeshScratch(
        words=words,
        bits=words.view(np.uint32),
        address=words.ctypes.data,
        shifted=np.zeros((3, BLOCK)),
        begin=np.zeros(BLOCK),
        ways=np.zeros(BLOCK),
        bests=np.zeros(BLOCK),
        own_rows=np.zeros(BLOCK, np.int64),
        best_rows=np.zeros(BLOCK, np.int64),
        hit_body=np.zeros(BLOCK, np.int64),
        hit_row=np.zeros(BLOCK, np.int64),
        chosen=np.zeros(BLOCK, np.int64),
        cells=np.zeros((6, BLOCK), np.int32),
    )


@inner_kernel
def point_to_local(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        a[b, 0] * x + a[b, 1] * y + a[b, 2] * z + a[b, 3],
        a[b, 4] * x + a[b, 5] * y + a[b, 6] * z + a[b, 7],
        a[b, 8] * x + a[b, 9] * y + a[b, 10] * z + a[b, 11],
    )


@inner_kernel
def vector_to_local(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        a[b, 0] * x + a[b, 1] * y + a[b, 2] * z,
        a[b, 4] * x + a[b, 5] * y + a[b, 6] * z,
        a[b, 8] * x + a[b, 9] * y + a[b, 10] * z,
    )


@inner_kernel
def normal_to_world(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        a[b, 0] * x + a[b, 4] * y + a[b, 8] * z,
        a[b, 1] * x + a[b, 5] * y + a[b, 9] * z,
        a[b, 2] * x + a[b, 6] * y + a[b, 10] * z,
    )


@inner_kernel
def point_to_world(a: F64, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Solve local = A world + shift by Cramer's rule."""
    x, y, z = x - a[b, 3], y - a[b, 7], z - a[b, 11]
    c0 = a[b, 5] * a[b, 10] - a[b, 6] * a[b, 9]
    c1 = a[b, 6] * a[b, 8] - a[b, 4] * a[b, 10]
    c2 = a[b, 4] * a[b, 9] - a[b, 5] * a[b, 8]
    d0 = a[b, 2] * a[b, 9] - a[b, 1] * a[b, 10]
    d1 = a[b, 0] * a[b, 10] - a[b, 2] * a[b, 8]
    d2 = a[b, 1] * a[b, 8] - a[b, 0] * a[b, 9]
    e0 = a[b, 1] * a[b, 6] - a[b, 2] * a[b, 5]
    e1 = a[b, 2] * a[b, 4] - a[b, 0] * a[b, 6]
    e2 = a[b, 0] * a[b, 5] - a[b, 1] * a[b, 4]
    scale = 1.0 / (a[b, 0] * c0 + a[b, 1] * c1 + a[b, 2] * c2)
    return (
        (c0 * x + d0 * y + e0 * z) * scale,
        (c1 * x + d1 * y + e1 * z) * scale,
        (c2 * x + d2 * y + e2 * z) * scale,
    )
