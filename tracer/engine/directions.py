"""Frames about a direction, and directions sampled about it."""

from __future__ import annotations

import math

from raymap.kernels import inner_kernel

__all__ = ["about", "sample_cosine_cone", "sample_uniform_cone"]


@inner_kernel
def about(
    nx: float, ny: float, nz: float, cosine: float, azimuth: float
) -> tuple[float, float, float]:
    """Unit vector at ``cosine`` from the unit vector n and at ``azimuth`` about it [rad].

    References
    ----------
    T. Duff et al., Building an orthonormal basis, revisited, J. Comput. Graph. Tech. 6(1) (2017).
    """
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    p = sine * math.cos(azimuth)
    q = sine * math.sin(azimuth)
    x = p * (1.0 + sign * nx * nx * a) + q * b + cosine * nx
    y = p * sign * b + q * (sign + ny * ny * a) + cosine * ny
    z = -p * sign * nx - q * ny + cosine * nz
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@inner_kernel
def sample_cosine_cone(u: float, cos_max: float) -> float:
    """Cosine from the normal, density cos/π/(1 - cos_max²) per solid angle within the cone."""
    return math.sqrt(1.0 - u * (1.0 - cos_max * cos_max))


@inner_kernel
def sample_uniform_cone(u: float, cos_max: float) -> float:
    """Cosine from the axis, density 1/(2π (1 - cos_max)) per solid angle within the cone."""
    return 1.0 - u * (1.0 - cos_max)
