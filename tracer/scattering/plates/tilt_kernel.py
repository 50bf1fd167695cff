"""A rough face without geometry: every hit draws its own local normal.

The normal's tilt theta_m follows a distribution p(theta_m) with p cos(theta_m) normalised over the
hemisphere, seen from the ray: facets count with the area that they turn towards it. The
light is refracted or reflected by Fresnel at that normal; a direction that ends on the wrong side
of the mean plane is drawn again.

References
----------
B. Walter et al., Microfacet models for refraction through rough surfaces, EGSR 2007.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from raymap.optics.angles import turned
from raymap.optics.fresnel import fresnel_reflectance, refract
from tracer.rays.random import advance, uniform

__all__ = ["rough_face", "sample_slope"]

_TRIES = 1000


@kernel
def sample_slope(table: NDArray[np.float64], u: float) -> float:
    """Tangent of a tilt: ``table`` holds it for evenly spaced u from 0 to 1."""
    place = u * (table.size - 1)
    low = min(int(place), table.size - 2)
    return float(table[low] + (place - low) * (table[low + 1] - table[low]))


@kernel
def rough_face(
    dx: float,
    dy: float,
    dz: float,
    n1: float,
    n2: float,
    table: NDArray[np.float64],
    state: np.uint64,
) -> tuple[float, float, float, bool, np.uint64]:
    """Direction after a rough face, whether it went through, and the state of the random numbers.

    Parameters
    ----------
    dx, dy, dz : unit direction, dz > 0 towards the face
    n1, n2 : indices before and behind the face
    table : slopes of `sample_slope`
    state : of the random numbers
    """
    sine = math.sqrt(max(0.0, 1.0 - dz * dz))
    largest = dz + sine * table[table.size - 1]
    for _ in range(_TRIES):
        # Draw a normal, seen from the ray
        state = advance(state)
        slope = sample_slope(table, uniform(state))
        state = advance(state)
        c, s = turned(uniform(state))
        sx, sy = slope * c, slope * s
        seen = dz + dx * sx + dy * sy
        state = advance(state)
        if seen <= uniform(state) * largest:
            continue
        # Reflect or refract at it
        length = math.sqrt(1.0 + slope * slope)
        mx, my, mz = sx / length, sy / length, 1.0 / length
        cos_i = min(1.0, seen / length)
        state = advance(state)
        if uniform(state) < fresnel_reflectance(n1, n2, cos_i):
            ox, oy, oz = dx - 2.0 * cos_i * mx, dy - 2.0 * cos_i * my, dz - 2.0 * cos_i * mz
            if oz < 0.0:
                return ox, oy, oz, False, state
        else:
            ox, oy, oz, cos_t = refract(dx, dy, dz, -mx, -my, -mz, n1 / n2)
            if cos_t > 0.0 and oz > 0.0:
                return ox, oy, oz, True, state
    # Grazing light on steep tilts: fall back on the mean plane
    return dx, dy, -dz, False, state
