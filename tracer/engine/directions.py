"""Frames about a direction, and directions sampled about it."""

from __future__ import annotations

import math

from raymap.kernels import inline_kernel, inner_kernel

__all__ = ["about", "about_turn", "sample_cosine_cone", "sample_uniform_cone"]

_TURN = 2.0 * math.pi


@inner_kernel
def about(
    nx: float, ny: float, nz: float, cosine: float, azimuth: float
) -> tuple[float, float, float]:
    """Unit vector at ``cosine`` from the unit vector n and at ``azimuth`` about it [rad].

    References
    ----------
    T. Duff et al., Building an orthonormal basis, revisited, J. Comput. Graph. Tech. 6(1) (2017).
    """
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    return _in_frame(nx, ny, nz, sine * math.cos(azimuth), sine * math.sin(azimuth), cosine)


@inner_kernel
def about_turn(
    nx: float, ny: float, nz: float, cosine: float, sine: float, u: float
) -> tuple[float, float, float]:
    """As `about`, for a known sine of the angle from n and an azimuth of ``u`` turns (0 to 1)."""
    c, s = _turned(u)
    return _in_frame(nx, ny, nz, sine * c, sine * s, cosine)


@inline_kernel
def _turned(u: float) -> tuple[float, float]:
    """Cosine and sine of 2 pi u for u from 0 to 1, within a rounding or two.

    References
    ----------
    The polynomials of FDLIBM, Sun Microsystems 1993, for angles up to an eighth of a turn.
    """
    quarter = int(4.0 * u + 0.5)
    x = _TURN * (u - 0.25 * quarter)
    z = x * x
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)  # noqa: E501  # fmt: skip
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
    s = x + x * z * (-1.66666666666666324348e-01 + z * s)
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)  # noqa: E501  # fmt: skip
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c)
    c = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * c))
    # Turn on by whole quarters
    odd = quarter & 1 != 0
    cosine, sine = (s if odd else c), (c if odd else s)
    return (
        -cosine if (quarter + 1) & 2 != 0 else cosine,
        -sine if quarter & 2 != 0 else sine,
    )


@inline_kernel
def _in_frame(
    nx: float, ny: float, nz: float, p: float, q: float, cosine: float
) -> tuple[float, float, float]:
    """The unit vector of which n is the third axis of the frame, and p and q go across."""
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    x = p * (1.0 + sign * nx * nx * a) + q * b + cosine * nx
    y = p * sign * b + q * (sign + ny * ny * a) + cosine * ny
    z = -p * sign * nx - q * ny + cosine * nz
    # A step of Newton's takes away what rounding has left of the length
    scale = 1.5 - 0.5 * (x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@inner_kernel
def sample_cosine_cone(u: float, cos_max: float) -> float:
    """Cosine from the normal, density cos/π/(1 - cos_max²) per solid angle within the cone."""
    return math.sqrt(1.0 - u * (1.0 - cos_max * cos_max))


@inner_kernel
def sample_uniform_cone(u: float, cos_max: float) -> float:
    """Cosine from the axis, density 1/(2π (1 - cos_max)) per solid angle within the cone."""
    return 1.0 - u * (1.0 - cos_max)
