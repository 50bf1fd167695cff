"""Nearest triangle of all live rays, where it is nearer than the analytic faces."""

from __future__ import annotations

from raymap.jit.kernels import inner_kernel, stage_kernel
from raymap.jit.types import F64, I64
from tracer.geometry.mesh_arrays import MeshArrays, MeshScratch
from tracer.geometry.mesh_hits import nearest_on_meshes
from tracer.geometry.mesh_triangles import mesh_shading_normal
from tracer.transport.buffers import (
    HIT,
    MESH_BODY,
    MESH_NORMAL,
    MESH_POINT,
    MESH_SHADING,
    MESH_TRIANGLE,
    OWN_BODY,
    OWN_TRIANGLE,
    Buffers,
    T,
)

__all__ = ["nearest_on_solids"]


@stage_kernel
def nearest_on_solids(
    mesh: MeshArrays, first_face: I64, scratch: MeshScratch, b: Buffers, n: int
) -> None:
    """Let ``n`` rays meet meshes where those are nearer than the faces found so far.

    ``first_face`` is the row of face 0 of every mesh object.
    """
    for i in range(n):
        b.live_i[MESH_BODY, i] = -1
    nearest_on_meshes(
        mesh, b.live_f, b.live_i[OWN_BODY], b.live_i[OWN_TRIANGLE], b.live_f[T],
        b.live_i[MESH_BODY], b.live_i[MESH_TRIANGLE], b.live_f[MESH_POINT:MESH_NORMAL],
        b.live_f[MESH_NORMAL:MESH_SHADING], n, scratch,
    )  # fmt: skip
    _name_faces(mesh, first_face, b.live_f, b.live_i, n)


@inner_kernel
def _name_faces(mesh: MeshArrays, first_face: I64, live_f: F64, live_i: I64, n: int) -> None:
    """Turn triangles met into faces, and find the normals that optics should use there."""
    for i in range(n):
        body = live_i[MESH_BODY, i]
        if body < 0:
            continue
        triangle = live_i[MESH_TRIANGLE, i]
        live_i[HIT, i] = first_face[body] + mesh.face[mesh.first_triangle[body] + triangle]
        if mesh.first_corner[body] >= 0:
            x, y, z = live_f[MESH_POINT, i], live_f[MESH_POINT + 1, i], live_f[MESH_POINT + 2, i]
            nx, ny, nz = mesh_shading_normal(mesh, body, triangle, x, y, z)
        else:
            nx, ny, nz = live_f[MESH_NORMAL, i], live_f[MESH_NORMAL + 1, i], live_f[MESH_NORMAL + 2, i]  # fmt: skip # noqa: E501
        live_f[MESH_SHADING, i] = nx
        live_f[MESH_SHADING + 1, i] = ny
        live_f[MESH_SHADING + 2, i] = nz
