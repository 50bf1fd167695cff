"""The waves of a ray of polarised light: what one step of the pass does to them.

``waves`` (2, 6) holds the real and imaginary parts of two fields that do not interfere: together
they are the state of the ray, its total power 1 but within a step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64
from raymap.optics.frames import s_vector
from tracer.optics.polarization_fresnel import Wave, split_field

__all__ = [
    "normalise_waves",
    "polarise_waves",
    "project_waves",
    "split_waves",
    "start_waves",
    "stokes_axis",
    "store_state",
    "turn_waves",
]

_PARALLEL = 1e-4


@inner_kernel
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


@inner_kernel
def normalise_waves(waves: F64, power: float) -> None:
    if power > 0.0:
        scale = 1.0 / math.sqrt(power)
        for k in range(2):
            for i in range(6):
                waves[k, i] *= scale


@inner_kernel
def split_waves(
    waves: F64, dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, n1: float,
    n2: float, first: int,
) -> float:  # fmt: skip
    """Replace the fields by the reflected (first = 0) or refracted (9) ones; their power."""
    power = 0.0
    for k in range(2):
        wave = Wave(
            waves[k, 0], waves[k, 1], waves[k, 2], waves[k, 3], waves[k, 4], waves[k, 5],
            dx, dy, dz,
        )  # fmt: skip
        parts = split_field(wave, nx, ny, nz, n1, n2, False)
        if first == 0:
            waves[k, 0], waves[k, 1], waves[k, 2] = parts[0], parts[1], parts[2]
            waves[k, 3], waves[k, 4], waves[k, 5] = parts[3], parts[4], parts[5]
        else:
            waves[k, 0], waves[k, 1], waves[k, 2] = parts[9], parts[10], parts[11]
            waves[k, 3], waves[k, 4], waves[k, 5] = parts[12], parts[13], parts[14]
        for i in range(6):
            power += waves[k, i] * waves[k, i]
    return power


@inner_kernel
def turn_waves(
    waves: F64, dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, ox: float,
    oy: float, oz: float, sign: float,
) -> None:  # fmt: skip
    """Carry the fields to a new direction: s keeps ``sign`` times its part, p its own.

    ``sign`` = -1 is a perfect metal, +1 a transmission that treats both alike.
    """
    sx, sy, sz = s_vector(dx, dy, dz, nx, ny, nz)
    px, py, pz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
    qx, qy, qz = oy * sz - oz * sy, oz * sx - ox * sz, ox * sy - oy * sx
    for k in range(2):
        for i in range(0, 6, 3):
            a, b, c = waves[k, i], waves[k, i + 1], waves[k, i + 2]
            s = sign * (a * sx + b * sy + c * sz)
            p = a * px + b * py + c * pz
            waves[k, i] = s * sx + p * qx
            waves[k, i + 1] = s * sy + p * qy
            waves[k, i + 2] = s * sz + p * qz


@inner_kernel
def polarise_waves(waves: F64, dx: float, dy: float, dz: float, polariser: F64, face: int) -> float:
    """Send the fields through a sheet polariser; the power that is left."""
    bx, by, bz = polariser[face, 0], polariser[face, 1], polariser[face, 2]
    tx, ty, tz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    length2 = tx * tx + ty * ty + tz * tz
    leak = math.sqrt(polariser[face, 3])
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
def store_state(
    waves: F64, dx: float, dy: float, dz: float, record: int, stokes: NDArray[np.float32],
    phase: NDArray[np.float32],
) -> None:  # fmt: skip
    """Stokes vector over flux; phase of the first wave along x, or along y if x has nothing."""
    x, y, z = stokes_axis(dx, dy, dz)
    u, v, w = dy * z - dz * y, dz * x - dx * z, dx * y - dy * x
    s1, s2, s3 = 0.0, 0.0, 0.0
    for k in range(2):
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
