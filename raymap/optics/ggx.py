"""The GGX distribution of microscopic slopes: density, masking, and visible facets.

``alpha`` is the roughness, directions are in the frame of the surface, z its normal.

References
----------
B. Walter, S. Marschner, H. Li, K. Torrance, EGSR 2007, eqs (33), (34).
J. Dupuy, A. Benyoub, Sampling visible GGX normals with spherical caps, CGF 42(8) (2023).
"""

from __future__ import annotations

import math

from raymap.jit.kernels import lean_kernel
from raymap.optics.angles import turned

__all__ = ["Vector", "ggx_distribution", "ggx_masking", "sample_ggx_normal"]

Vector = tuple[float, float, float]


@lean_kernel
def ggx_distribution(alpha: float, cos_m: float) -> float:
    """Density of facets D(m) over the cosine of their tilt; ∫ D cos_m dω = 1."""
    if cos_m <= 0.0:
        return 0.0
    a2 = alpha * alpha
    c2 = cos_m * cos_m
    x = 1.0 - c2 + a2 * c2
    return a2 / (math.pi * x * x)


@lean_kernel
def ggx_masking(alpha: float, cosine: float) -> float:
    """Smith's G1: share of facets that a direction at this cosine sees unhidden."""
    c2 = cosine * cosine
    if c2 >= 1.0:
        return 1.0
    return 2.0 / (1.0 + math.sqrt(1.0 + alpha * alpha * (1.0 - c2) / c2))


@lean_kernel
def sample_ggx_normal(
    wi_x: float, wi_y: float, wi_z: float, alpha: float, u1: float, u2: float
) -> Vector:
    """A facet normal as ``wi`` sees them: density D(m) G1(wi) (wi . m) / wi_z per solid angle."""
    # Stretch to the hemisphere, draw a spherical cap, squeeze back
    x, y, z = alpha * wi_x, alpha * wi_y, wi_z
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    x, y, z = x * scale, y * scale, z * scale
    height = (1.0 - u2) * (1.0 + z) - z
    sine = math.sqrt(min(1.0, max(0.0, 1.0 - height * height)))
    along, across = turned(u1)
    mx = alpha * (sine * along + x)
    my = alpha * (sine * across + y)
    mz = max(1e-12, height + z)
    scale = 1.0 / math.sqrt(mx * mx + my * my + mz * mz)
    return mx * scale, my * scale, mz * scale
