"""Polarisation of traced rays: a pass over a finished portion.

The analog engine chooses between reflection and refraction with the reflectances of unpolarised
light. This pass walks every ray once more with its state of polarisation and multiplies the ray's
weight by the probability that its light had over the probability it was given: sums of weights are
unbiased fluxes of polarised light. A ray that meets a polariser is absorbed there by roulette.

A state is the sum of two waves without interference, each a complex field across the ray
(`tracer.optics.polarization`): one wave for a linear state, two halves for natural light. Axes of
stored Stokes vectors: x is the world's x axis made perpendicular to the ray, or the world's y axis
where the ray runs within 0.8 degrees of x; y = d x x.

References
----------
Fresnel: `tracer.optics.polarization_fresnel`. Rayleigh scattering: Born & Wolf, Principles of
Optics, 7th ed., 14.5.2: the scattered field is the part of the field across the new direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.types import F64, I64
from raymap.laws.phase import RAYLEIGH
from raymap.model.events import Event
from raymap.model.schema import COLOR_SCALE
from raymap.optics.fresnel import fresnel_reflectance
from tracer.compiled import (
    B_MEDIUM,
    DIELECTRIC,
    F_INSIDE,
    F_KIND,
    F_OUTSIDE,
    F_SURFACE,
    L_NEST,
    S_KIND,
    S_MODEL,
    WORLD,
    CompiledScene,
)
from tracer.geometry.kinds import MESH
from tracer.geometry.normals import face_normal
from tracer.polarized.waves import (
    normalise_waves,
    polarise_waves,
    project_waves,
    split_waves,
    start_waves,
    store_state,
    turn_waves,
)
from tracer.rays.random import advance, stream_state, uniform
from tracer.transport.contacts import cross_face
from tracer.transport.nests import top_body

__all__ = ["PolarizedColumns", "RayColumns", "SpecialFaces", "polarize_rays"]

I32 = NDArray[np.int32]

_REFLECTED = int(Event.SPECULAR_REFLECTION | Event.TIR)
_TIR = int(Event.TIR)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_SCATTERED_THROUGH = int(Event.DIFFUSE_TRANSMISSION | Event.GLOSSY_TRANSMISSION)
_SCATTERED = int(Event.DIFFUSE_REFLECTION | Event.GLOSSY_REFLECTION) | _SCATTERED_THROUGH
_VOLUME = int(Event.VOLUME_SCATTER)
_POLARISER = int(Event.POLARISER)
_ABSORBED_HERE = int(Event.POLARISER | Event.SURFACE_ABSORPTION)
_RIM = int(Event.RIM_HIT)
_CROSSINGS = int(Event.DETECTOR_CROSSED | Event.DETECTOR_REGISTERED)

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
    color_table: NDArray[np.uint16]


class SpecialFaces(NamedTuple):
    """Faces and sources by number.

    first (n_objects + 1,), face : row of ``face_i`` of each primitive of each object, -1 for none
    polariser (n_faces, 4) : absorption axis and extinction, extinction < 0 for no polariser
    vibration (n_sources, 3) : zero for natural light
    """

    first: I64
    face: I64
    polariser: F64
    vibration: F64


class PolarizedColumns(NamedTuple):
    """What the pass writes.

    waves (2, 6) : scratch, real and imaginary parts of the two fields
    """

    weight: F64
    stokes: NDArray[np.float32]
    path: F64
    phase: NDArray[np.float32]
    event: I32
    kept: I32
    waves: F64


@inner_kernel
def _index(medium_f: F64, medium: int, code: int, color_table: NDArray[np.uint16]) -> float:
    """Refractive index at the colour of a segment, the mean over a mixed one."""
    n_channels = color_table.shape[1]
    if code < n_channels:
        single: float = medium_f[medium, code]
        return single
    total = 0.0
    for k in range(n_channels):
        total += color_table[code - n_channels, k] * medium_f[medium, k]
    return total / COLOR_SCALE


@inner_kernel
def _crossed(
    scene: CompiledScene, nest: int, face: int, cosine: float, x: float, y: float, z: float
) -> int:
    """Nest behind a face and all that coincide with it there, -1 if that cannot be."""
    beyond, _ = cross_face(
        scene.contacts, scene.face_i, scene.face_f, scene.pool, scene.body_i, face, nest, cosine,
        x, y, z,
    )  # fmt: skip
    return beyond


@inner_kernel
def _beyond(
    scene: CompiledScene, nest: int, face: int, cosine: float, medium: int, x: float, y: float,
    z: float,
) -> int:  # fmt: skip
    """Medium on the other side of a face, by the bodies that the ray is known to be in."""
    inside, outside = scene.face_i[face, F_INSIDE], scene.face_i[face, F_OUTSIDE]
    entering = cosine < 0.0
    behind = _crossed(scene, nest, face, cosine, x, y, z)
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
    scene: CompiledScene, rays: RayColumns, special: SpecialFaces, out: PolarizedColumns,
    seed: int, first_ray: int, natural: bool,
) -> None:  # fmt: skip
    """Walk all rays of a portion; fills every column of ``out``."""
    a = 0
    for ray in range(len(rays.records_per_ray)):
        n = rays.records_per_ray[ray]
        out.kept[ray] = _walk(scene, rays, special, out, a, n, seed, first_ray + ray, ray, natural)
        a += n


@inner_kernel
def _walk(
    scene: CompiledScene, rays: RayColumns, special: SpecialFaces, out: PolarizedColumns, a: int,
    n: int, seed: int, ray_id: int, ray: int, natural: bool,
) -> int:  # fmt: skip
    """Follow one ray from record ``a``; how many of its ``n`` records are kept."""
    exact, waves, medium_f = rays.exact, out.waves, scene.medium_f
    state = stream_state(seed ^ _SALT, ray_id)
    source = rays.source[ray]
    nest = scene.source_i[source, L_NEST]
    x, y, z = exact[a, 0], exact[a, 1], exact[a, 2]
    weight, path = 1.0, 0.0
    dx, dy, dz = 0.0, 0.0, 1.0
    for k in range(a, a + n):
        event = rays.event[k]
        out.event[k] = event
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
        if k == a:
            # Emission: natural light, or the vibration of the source
            bx, by, bz = (
                special.vibration[source, 0],
                special.vibration[source, 1],
                special.vibration[source, 2],
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
        elif not last and event & (_REFLECTED | _REFRACTED) != 0:
            weight_here, nest = _specular(
                scene, rays, special, waves, k, event, nest,
                _Bend(x, y, z, dx, dy, dz, ox, oy, oz),
            )  # fmt: skip
            weight *= weight_here
        elif not last and event & _SCATTERED != 0:
            state = advance(state)
            start_waves(waves, ox, oy, oz, natural, 2.0 * math.pi * uniform(state))
            if event & _SCATTERED_THROUGH != 0:
                nest = _through(scene, rays, special, k, nest, x, y, z, dx, dy, dz)
        elif not last and event & _VOLUME != 0:
            medium = rays.medium[k]
            if medium_f[medium, 3 * rays.color_table.shape[1]] == RAYLEIGH:
                # The density of the angle was 3 / 16 pi (1 + cos²), that of the wave is
                # 3 / 8 pi times the power across the new direction
                mu = dx * ox + dy * oy + dz * oz
                power = project_waves(waves, ox, oy, oz)
                weight *= 2.0 * power / (1.0 + mu * mu)
                normalise_waves(waves, power)
            else:
                state = advance(state)
                start_waves(waves, ox, oy, oz, natural, 2.0 * math.pi * uniform(state))
        # A polariser in the face
        face = _face_of(special, rays, k)
        if k > a and not last and face >= 0 and special.polariser[face, 3] >= 0.0:
            power = polarise_waves(waves, ox, oy, oz, special.polariser, face)
            normalise_waves(waves, power)
            state = advance(state)
            if uniform(state) >= power:
                out.event[k] = (event & (_RIM | _CROSSINGS)) | _ABSORBED_HERE
                store_state(waves, ox, oy, oz, k, out.stokes, out.phase)
                out.weight[ray] = weight
                return k - a + 1
            out.event[k] = event | _POLARISER
        store_state(waves, ox, oy, oz, k, out.stokes, out.phase)
        # Go to the next point
        if not last:
            path += next_length * _index(
                medium_f, max(0, rays.medium[k]), rays.color_code[k], rays.color_table
            )
            x, y, z = exact[k + 1, 0], exact[k + 1, 1], exact[k + 1, 2]
            dx, dy, dz = ox, oy, oz
    out.weight[ray] = weight
    return n


@inner_kernel
def _face_of(special: SpecialFaces, rays: RayColumns, k: int) -> int:
    """Row of ``face_i`` of the face met at a record, -1 for none."""
    obj = rays.object[k]
    if obj < 0:
        return -1
    row = special.first[obj] + rays.triangle[k]
    return special.face[row] if row < special.first[obj + 1] else -1


@inner_kernel
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


@inner_kernel
def _through(
    scene: CompiledScene, rays: RayColumns, special: SpecialFaces, k: int, nest: int, x: float,
    y: float, z: float, dx: float, dy: float, dz: float,
) -> int:  # fmt: skip
    """Nest behind the face that a ray has crossed; as it was where that cannot be."""
    face = _face_of(special, rays, k)
    if face < 0:
        return nest
    nx, ny, nz = _normal_at(scene, rays, face, k, x, y, z)
    behind = _crossed(scene, nest, face, dx * nx + dy * ny + dz * nz, x, y, z)
    return behind if behind >= 0 else nest


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


@inner_kernel
def _specular(
    scene: CompiledScene, rays: RayColumns, special: SpecialFaces, waves: F64, k: int, event: int,
    nest: int, bend: _Bend,
) -> tuple[float, int]:  # fmt: skip
    """Reflect or refract the fields at a record; factor of the weight, and the nest behind."""
    x, y, z, dx, dy, dz, ox, oy, oz = bend
    face = _face_of(special, rays, k)
    nx, ny, nz = _normal_at(scene, rays, face, k, x, y, z)
    cosine = dx * nx + dy * ny + dz * nz
    if cosine >= 0.0:
        nx, ny, nz = -nx, -ny, -nz
    surface = scene.face_i[face, F_SURFACE] if face >= 0 else -1
    bare = (
        surface >= 0
        and scene.surface_i[surface, S_KIND] == DIELECTRIC
        and scene.surface_i[surface, S_MODEL] == 0
    )
    before = rays.medium[k - 1]
    factor = 1.0
    if face >= 0 and scene.face_i[face, F_KIND] == MESH:
        m1, m2 = 1.0, 1.0
        if event & _REFRACTED != 0:
            m1 = _index(scene.medium_f, max(0, before), rays.color_code[k], rays.color_table)
            m2 = _index(
                scene.medium_f, max(0, rays.medium[k]), rays.color_code[k], rays.color_table
            )
        nx, ny, nz = _bending_normal(m1, m2, dx, dy, dz, ox, oy, oz, nx, ny, nz)
    if not bare:
        turn_waves(
            waves, dx, dy, dz, nx, ny, nz, ox, oy, oz, 1.0 if event & _REFRACTED != 0 else -1.0
        )
    elif event & _REFRACTED != 0:
        # Where the index depends on the channel, the ray goes on in the channel that was drawn
        code = rays.color_code[k]
        n1 = _index(scene.medium_f, before, code, rays.color_table)
        n2 = _index(scene.medium_f, rays.medium[k], code, rays.color_table)
        cos_i = min(1.0, -(dx * nx + dy * ny + dz * nz))
        chance = 1.0 - fresnel_reflectance(n1, n2, cos_i)
        power = split_waves(waves, dx, dy, dz, nx, ny, nz, n1, n2, 9)
        normalise_waves(waves, power)
        factor = power / chance if chance > 0.0 else 1.0
    else:
        other = _beyond(scene, nest, face, cosine, before, x, y, z)
        code = rays.color_code[k - 1]
        n1 = _index(scene.medium_f, before, code, rays.color_table)
        n2 = _index(scene.medium_f, other, code, rays.color_table)
        cos_i = min(1.0, -(dx * nx + dy * ny + dz * nz))
        chance = fresnel_reflectance(n1, n2, cos_i)
        power = split_waves(waves, dx, dy, dz, nx, ny, nz, n1, n2, 0)
        normalise_waves(waves, power)
        if event & _TIR == 0 and chance > 0.0:
            factor = power / chance
    if event & _REFRACTED != 0 and face >= 0:
        behind = _crossed(scene, nest, face, cosine, x, y, z)
        nest = behind if behind >= 0 else nest
    return factor, nest
