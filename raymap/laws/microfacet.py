"""BSDF of rough surfaces of microscopic facets with the GGX distribution of slopes.

Convention of all scattering models: a local frame with z = surface normal on the side of the
incident ray; ``wi`` points back along the incident ray (wi_z > 0), ``wo`` along the scattered ray,
wo_z > 0 where it is reflected, wo_z < 0 where it is transmitted. ``eval_*`` is the BSDF [1/sr]
without the cosine: flux goes into a solid angle as eval · |wo_z| · dω. For transmission that is the
scattering of flux (radiance in physical units), so that eval(wi, wo) / n_o² = eval(wo, wi) / n_i².

The facets shadow each other (Smith, G = G1 G1). Light whose first facet would send it into another
one is not lost: it leaves by the compensating lobe of Kulla and Conty, which keeps the model
reciprocal and its energy exact.

References
----------
B. Walter, S. Marschner, H. Li, K. Torrance, EGSR 2007, eqs (16) to (21), (33), (34).
C. Kulla, A. Conty, Revisiting physically based shading at Imageworks, SIGGRAPH courses (2017).
"""

from __future__ import annotations

import math

from raymap.jit.kernels import lean_kernel
from raymap.jit.types import F64
from raymap.laws.microfacet_losses import NODES, between, compensation, loss, side_loss
from raymap.optics.fresnel import fresnel_reflectance
from raymap.optics.ggx import ggx_distribution, ggx_masking

__all__ = ["eval_rough_conductor", "eval_rough_dielectric", "rough_dielectric_parts"]


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
def eval_rough_dielectric(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float, n_i: float, n_o: float,
) -> float:  # fmt: skip
    """BSDF of a rough interface [1/sr], both sides, with the compensating lobe."""
    single, multiple = rough_dielectric_parts(
        table, first, wi_x, wi_y, wi_z, wo_x, wo_y, wo_z, alpha, n_i, n_o
    )
    return single + multiple


@lean_kernel
def rough_dielectric_parts(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float, n_i: float, n_o: float,
) -> tuple[float, float]:  # fmt: skip
    """`eval_rough_dielectric` of light that met one facet, and of light that met several."""
    if wi_z <= 0.0 or wo_z == 0.0:
        return 0.0, 0.0
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
            return single, 0.0
        loss_o = side_loss(table, first, n_i / n_o, wo_z)
        return single, back * loss_i * loss_o / (math.pi * mean)
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
        return single, 0.0
    loss_o = side_loss(table, first, n_o / n_i, -wo_z)
    return single, through * loss_i * loss_o / (math.pi * mean)
