"""Polarisation of traced rays: a pass over a finished portion.

Paths are drawn with the shares of natural light. This pass walks every ray once more with its state
of polarisation and multiplies the ray's weight by the share that its light had over the share that
it was drawn by (`raymap.laws.amplitudes`): sums of weights are unbiased fluxes of polarised light.
No record is added, removed or changed.

Axes of stored Stokes vectors: x is the world's x axis made perpendicular to the ray, or the world's
y axis where the ray runs within 0.8 degrees of x; y = d x x.

References
----------
Rayleigh scattering: Born & Wolf, Principles of Optics, 7th ed., 14.5.2: the scattered field is the
part of the field across the new direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, inner_kernel, lean_kernel
from raymap.jit.types import F64, I64
from raymap.laws.amplitudes import Amplitudes, Met, meet_waves
from raymap.laws.phase import RAYLEIGH
from raymap.model.events import Event
from raymap.optics.waves import Turn, normalise_waves, project_waves, start_waves, store_state
from tracer.compiled import (
    B_MEDIUM,
    F_INSIDE,
    F_KIND,
    F_OUTSIDE,
    F_SURFACE,
    L_STACK,
    SOURCE_ROW,
    WORLD,
    CompiledScene,
)
from tracer.geometry.kinds import MESH
from tracer.geometry.normals import face_normal
from tracer.rays.random import advance, stream_state, uniform
from tracer.transport.cross_face import cross_face
from tracer.transport.medium_stack import top_body

__all__ = ["FacesByNumber", "PolarizedColumns", "RayColumns", "polarize_rays"]

I32 = NDArray[np.int32]

_SPECULAR = int(Event.SPECULAR_REFLECTION | Event.TIR | Event.SPECULAR_REFRACTION)
_SCATTERED_THROUGH = int(Event.DIFFUSE_TRANSMISSION | Event.GLOSSY_TRANSMISSION)
_THROUGH = int(Event.SPECULAR_REFRACTION) | _SCATTERED_THROUGH
_SCATTERED = int(Event.DIFFUSE_REFLECTION | Event.GLOSSY_REFLECTION) | _SCATTERED_THROUGH
_AT_FACE = _SPECULAR | _SCATTERED
_ABSORBED = int(Event.SURFACE_ABSORPTION)
_VOLUME = int(Event.VOLUME_SCATTER)

_SALT = 0x5EED_901A
"""Sets the numbers of this pass apart from those that the ray was traced with."""


class RayColumns(NamedTuple):
    """Columns of a portion that the pass reads."""

    source: NDArray[np.int16]
    records_per_ray: I32
    exact: F64
    normal: NDArray[np.int16]
    object: NDArray[np.int16]
    triangle: I32
    event: I32
    medium: NDArray[np.int16]
    color_code: I32
    ids: I64


class FacesByNumber(NamedTuple):
    """Faces and sources by number.

    first (n_objects + 1,), face : row of ``face_i`` of each primitive of each object, -1 for none
    vibration (n_sources, 3) : zero for natural light
    laws : of the surfaces
    """

    first: I64
    face: I64
    vibration: F64
    laws: Amplitudes


class PolarizedColumns(NamedTuple):
    """What the pass writes.

    waves (2, 6) : scratch, real and imaginary parts of the two fields
    """

    weight: F64
    stokes: NDArray[np.float32]
    path: F64
    phase: NDArray[np.float32]
    waves: F64


@inline_kernel
def _crossed(
    scene: CompiledScene, stack: int, face: int, cosine: float, x: float, y: float, z: float
) -> int:
    """Medium stack behind a face and all that coincide with it there, -1 if that cannot be."""
    beyond, _ = cross_face(
        scene.coincident, scene.face_i, scene.face_f, scene.pool, scene.body_i, face, stack, cosine,
        x, y, z,
    )  # fmt: skip
    return beyond


@inline_kernel
def _beyond(
    scene: CompiledScene, stack: int, face: int, cosine: float, medium: int, x: float, y: float,
    z: float,
) -> int:  # fmt: skip
    """Medium on the other side of a face, by the bodies that the ray is known to be in."""
    inside, outside = scene.face_i[face, F_INSIDE], scene.face_i[face, F_OUTSIDE]
    entering = cosine < 0.0
    behind = _crossed(scene, stack, face, cosine, x, y, z)
    body = inside if entering else outside
    if behind >= 0:
        body = top_body(behind, scene.body_i)
    elif entering and inside < 0:
        return medium
    # Where bodies overlap and the ray crossed hidden faces, what stands at the face counts
    found: int = scene.body_i[body, B_MEDIUM] if body >= 0 else scene.limits[WORLD]
    return found


@lean_kernel
def polarize_rays(
    scene: CompiledScene, rays: RayColumns, faces: FacesByNumber, out: PolarizedColumns,
    seed: int, natural: bool,
) -> None:  # fmt: skip
    """Walk all rays of a portion; fills every column of ``out``."""
    a = 0
    for ray in range(len(rays.records_per_ray)):
        n = rays.records_per_ray[ray]
        _walk(scene, rays, faces, out, a, n, seed, rays.ids[ray], ray, natural)
        a += n


@inline_kernel
def _walk(
    scene: CompiledScene, rays: RayColumns, faces: FacesByNumber, out: PolarizedColumns, a: int,
    n: int, seed: int, ray_id: int, ray: int, natural: bool,
) -> None:  # fmt: skip
    """Follow one ray of ``n`` records from record ``a``."""
    exact, waves, medium_f = rays.exact, out.waves, scene.medium_f
    n_channels = scene.source_f.shape[1] - SOURCE_ROW
    state = stream_state(seed ^ _SALT, ray_id)
    source = rays.source[ray]
    stack = scene.source_i[source, L_STACK]
    x, y, z = exact[a, 0], exact[a, 1], exact[a, 2]
    weight, path = 1.0, 0.0
    dx, dy, dz = 0.0, 0.0, 1.0
    for k in range(a, a + n):
        event = rays.event[k]
        out.path[k] = path
        last = k == a + n - 1
        ox, oy, oz = dx, dy, dz
        next_length = 0.0
        if not last:
            # Direction of the segment that starts here
            wx, wy, wz = exact[k + 1, 0] - x, exact[k + 1, 1] - y, exact[k + 1, 2] - z
            next_length = math.sqrt(wx * wx + wy * wy + wz * wz)
            if next_length > 0.0:
                ox, oy, oz = wx / next_length, wy / next_length, wz / next_length
        lost = False
        if last:
            # The state with which it arrives
            store_state(waves, ox, oy, oz, k, out.stokes, out.phase)
        if k == a:
            # Emission: natural light, or the vibration of the source
            bx, by, bz = (
                faces.vibration[source, 0],
                faces.vibration[source, 1],
                faces.vibration[source, 2],
            )
            state = advance(state)
            start_waves(waves, ox, oy, oz, natural, 2.0 * math.pi * uniform(state))
            along = bx * ox + by * oy + bz * oz
            across = bx * bx + by * by + bz * bz - along * along
            if across > 1e-12:
                scale = 1.0 / math.sqrt(across)
                waves[:, :] = 0.0
                waves[0, 0] = scale * (bx - along * ox)
                waves[0, 1] = scale * (by - along * oy)
                waves[0, 2] = scale * (bz - along * oz)
        elif event & _ABSORBED != 0 or (not last and event & _AT_FACE != 0):
            u, v = 0.0, 0.0
            if event & _SCATTERED != 0:
                state = advance(state)
                u = uniform(state)
                state = advance(state)
                v = uniform(state)
            factor, lost, stack = _meet(
                scene, rays, faces, waves, k, stack, _Bend(x, y, z, dx, dy, dz, ox, oy, oz), u, v
            )  # fmt: skip
            weight *= factor
        elif not last and event & _VOLUME != 0:
            medium = rays.medium[k]
            if medium_f[medium, 3 * n_channels] == RAYLEIGH:
                # The density of the angle was 3 / 16 pi (1 + cos²), that of the wave is
                # 3 / 8 pi times the power across the new direction
                mu = dx * ox + dy * oy + dz * oz
                power = project_waves(waves, ox, oy, oz)
                weight *= 2.0 * power / (1.0 + mu * mu)
                normalise_waves(waves, power)
            else:
                lost = True
        if not last:
            if lost:
                state = advance(state)
                start_waves(waves, ox, oy, oz, natural, 2.0 * math.pi * uniform(state))
            store_state(waves, ox, oy, oz, k, out.stokes, out.phase)
            # Go to the next point
            path += next_length * medium_f[max(0, rays.medium[k]), rays.color_code[k]]
            x, y, z = exact[k + 1, 0], exact[k + 1, 1], exact[k + 1, 2]
            dx, dy, dz = ox, oy, oz
    out.weight[ray] = weight


@inline_kernel
def _face_of(faces: FacesByNumber, rays: RayColumns, k: int) -> int:
    """Row of ``face_i`` of the face met at a record, -1 for none."""
    obj = rays.object[k]
    if obj < 0:
        return -1
    row = faces.first[obj] + rays.triangle[k]
    return faces.face[row] if row < faces.first[obj + 1] else -1


@inline_kernel
def _normal_at(
    scene: CompiledScene, rays: RayColumns, face: int, k: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Outward normal of the face met, exact where its shape is known, else as recorded."""
    if face >= 0 and scene.face_i[face, F_KIND] != MESH:
        return face_normal(scene.face_i[face, F_KIND], scene.face_f, face, scene.pool, x, y, z)
    nx, ny, nz = (
        rays.normal[k, 0] / 32767.0,
        rays.normal[k, 1] / 32767.0,
        rays.normal[k, 2] / 32767.0,
    )
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@inner_kernel
def _bending_normal(
    n1: float, n2: float, dx: float, dy: float, dz: float, ox: float, oy: float, oz: float,
    nx: float, ny: float, nz: float,
) -> tuple[float, float, float]:  # fmt: skip
    """The normal that bends d into o, turned like n; n itself where the ray goes straight on.

    Recorded normals of triangles are rounded, and smooth shading bends light by another one.
    """
    vx, vy, vz = n2 * ox - n1 * dx, n2 * oy - n1 * dy, n2 * oz - n1 * dz
    length = math.sqrt(vx * vx + vy * vy + vz * vz)
    if length < 1e-6:
        return nx, ny, nz
    scale = 1.0 / length if vx * nx + vy * ny + vz * nz > 0.0 else -1.0 / length
    return vx * scale, vy * scale, vz * scale


class _Bend(NamedTuple):
    """A point at which light turns, its direction d before and o after it."""

    x: float
    y: float
    z: float
    dx: float
    dy: float
    dz: float
    ox: float
    oy: float
    oz: float


@inline_kernel
def _meet(
    scene: CompiledScene, rays: RayColumns, faces: FacesByNumber, waves: F64, k: int, stack: int,
    bend: _Bend, u: float, v: float,
) -> tuple[float, bool, int]:  # fmt: skip
    """Let the fields meet a face at a record: factor of the weight, whether the state is lost, and
    the stack behind."""
    x, y, z, dx, dy, dz, ox, oy, oz = bend
    event = rays.event[k]
    face = _face_of(faces, rays, k)
    nx, ny, nz = _normal_at(scene, rays, face, k, x, y, z)
    cosine = dx * nx + dy * ny + dz * nz
    if cosine >= 0.0:
        nx, ny, nz = -nx, -ny, -nz
    through = event & _THROUGH != 0
    before = max(0, rays.medium[k - 1])
    # Every ray is of one channel
    code = rays.color_code[k]
    if through:
        other = max(0, rays.medium[k])
    elif face >= 0:
        other = _beyond(scene, stack, face, cosine, before, x, y, z)
    else:
        other = before
    n1, n2 = scene.medium_f[before, code], scene.medium_f[other, code]
    if face >= 0 and scene.face_i[face, F_KIND] == MESH and event & _SPECULAR != 0:
        m1, m2 = (n1, n2) if through else (1.0, 1.0)
        nx, ny, nz = _bending_normal(m1, m2, dx, dy, dz, ox, oy, oz, nx, ny, nz)
    surface = scene.face_i[face, F_SURFACE] if face >= 0 else -1
    factor, lost = meet_waves(
        faces.laws, waves, event, Met(surface, code, n1, n2),
        Turn(dx, dy, dz, ox, oy, oz, nx, ny, nz), u, v,
    )  # fmt: skip
    if through and face >= 0:
        behind = _crossed(scene, stack, face, cosine, x, y, z)
        stack = behind if behind >= 0 else stack
    return factor, lost, stack
