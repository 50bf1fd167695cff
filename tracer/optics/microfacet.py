"""Rough surfaces of microscopic facets with the GGX distribution of slopes.

Convention of all scattering models: a local frame with z = surface normal on the side of the
incident ray; ``wi`` points back along the incident ray (wi_z > 0), ``wo`` along the scattered ray,
wo_z > 0 where it is reflected, wo_z < 0 where it is transmitted. ``sample_*`` draws wo, ``pdf_*``
is its density per solid angle of wo, ``eval_*`` the BSDF [1/sr] without the cosine: flux goes into
a solid angle as eval · |wo_z| · dω. For transmission that is the scattering of flux (radiance in
physical units), so that eval(wi, wo) / n_o² = eval(wo, wi) / n_i².

The facets shadow each other (Smith, G = G1 G1). Light whose first facet would send it into another
one is not lost: it leaves by the compensating lobe of Kulla and Conty, which keeps the model
reciprocal and its energy exact. To sample, a visible facet is drawn; its light gets away with the
probability G1(wo), and else by the compensating lobe, which so receives exactly what is missing.

References
----------
B. Walter, S. Marschner, H. Li, K. Torrance, EGSR 2007, eqs (16) to (21), (33), (34).
J. Dupuy, A. Benyoub, Sampling visible GGX normals with spherical caps, CGF 42(8) (2023).
C. Kulla, A. Conty, Revisiting physically based shading at Imageworks, SIGGRAPH courses (2017).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from raymap.optics.fresnel import cos2_refracted, fresnel_reflectance
from tracer.optics.ggx import ggx_distribution, ggx_masking, sample_ggx_normal
from tracer.optics.microfacet_losses import (
    LOBE,
    NODES,
    between,
    compensation,
    index_node,
    loss,
    sample_lobe,
    side_loss,
)

__all__ = [
    "eval_rough_conductor",
    "eval_rough_dielectric",
    "pdf_rough_conductor",
    "pdf_rough_dielectric",
    "sample_rough_conductor",
    "sample_rough_dielectric",
]

F64 = NDArray[np.float64]


@lean_kernel
def sample_rough_conductor(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, alpha: float,
    u1: float, u2: float, u3: float, u4: float, u5: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Reflect at a rough metal of reflectance 1.

    Parameters
    ----------
    table, first : flat pool and where the table of `conductor_table` stands in it
    wi_x, wi_y, wi_z : local direction back along the incident ray
    alpha : GGX roughness
    u1 .. u5 : uniform numbers

    Returns
    -------
    wo_x, wo_y, wo_z : local direction
    cos_m : cosine at the facet, at which each channel's Fresnel reflectance is the probability to
        survive; or -1: several facets were met, the probability is the channel's value of
        `multiple_reflectance`
    """
    mx, my, mz = sample_ggx_normal(wi_x, wi_y, wi_z, alpha, u1, u2)
    cos_m = wi_x * mx + wi_y * my + wi_z * mz
    x, y, z = 2.0 * cos_m * mx - wi_x, 2.0 * cos_m * my - wi_y, 2.0 * cos_m * mz - wi_z
    if z > 0.0 and u3 < ggx_masking(alpha, z):
        return x, y, z, min(1.0, max(0.0, cos_m))
    x, y, z = sample_lobe(table, first, u4, u5, 1.0)
    return x, y, z, -1.0


@lean_kernel
def eval_rough_conductor(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float,
) -> tuple[float, float, float]:  # fmt: skip
    """BSDF of a rough metal of reflectance 1 [1/sr], in two parts.

    Returns
    -------
    single : to be multiplied by the Fresnel reflectance at ``cos_m``
    multiple : to be multiplied by the channel's `multiple_reflectance`
    cos_m : cosine at the facet
    """
    if wi_z <= 0.0 or wo_z <= 0.0:
        return 0.0, 0.0, 0.0
    hx, hy, hz = wi_x + wo_x, wi_y + wo_y, wi_z + wo_z
    scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
    cos_m = (wi_x * hx + wi_y * hy + wi_z * hz) * scale
    masking = ggx_masking(alpha, wi_z) * ggx_masking(alpha, wo_z)
    single = ggx_distribution(alpha, hz * scale) * masking / (4.0 * wi_z * wo_z)
    mean = table[first + 2 * NODES]
    multiple = 0.0
    if mean > 0.0:
        multiple = loss(table, first, wi_z) * loss(table, first, wo_z) / (math.pi * mean)
    return single, multiple, cos_m


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
    n_o: float, u1: float, u2: float, u3: float, u4: float, u5: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Reflect or refract at a rough interface; nothing is absorbed.

    Parameters
    ----------
    table, first : flat pool and where the table of `dielectric_table` stands in it
    wi_x, wi_y, wi_z : local direction back along the incident ray
    alpha : GGX roughness
    n_i, n_o : indices on the incident side and beyond
    u1 .. u5 : uniform numbers

    Returns
    -------
    wo_x, wo_y, wo_z : local direction; wo_z > 0 reflected, < 0 transmitted
    cos_m : cosine at the facet, or -1 where the compensating lobe was taken
    """
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
    x, y, z = sample_lobe(table, low, u4, u5, sign)
    return x, y, z, -1.0


@lean_kernel
def eval_rough_dielectric(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float, n_i: float, n_o: float,
) -> float:  # fmt: skip
    """BSDF of a rough interface [1/sr], both sides, with the compensating lobe."""
    if wi_z <= 0.0 or wo_z == 0.0:
        return 0.0
    masking = ggx_masking(alpha, wi_z) * ggx_masking(alpha, wo_z)
    loss_i = side_loss(table, first, n_i / n_o, wi_z)
    back, through = compensation(table, first, n_i, n_o)
    if wo_z > 0.0:
        hx, hy, hz = wi_x + wo_x, wi_y + wo_y, wi_z + wo_z
        scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
        cos_m = min(1.0, (wi_x * hx + wi_y * hy + wi_z * hz) * scale)
        single = fresnel_reflectance(n_i, n_o, cos_m) * masking
        single *= ggx_distribution(alpha, hz * scale) / (4.0 * wi_z * wo_z)
        mean = between(table, first, n_i / n_o, 2 * NODES)
        if mean <= 0.0:
            return single
        loss_o = side_loss(table, first, n_i / n_o, wo_z)
        return single + back * loss_i * loss_o / (math.pi * mean)
    # Half vector of refraction, on the incident side
    hx, hy, hz = n_i * wi_x + n_o * wo_x, n_i * wi_y + n_o * wo_y, n_i * wi_z + n_o * wo_z
    norm = math.sqrt(hx * hx + hy * hy + hz * hz)
    single = 0.0
    if norm > 0.0:
        scale = -1.0 / norm if hz < 0.0 else 1.0 / norm
        hx, hy, hz = hx * scale, hy * scale, hz * scale
        dot_i = wi_x * hx + wi_y * hy + wi_z * hz
        dot_o = wo_x * hx + wo_y * hy + wo_z * hz
        if dot_i > 0.0 and dot_o < 0.0:
            jacobian = n_i * dot_i + n_o * dot_o
            single = 1.0 - fresnel_reflectance(n_i, n_o, min(1.0, dot_i))
            single *= n_o * n_o * dot_i * -dot_o * masking * ggx_distribution(alpha, hz)
            single /= wi_z * -wo_z * jacobian * jacobian
    mean = between(table, first, n_o / n_i, 2 * NODES)
    if mean <= 0.0:
        return single
    loss_o = side_loss(table, first, n_o / n_i, -wo_z)
    return single + through * loss_i * loss_o / (math.pi * mean)


@lean_kernel
def pdf_rough_dielectric(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float, n_i: float, n_o: float,
) -> float:  # fmt: skip
    """Density of `sample_rough_dielectric` per solid angle: eval · |wo_z|, as nothing is lost."""
    value = eval_rough_dielectric(table, first, wi_x, wi_y, wi_z, wo_x, wo_y, wo_z, alpha, n_i, n_o)
    return value * abs(wo_z)
