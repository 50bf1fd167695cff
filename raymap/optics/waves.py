"""The state of a ray of polarised light, and what single steps do to it.

``waves`` (2, 6) holds the real and imaginary parts of two fields across the ray that do not
interfere: one wave for a linear state, two halves for natural light. Their total power is 1 but
within a step. Conventions: exp(-i w t); s, p and signs as in `raymap.optics.fresnel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64
from raymap.optics.frames import s_vector

__all__ = [
    "Turn",
    "normalise_waves",
    "part_along_s",
    "polarise_waves",
    "project_waves",
    "restore_state",
    "retard_waves",
    "start_waves",
    "stokes_axis",
    "store_state",
    "turn_waves",
]

_PARALLEL = 1e-4


@inline_kernel
def stokes_axis(dx: float, dy: float, dz: float) -> tuple[float, float, float]:
    """The axis x of stored Stokes vectors."""
    if dy * dy + dz * dz > 2.0 * _PARALLEL:
        x, y, z = 1.0 - dx * dx, -dx * dy, -dx * dz
    else:
        x, y, z = -dy * dx, 1.0 - dy * dy, -dy * dz
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@inner_kernel
def start_waves(waves: F64, dx: float, dy: float, dz: float, natural: bool, azimuth: float) -> None:
    """Natural light of unit flux: two halves, or one wave of the azimuth that was drawn."""
    x, y, z = stokes_axis(dx, dy, dz)
    u, v, w = dy * z - dz * y, dz * x - dx * z, dx * y - dy * x
    waves[:, :] = 0.0
    if natural:
        half = math.sqrt(0.5)
        waves[0, 0], waves[0, 1], waves[0, 2] = half * x, half * y, half * z
        waves[1, 0], waves[1, 1], waves[1, 2] = half * u, half * v, half * w
    else:
        c, s = math.cos(azimuth), math.sin(azimuth)
        waves[0, 0], waves[0, 1], waves[0, 2] = c * x + s * u, c * y + s * v, c * z + s * w


@inline_kernel
def _wave_count(waves: F64) -> int:
    """1 where the second field is nothing, as in linear states."""
    for i in range(6):
        if waves[1, i] != 0.0:
            return 2
    return 1


@inner_kernel
def project_waves(waves: F64, dx: float, dy: float, dz: float) -> float:
    """Keep the parts of the fields across a direction; the power that is left."""
    power = 0.0
    for k in range(2):
        for part in range(0, 6, 3):
            along = waves[k, part] * dx + waves[k, part + 1] * dy + waves[k, part + 2] * dz
            waves[k, part] -= along * dx
            waves[k, part + 1] -= along * dy
            waves[k, part + 2] -= along * dz
        for i in range(6):
            power += waves[k, i] * waves[k, i]
    return power


@inline_kernel
def normalise_waves(waves: F64, power: float) -> None:
    if power > 0.0:
        scale = 1.0 / math.sqrt(power)
        for k in range(_wave_count(waves)):
            for i in range(6):
                waves[k, i] *= scale


class Turn(NamedTuple):
    """A point at which light turns: its direction d before, o after, and the unit normal n there,
    on the side from which the light comes."""

    dx: float
    dy: float
    dz: float
    ox: float
    oy: float
    oz: float
    nx: float
    ny: float
    nz: float


@inline_kernel
def turn_waves(waves: F64, turn: Turn, a_s: complex, a_p: complex) -> float:
    """Carry the fields to a new direction, s and p with an amplitude each; their power then.

    s = d x n / |d x n| before and after, p = d x s and o x s (`raymap.optics.fresnel`). The
    amplitudes are of flux: |a|² is a share of it.
    """
    dx, dy, dz, ox, oy, oz, nx, ny, nz = turn
    sx, sy, sz = s_vector(dx, dy, dz, nx, ny, nz)
    px, py, pz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
    qx, qy, qz = oy * sz - oz * sy, oz * sx - ox * sz, ox * sy - oy * sx
    real = a_s.imag == 0.0 and a_p.imag == 0.0
    power = 0.0
    for k in range(_wave_count(waves)):
        s = waves[k, 0] * sx + waves[k, 1] * sy + waves[k, 2] * sz
        p = waves[k, 0] * px + waves[k, 1] * py + waves[k, 2] * pz
        t = waves[k, 3] * sx + waves[k, 4] * sy + waves[k, 5] * sz
        q = waves[k, 3] * px + waves[k, 4] * py + waves[k, 5] * pz
        if real:
            s, t, p, q = a_s.real * s, a_s.real * t, a_p.real * p, a_p.real * q
        else:
            s, t = a_s.real * s - a_s.imag * t, a_s.real * t + a_s.imag * s
            p, q = a_p.real * p - a_p.imag * q, a_p.real * q + a_p.imag * p
        waves[k, 0], waves[k, 3] = s * sx + p * qx, t * sx + q * qx
        waves[k, 1], waves[k, 4] = s * sy + p * qy, t * sy + q * qy
        waves[k, 2], waves[k, 5] = s * sz + p * qz, t * sz + q * qz
        power += s * s + t * t + p * p + q * q
    return power


@inner_kernel
def part_along_s(waves: F64, turn: Turn) -> float:
    """Share of the power that vibrates along s."""
    sx, sy, sz = s_vector(turn.dx, turn.dy, turn.dz, turn.nx, turn.ny, turn.nz)
    power = 0.0
    for k in range(2):
        for i in range(0, 6, 3):
            s = waves[k, i] * sx + waves[k, i + 1] * sy + waves[k, i + 2] * sz
            power += s * s
    return power


@inner_kernel
def polarise_waves(
    waves: F64, dx: float, dy: float, dz: float, bx: float, by: float, bz: float, leak: float
) -> float:
    """Send the fields through a sheet that absorbs along b; the power that is left.

    ``leak`` is the amplitude of the absorbed vibration that gets through.
    """
    tx, ty, tz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    length2 = tx * tx + ty * ty + tz * tz
    scale2 = 1.0 / length2 if length2 > 1e-24 else 0.0
    power = 0.0
    for k in range(2):
        for i in range(0, 6, 3):
            a, b, c = waves[k, i], waves[k, i + 1], waves[k, i + 2]
            along = (a * tx + b * ty + c * tz) * scale2
            waves[k, i] = along * tx + leak * (a - along * tx)
            waves[k, i + 1] = along * ty + leak * (b - along * ty)
            waves[k, i + 2] = along * tz + leak * (c - along * tz)
        for i in range(6):
            power += waves[k, i] * waves[k, i]
    return power


@inner_kernel
def retard_waves(
    waves: F64, dx: float, dy: float, dz: float, bx: float, by: float, bz: float, phase: float
) -> None:
    """Delay the vibration along b, as far as it lies across the ray, by a phase [rad]."""
    along = bx * dx + by * dy + bz * dz
    ux, uy, uz = bx - along * dx, by - along * dy, bz - along * dz
    length2 = ux * ux + uy * uy + uz * uz
    if length2 < 1e-24:
        return
    scale = 1.0 / math.sqrt(length2)
    ux, uy, uz = ux * scale, uy * scale, uz * scale
    # exp(-i w t): a longer way turns the field by a positive phase
    cosine, sine = math.cos(phase) - 1.0, math.sin(phase)
    for k in range(2):
        a = waves[k, 0] * ux + waves[k, 1] * uy + waves[k, 2] * uz
        b = waves[k, 3] * ux + waves[k, 4] * uy + waves[k, 5] * uz
        real, imaginary = cosine * a - sine * b, cosine * b + sine * a
        waves[k, 0] += real * ux
        waves[k, 1] += real * uy
        waves[k, 2] += real * uz
        waves[k, 3] += imaginary * ux
        waves[k, 4] += imaginary * uy
        waves[k, 5] += imaginary * uz


@inline_kernel
def store_state(
    waves: F64, dx: float, dy: float, dz: float, record: int, stokes: NDArray[np.float32],
    phase: NDArray[np.float32],
) -> None:  # fmt: skip
    """Stokes vector over flux; phase of the first wave along x, or along y if x has nothing."""
    x, y, z = stokes_axis(dx, dy, dz)
    u, v, w = dy * z - dz * y, dz * x - dx * z, dx * y - dy * x
    s1, s2, s3 = 0.0, 0.0, 0.0
    for k in range(_wave_count(waves)):
        a, b = (
            waves[k, 0] * x + waves[k, 1] * y + waves[k, 2] * z,
            waves[k, 3] * x + waves[k, 4] * y + waves[k, 5] * z,
        )
        c, d = (
            waves[k, 0] * u + waves[k, 1] * v + waves[k, 2] * w,
            waves[k, 3] * u + waves[k, 4] * v + waves[k, 5] * w,
        )
        s1 += a * a + b * b - c * c - d * d
        s2 += 2.0 * (a * c + b * d)
        s3 -= 2.0 * (a * d - b * c)
        if k == 0 and len(phase) > 0:
            phase[record] = math.atan2(b, a) if a * a + b * b > 1e-12 else math.atan2(d, c)
    stokes[record, 0], stokes[record, 1], stokes[record, 2] = s1, s2, s3


@inner_kernel
def restore_state(
    waves: F64, dx: float, dy: float, dz: float, s1: float, s2: float, s3: float
) -> None:
    """Fields of unit power that have a stored Stokes vector (s1, s2, s3) over s0.

    One wave in the state of the polarised part, with half of the rest, and one across it with the
    other half: Born & Wolf, Principles of Optics, 7th ed., 10.9.2.
    """
    x, y, z = stokes_axis(dx, dy, dz)
    u, v, w = dy * z - dz * y, dz * x - dx * z, dx * y - dy * x
    degree = math.sqrt(s1 * s1 + s2 * s2 + s3 * s3)
    a, c, d = 1.0, 0.0, 0.0
    if degree > 1e-12:
        a = math.sqrt(max(0.0, 0.5 * (1.0 + s1 / degree)))
        c, d = (0.5 * s2 / (degree * a), -0.5 * s3 / (degree * a)) if a > 1e-6 else (1.0, 0.0)
    degree = min(1.0, degree)
    # The wave (a, c + i d) along x and y, and (-c + i d, a) across it
    one, two = math.sqrt(0.5 * (1.0 + degree)), math.sqrt(0.5 * (1.0 - degree))
    waves[0, 0], waves[0, 3] = one * (a * x + c * u), one * d * u
    waves[0, 1], waves[0, 4] = one * (a * y + c * v), one * d * v
    waves[0, 2], waves[0, 5] = one * (a * z + c * w), one * d * w
    waves[1, 0], waves[1, 3] = two * (a * u - c * x), two * d * x
    waves[1, 1], waves[1, 4] = two * (a * v - c * y), two * d * y
    waves[1, 2], waves[1, 5] = two * (a * w - c * z), two * d * z
