"""Directions at an angle and azimuth about another one, the azimuth in turns."""

from __future__ import annotations

import math

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.optics.angles import turned
from raymap.optics.frames import frame_about, unit_factor

__all__ = ["about", "sample_cosine_cone", "sample_uniform_cone", "sine_of"]


@inner_kernel
def about(
    nx: float, ny: float, nz: float, cosine: float, sine: float, u: float
) -> tuple[float, float, float]:
    """Unit vector at an angle from the unit vector n, at an azimuth of ``u`` turns (0 to 1)."""
    c, s = turned(u)
    p, q = sine * c, sine * s
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    x = p * ux + q * vx + cosine * nx
    y = p * uy + q * vy + cosine * ny
    z = p * uz + q * vz + cosine * nz
    scale = unit_factor(x, y, z)
    return x * scale, y * scale, z * scale


@inline_kernel
def sine_of(cosine: float) -> float:
    """Sine of an angle between 0 and 180 degrees, from its cosine."""
    return math.sqrt(max(0.0, 1.0 - cosine * cosine))


@inner_kernel
def sample_cosine_cone(u: float, cos_max: float) -> float:
    """Cosine from the normal, density cos/π/(1 - cos_max²) per solid angle within the cone."""
    return math.sqrt(1.0 - u * (1.0 - cos_max * cos_max))


@inner_kernel
def sample_uniform_cone(u: float, cos_max: float) -> float:
    """Cosine from the axis, density 1/(2π (1 - cos_max)) per solid angle within the cone."""
    return 1.0 - u * (1.0 - cos_max)
