"""Draws directions from rough surfaces of microscopic facets (`raymap.laws.microfacet`).

``sample_*`` draws wo, ``pdf_*`` is its density per solid angle of wo. A visible facet is drawn; its
light gets away with the probability G1(wo), and else by the compensating lobe, which so receives
exactly what is missing.

References
----------
J. Dupuy, A. Benyoub, Sampling visible GGX normals with spherical caps, CGF 42(8) (2023).
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.types import F64
from raymap.laws.microfacet import eval_rough_conductor, eval_rough_dielectric
from raymap.laws.microfacet_losses import (
    LOBE,
    NODES,
    compensation,
    index_node,
    lobe_integral,
)
from raymap.optics.angles import turned
from raymap.optics.fresnel import cos2_refracted, fresnel_reflectance
from raymap.optics.ggx import Vector, ggx_masking, sample_ggx_normal

__all__ = [
    "pdf_rough_conductor",
    "pdf_rough_dielectric",
    "sample_rough_conductor",
    "sample_rough_dielectric",
]

Numbers = tuple[float, float, float, float, float]


@lean_kernel
def sample_rough_conductor(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, alpha: float, u: Numbers
) -> tuple[float, float, float, float]:  # fmt: skip
    """Reflect at a rough metal of reflectance 1.

    Parameters
    ----------
    table, first : flat pool and where the table of `conductor_table` stands in it
    wi_x, wi_y, wi_z : local direction back along the incident ray
    alpha : GGX roughness
    u : uniform numbers

    Returns
    -------
    wo_x, wo_y, wo_z : local direction
    cos_m : cosine at the facet, at which each channel's Fresnel reflectance is the probability to
        survive; or -1: several facets were met, the probability is the channel's value of
        `multiple_reflectance`
    """
    u1, u2, u3, u4, u5 = u
    mx, my, mz = sample_ggx_normal(wi_x, wi_y, wi_z, alpha, u1, u2)
    cos_m = wi_x * mx + wi_y * my + wi_z * mz
    x, y, z = 2.0 * cos_m * mx - wi_x, 2.0 * cos_m * my - wi_y, 2.0 * cos_m * mz - wi_z
    if z > 0.0 and u3 < ggx_masking(alpha, z):
        return x, y, z, min(1.0, max(0.0, cos_m))
    x, y, z = _sample_lobe(table, first, u4, u5, 1.0)
    return x, y, z, -1.0


@lean_kernel
def pdf_rough_conductor(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float,
) -> float:  # fmt: skip
    """Density of `sample_rough_conductor` per solid angle."""
    single, multiple, _ = eval_rough_conductor(
        table, first, wi_x, wi_y, wi_z, wo_x, wo_y, wo_z, alpha
    )
    return (single + multiple) * max(0.0, wo_z)


@lean_kernel
def sample_rough_dielectric(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, alpha: float, n_i: float,
    n_o: float, u: Numbers,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Reflect or refract at a rough interface; nothing is absorbed.

    Parameters
    ----------
    table, first : flat pool and where the table of `dielectric_table` stands in it
    wi_x, wi_y, wi_z : local direction back along the incident ray
    alpha : GGX roughness
    n_i, n_o : indices on the incident side and beyond
    u : uniform numbers

    Returns
    -------
    wo_x, wo_y, wo_z : local direction; wo_z > 0 reflected, < 0 transmitted
    cos_m : cosine at the facet, or -1 where the compensating lobe was taken
    """
    u1, u2, u3, u4, u5 = u
    mx, my, mz = sample_ggx_normal(wi_x, wi_y, wi_z, alpha, u1, u2)
    cos_m = min(1.0, wi_x * mx + wi_y * my + wi_z * mz)
    reflectance = fresnel_reflectance(n_i, n_o, cos_m)
    if u3 < reflectance:
        u3 /= reflectance
        x, y, z = 2.0 * cos_m * mx - wi_x, 2.0 * cos_m * my - wi_y, 2.0 * cos_m * mz - wi_z
        leaves = z > 0.0
    else:
        u3 = (u3 - reflectance) / (1.0 - reflectance)
        eta = n_i / n_o
        cos_t = math.sqrt(max(0.0, cos2_refracted(eta, cos_m)))
        along = eta * cos_m - cos_t
        x, y, z = along * mx - eta * wi_x, along * my - eta * wi_y, along * mz - eta * wi_z
        leaves = z < 0.0
    masking = ggx_masking(alpha, z) if leaves else 0.0
    if u3 < masking:
        return x, y, z, cos_m
    # Leave by the compensating lobe, on one of the sides
    u3 = (u3 - masking) / (1.0 - masking)
    x_index, weight = index_node(n_i / n_o)
    back, _ = compensation(table, first, n_i, n_o)
    sign = 1.0
    if u3 < back:
        u3 /= back
    else:
        u3 = (u3 - back) / (1.0 - back)
        sign = -1.0
        x_index, weight = index_node(n_o / n_i)
    # The lobe is a mixture of those of two nodes of the index ratio
    low = first + x_index * LOBE
    mean_low = (1.0 - weight) * table[low + 2 * NODES]
    mean_high = weight * table[low + LOBE + 2 * NODES]
    if u3 * (mean_low + mean_high) >= mean_low:
        low += LOBE
    x, y, z = _sample_lobe(table, low, u4, u5, sign)
    return x, y, z, -1.0


@lean_kernel
def pdf_rough_dielectric(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float, n_i: float, n_o: float,
) -> float:  # fmt: skip
    """Density of `sample_rough_dielectric` per solid angle: eval · |wo_z|, as nothing is lost."""
    value = eval_rough_dielectric(table, first, wi_x, wi_y, wi_z, wo_x, wo_y, wo_z, alpha, n_i, n_o)
    return value * abs(wo_z)


@inner_kernel
def _sample_lobe(table: F64, first: int, u1: float, u2: float, sign: float) -> Vector:
    """A direction with density proportional to the losses of a table times the cosine."""
    # Find the interval of the cosine, then invert the cubic inside it
    cumulative = first + NODES
    low, high = 0, NODES - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[cumulative + middle] <= u1:
            low = middle
        else:
            high = middle
    step = 1.0 / (NODES - 1)
    left = low * step
    a, b = table[first + low], (table[first + low + 1] - table[first + low]) / step
    part = table[cumulative + low + 1] - table[cumulative + low]
    share = (u1 - table[cumulative + low]) / part if part > 0.0 else 0.5
    whole = lobe_integral(a, b, left, step)
    t = share * step
    lower, upper = 0.0, step
    for _ in range(20):
        miss = lobe_integral(a, b, left, t) - share * whole
        if miss > 0.0:
            upper = t
        else:
            lower = t
        slope = (a + b * t) * (left + t)
        guess = t - miss / slope if slope > 0.0 else 0.5 * (lower + upper)
        if not lower <= guess <= upper:
            guess = 0.5 * (lower + upper)
        if abs(guess - t) < 1e-14:
            break
        t = guess
    cosine = min(1.0, max(1e-9, left + t))
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    along, across = turned(u2)
    return sine * along, sine * across, sign * cosine
