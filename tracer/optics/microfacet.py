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

from raymap.errors import SceneError
from raymap.kernels import inner_kernel, lean_kernel
from tracer.optics.fresnel import fresnel_conductor, fresnel_reflectance

__all__ = [
    "average_conductor_reflectance",
    "conductor_table",
    "dielectric_table",
    "eval_rough_conductor",
    "eval_rough_dielectric",
    "ggx_distribution",
    "ggx_masking",
    "multiple_reflectance",
    "pdf_rough_conductor",
    "pdf_rough_dielectric",
    "sample_ggx_normal",
    "sample_rough_conductor",
    "sample_rough_dielectric",
]

F64 = NDArray[np.float64]
Vector = tuple[float, float, float]

_NODES = 49  # nodes in the cosine of a loss table
_INDICES = 65  # nodes in the logarithm of n_i / n_o
_LOG_RANGE = 1.0  # the index ratio reaches from 1/e to e
_LOBE = 2 * _NODES + 2  # losses, cumulative distribution, mean loss, mean reflectance
SMALLEST_ROUGHNESS = 1e-3
"""Smoother surfaces are traced as smooth."""


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
    phi = 2.0 * math.pi * u1
    mx = alpha * (sine * math.cos(phi) + x)
    my = alpha * (sine * math.sin(phi) + y)
    mz = max(1e-12, height + z)
    scale = 1.0 / math.sqrt(mx * mx + my * my + mz * mz)
    return mx * scale, my * scale, mz * scale


@inner_kernel
def _sample_lobe(table: F64, first: int, u1: float, u2: float, sign: float) -> Vector:
    """A direction with density proportional to the losses of a table times the cosine."""
    # Find the interval of the cosine, then invert the cubic inside it
    cumulative = first + _NODES
    low, high = 0, _NODES - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[cumulative + middle] <= u1:
            low = middle
        else:
            high = middle
    step = 1.0 / (_NODES - 1)
    left = low * step
    a, b = table[first + low], (table[first + low + 1] - table[first + low]) / step
    part = table[cumulative + low + 1] - table[cumulative + low]
    share = (u1 - table[cumulative + low]) / part if part > 0.0 else 0.5
    whole = _lobe_integral(a, b, left, step)
    t = share * step
    lower, upper = 0.0, step
    for _ in range(20):
        miss = _lobe_integral(a, b, left, t) - share * whole
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
    phi = 2.0 * math.pi * u2
    return sine * math.cos(phi), sine * math.sin(phi), sign * cosine


@inner_kernel
def _lobe_integral(a: float, b: float, left: float, t: float) -> float:
    """Integral of (a + b s) (left + s) for s from 0 to t."""
    return a * left * t + 0.5 * (a + b * left) * t * t + b * t * t * t / 3.0


@inner_kernel
def _loss(table: F64, first: int, cosine: float) -> float:
    """Loss at a cosine, linear between nodes."""
    x = min(1.0, max(0.0, cosine)) * (_NODES - 1)
    low = min(_NODES - 2, int(x))
    return float(table[first + low] + (x - low) * (table[first + low + 1] - table[first + low]))


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
    x, y, z = _sample_lobe(table, first, u4, u5, 1.0)
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
    mean = table[first + 2 * _NODES]
    multiple = 0.0
    if mean > 0.0:
        multiple = _loss(table, first, wi_z) * _loss(table, first, wo_z) / (math.pi * mean)
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
        cos_t = math.sqrt(max(0.0, 1.0 - eta * eta * (1.0 - cos_m * cos_m)))
        along = eta * cos_m - cos_t
        x, y, z = along * mx - eta * wi_x, along * my - eta * wi_y, along * mz - eta * wi_z
        leaves = z < 0.0
    masking = ggx_masking(alpha, z) if leaves else 0.0
    if u3 < masking:
        return x, y, z, cos_m
    # Leave by the compensating lobe, on one of the sides
    u3 = (u3 - masking) / (1.0 - masking)
    x_index, weight = _index_node(n_i / n_o)
    back, _ = _compensation(table, first, n_i, n_o)
    sign = 1.0
    if u3 < back:
        u3 /= back
    else:
        u3 = (u3 - back) / (1.0 - back)
        sign = -1.0
        x_index, weight = _index_node(n_o / n_i)
    # The lobe is a mixture of those of two nodes of the index ratio
    low = first + x_index * _LOBE
    mean_low = (1.0 - weight) * table[low + 2 * _NODES]
    mean_high = weight * table[low + _LOBE + 2 * _NODES]
    if u3 * (mean_low + mean_high) >= mean_low:
        low += _LOBE
    x, y, z = _sample_lobe(table, low, u4, u5, sign)
    return x, y, z, -1.0


@inner_kernel
def _index_node(ratio: float) -> tuple[int, float]:
    """Node below an index ratio in the table, and the share of the node above."""
    x = (math.log(ratio) + _LOG_RANGE) * (0.5 * (_INDICES - 1) / _LOG_RANGE)
    x = min(_INDICES - 1.0, max(0.0, x))
    low = min(_INDICES - 2, int(x))
    return low, x - low


@inner_kernel
def _between(table: F64, first: int, ratio: float, entry: int) -> float:
    low, weight = _index_node(ratio)
    k = first + low * _LOBE + entry
    return float((1.0 - weight) * table[k] + weight * table[k + _LOBE])


@inner_kernel
def _side_loss(table: F64, first: int, ratio: float, cosine: float) -> float:
    low, weight = _index_node(ratio)
    k = first + low * _LOBE
    return (1.0 - weight) * _loss(table, k, cosine) + weight * _loss(table, k + _LOBE, cosine)


@inner_kernel
def _compensation(table: F64, first: int, n_i: float, n_o: float) -> tuple[float, float]:
    """Shares of the compensating light that are reflected and transmitted; reciprocal."""
    mean_i = n_i * n_i * _between(table, first, n_i / n_o, 2 * _NODES)
    mean_o = n_o * n_o * _between(table, first, n_o / n_i, 2 * _NODES)
    if mean_i <= 0.0 or mean_o <= 0.0:
        return 0.5, 0.5
    # What is transmitted per mean loss must be the same both ways
    through_i = 1.0 - _between(table, first, n_i / n_o, 2 * _NODES + 1)
    through_o = 1.0 - _between(table, first, n_o / n_i, 2 * _NODES + 1)
    transmitted = min(1.0, mean_o * min(through_i / mean_o, through_o / mean_i))
    return 1.0 - transmitted, transmitted


@lean_kernel
def eval_rough_dielectric(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float, n_i: float, n_o: float,
) -> float:  # fmt: skip
    """BSDF of a rough interface [1/sr], both sides, with the compensating lobe."""
    if wi_z <= 0.0 or wo_z == 0.0:
        return 0.0
    masking = ggx_masking(alpha, wi_z) * ggx_masking(alpha, wo_z)
    loss_i = _side_loss(table, first, n_i / n_o, wi_z)
    back, through = _compensation(table, first, n_i, n_o)
    if wo_z > 0.0:
        hx, hy, hz = wi_x + wo_x, wi_y + wo_y, wi_z + wo_z
        scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
        cos_m = min(1.0, (wi_x * hx + wi_y * hy + wi_z * hz) * scale)
        single = fresnel_reflectance(n_i, n_o, cos_m) * masking
        single *= ggx_distribution(alpha, hz * scale) / (4.0 * wi_z * wo_z)
        mean = _between(table, first, n_i / n_o, 2 * _NODES)
        if mean <= 0.0:
            return single
        loss_o = _side_loss(table, first, n_i / n_o, wo_z)
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
    mean = _between(table, first, n_o / n_i, 2 * _NODES)
    if mean <= 0.0:
        return single
    loss_o = _side_loss(table, first, n_o / n_i, -wo_z)
    return single + through * loss_i * loss_o / (math.pi * mean)


@lean_kernel
def pdf_rough_dielectric(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, alpha: float, n_i: float, n_o: float,
) -> float:  # fmt: skip
    """Density of `sample_rough_dielectric` per solid angle: eval · |wo_z|, as nothing is lost."""
    value = eval_rough_dielectric(table, first, wi_x, wi_y, wi_z, wo_x, wo_y, wo_z, alpha, n_i, n_o)
    return value * abs(wo_z)


@inner_kernel
def _loss_by_quadrature(alpha: float, cosine: float, ratio: float, steps: int) -> float:
    """Share of light whose first facet sends it into another; ratio 0 stands for a metal."""
    sine = math.sqrt(1.0 - cosine * cosine)
    kept = 0.0
    for i in range(steps):
        for j in range(steps):
            u1, u2 = (i + 0.5) / steps, (j + 0.5) / steps
            mx, _, mz = sample_ggx_normal(sine, 0.0, cosine, alpha, u1, u2)
            cos_m = min(1.0, sine * mx + cosine * mz)
            z = 2.0 * cos_m * mz - cosine
            reflectance = 1.0 if ratio == 0.0 else fresnel_reflectance(ratio, 1.0, cos_m)
            if z > 0.0:
                kept += reflectance * ggx_masking(alpha, z)
            if reflectance < 1.0:
                cos_t = math.sqrt(max(0.0, 1.0 - ratio * ratio * (1.0 - cos_m * cos_m)))
                z = (ratio * cos_m - cos_t) * mz - ratio * cosine
                if z < 0.0:
                    kept += (1.0 - reflectance) * ggx_masking(alpha, z)
    return max(0.0, 1.0 - kept / (steps * steps))


@lean_kernel
def _fill_lobe(table: F64, first: int, alpha: float, ratio: float, steps: int) -> None:
    """Losses over the cosine, their cumulative distribution and their mean."""
    step = 1.0 / (_NODES - 1)
    for k in range(_NODES):
        cosine = min(1.0, max(1e-4, k * step))
        table[first + k] = _loss_by_quadrature(alpha, cosine, ratio, steps)
    total = 0.0
    table[first + _NODES] = 0.0
    for k in range(_NODES - 1):
        slope = (table[first + k + 1] - table[first + k]) / step
        total += _lobe_integral(table[first + k], slope, k * step, step)
        table[first + _NODES + k + 1] = total
    table[first + 2 * _NODES] = 2.0 * total
    for k in range(_NODES):
        table[first + _NODES + k] = table[first + _NODES + k] / total if total > 0.0 else k * step
    table[first + 2 * _NODES - 1] = 1.0
    # Mean of the smooth interface's reflectance over a Lambertian source
    mean = 0.0
    for k in range(200):
        cosine = (k + 0.5) / 200
        mean += 2.0 * cosine * (fresnel_reflectance(ratio, 1.0, cosine) if ratio > 0.0 else 1.0)
    table[first + 2 * _NODES + 1] = mean / 200


def conductor_table(alpha: float) -> F64:
    """Table of a rough metal for the flat pool of tables."""
    _check_roughness(alpha)
    table = np.zeros(_LOBE)
    _fill_lobe(table, 0, alpha, 0.0, 64)
    return table


def dielectric_table(alpha: float) -> F64:
    """Table of a rough interface, for all index ratios from 1/e to e, for the flat pool."""
    _check_roughness(alpha)
    table = np.zeros(_INDICES * _LOBE)
    for node, ratio in enumerate(np.exp(np.linspace(-_LOG_RANGE, _LOG_RANGE, _INDICES))):
        _fill_lobe(table, node * _LOBE, alpha, float(ratio), 56)
    return table


def average_conductor_reflectance(n1: float, n2: float, kappa2: float) -> float:
    """Reflectance of a smooth metal averaged over a Lambertian source."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    cosine = 0.5 * (1.0 + nodes)
    values = [fresnel_conductor(n1, n2, kappa2, float(c)) for c in cosine]
    return float(np.sum(np.array(values) * 2.0 * cosine * 0.5 * weights))


def multiple_reflectance(average: float, table: F64) -> float:
    """Survival of light that meets several facets, from the metal's average reflectance.

    References
    ----------
    C. Kulla, A. Conty (2017): F̄² Ē / (1 - F̄ (1 - Ē)), Ē = 1 - mean loss.
    """
    kept = 1.0 - float(table[2 * _NODES])
    return average * average * kept / (1.0 - average * (1.0 - kept))


def _check_roughness(alpha: float) -> None:
    if not SMALLEST_ROUGHNESS <= alpha <= 1.0:
        raise SceneError(
            f"roughness must lie between {SMALLEST_ROUGHNESS:g} and 1, got {alpha:g}; "
            "use a smooth surface below"
        )
