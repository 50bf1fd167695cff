"""Reflection and refraction of a polarised ray at a smooth interface of two dielectrics.

Conventions as in `raymap.optics.fresnel` and `tracer.optics.polarization`: exp(-i w t); the unit
normal points against the incident ray; s = d x n / |d x n| for all three rays and p_j = d_j x s.
A field's squared length is flux, therefore amplitudes of refraction carry the square root of the
tube factor (n2 cos t) / (n1 cos i) and |E_r|^2 + |E_t|^2 = |E_i|^2.

References
----------
Born & Wolf, Principles of Optics, 7th ed., 1.5.2 eqs (20), (21); total reflection 1.5.4 eq (60).
The published phase rules: V. A. Debelov, D. S. Kushner, a lens module for linearly polarised light
(2017): every reflection turns E_perp by pi; E_par by pi iff (n1 < n2 and angle < Brewster) or
(n1 > n2 and angle > Brewster). The rule for E_perp is wrong for n1 > n2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from raymap.jit.kernels import kernel
from raymap.optics.frames import s_vector
from raymap.optics.fresnel import dielectric_amplitudes

__all__ = ["Wave", "published_amplitudes", "split_field"]


@kernel
def published_amplitudes(
    n1: float, n2: float, cos_i: float, r_s: complex, r_p: complex
) -> tuple[complex, complex]:
    """Replace the signs of r_s and r_p by the published rules; the moduli stay.

    In the basis used here (r_p = -r_s at normal incidence) a turn of E_par by pi is r_p > 0.
    """
    tan_i = math.sqrt(max(0.0, 1.0 - cos_i * cos_i)) / cos_i
    below_brewster = tan_i < n2 / n1
    turned = below_brewster if n1 < n2 else not below_brewster
    modulus = abs(r_p)
    return complex(-abs(r_s)), complex(modulus if turned else -modulus)


class Wave(NamedTuple):
    """Field a + i b of a ray, perpendicular to its direction d."""

    ax: float
    ay: float
    az: float
    bx: float
    by: float
    bz: float
    dx: float
    dy: float
    dz: float


@kernel
def split_field(
    wave: Wave, nx: float, ny: float, nz: float, n1: float, n2: float, published: bool
) -> tuple[
    float, float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float, float, float,
    float, bool,
]:  # fmt: skip
    """Reflected and refracted field and direction of one ray.

    Fields are split into real and imaginary parts: below the critical angle all coefficients are
    real and act on each part alone.

    Parameters
    ----------
    wave : incident
    nx, ny, nz : unit normal, d . n < 0
    n1, n2 : refractive indices before and behind
    published : signs of reflection by the published rules instead of Fresnel's equations

    Returns
    -------
    reflected field (3 real, 3 imaginary) and direction (3), refracted field and direction, tube
    factor (n2 cos t) / (n1 cos i), which is 0 at total reflection, and whether the reflected
    vibration stands against the one that a reflection without jumps would give (a half wave)
    """
    ax, ay, az, bx, by, bz, dx, dy, dz = wave
    cos_i = -(dx * nx + dy * ny + dz * nz)
    r_s, r_p, t_s, t_p, cos_t = dielectric_amplitudes(n1, n2, cos_i)
    if published:
        r_s, r_p = published_amplitudes(n1, n2, cos_i, r_s, r_p)

    # Decompose the field along s and p = d x s
    sx, sy, sz = s_vector(dx, dy, dz, nx, ny, nz)
    px, py, pz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
    as_, bs = ax * sx + ay * sy + az * sz, bx * sx + by * sy + bz * sz
    ap, bp = ax * px + ay * py + az * pz, bx * px + by * py + bz * pz

    # Reflect
    twice = 2.0 * cos_i
    rx, ry, rz = dx + twice * nx, dy + twice * ny, dz + twice * nz
    qx, qy, qz = ry * sz - rz * sy, rz * sx - rx * sz, rx * sy - ry * sx
    rs, rp = r_s.real, r_p.real
    us, vs, up, vp = rs * as_, rs * bs, rp * ap, rp * bp
    if cos_t <= 0.0:
        us, vs = us - r_s.imag * bs, vs + r_s.imag * as_
        up, vp = up - r_p.imag * bp, vp + r_p.imag * ap
    power_s, power_p = as_ * as_ + bs * bs, ap * ap + bp * bp
    jumped = rs * abs(rs) * power_s < rp * abs(rp) * power_p
    if cos_t <= 0.0:
        return (
            us * sx + up * qx, us * sy + up * qy, us * sz + up * qz,
            vs * sx + vp * qx, vs * sy + vp * qy, vs * sz + vp * qz,
            rx, ry, rz,
            0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, jumped,
        )  # fmt: skip

    # Refract; amplitudes of flux carry the root of the tube factor
    eta = n1 / n2
    along = eta * cos_i - cos_t
    tx, ty, tz = eta * dx + along * nx, eta * dy + along * ny, eta * dz + along * nz
    tube = (n2 * cos_t) / (n1 * cos_i)
    root = math.sqrt(tube)
    ts, tp = root * t_s, root * t_p
    gs, hs, gp, hp = ts * as_, ts * bs, tp * ap, tp * bp
    wx, wy, wz = ty * sz - tz * sy, tz * sx - tx * sz, tx * sy - ty * sx
    return (
        us * sx + up * qx, us * sy + up * qy, us * sz + up * qz,
        vs * sx + vp * qx, vs * sy + vp * qy, vs * sz + vp * qz,
        rx, ry, rz,
        gs * sx + gp * wx, gs * sy + gp * wy, gs * sz + gp * wz,
        hs * sx + hp * wx, hs * sy + hp * wy, hs * sz + hp * wz,
        tx, ty, tz, tube, jumped,
    )  # fmt: skip
