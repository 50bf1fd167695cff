"""Light whose first facet sends it into another one: how much, tabulated, and where it leaves.

Over the cosine of the light a table holds its loss, the cumulative distribution of the compensating
lobe, the mean loss, and the mean reflectance of the smooth interface; for dielectrics one such lobe
per index ratio.

References
----------
C. Kulla, A. Conty, Revisiting physically based shading at Imageworks, SIGGRAPH courses (2017).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.model.errors import SceneError
from raymap.optics.fresnel import fresnel_conductor, fresnel_reflectance
from raymap.optics.ggx import ggx_masking, sample_ggx_normal

__all__ = [
    "LOBE",
    "NODES",
    "SMALLEST_ROUGHNESS",
    "average_conductor_reflectance",
    "between",
    "compensation",
    "conductor_table",
    "dielectric_table",
    "index_node",
    "lobe_integral",
    "loss",
    "multiple_reflectance",
    "side_loss",
]

F64 = NDArray[np.float64]

NODES = 49  # nodes in the cosine of a loss table
_INDICES = 65  # nodes in the logarithm of n_i / n_o
_LOG_RANGE = 1.0  # the index ratio reaches from 1/e to e
LOBE = 2 * NODES + 2  # losses, cumulative distribution, mean loss, mean reflectance
SMALLEST_ROUGHNESS = 1e-3
"""Smoother surfaces are traced as smooth."""


@inner_kernel
def lobe_integral(a: float, b: float, left: float, t: float) -> float:
    """Integral of (a + b s) (left + s) for s from 0 to t."""
    return a * left * t + 0.5 * (a + b * left) * t * t + b * t * t * t / 3.0


@inner_kernel
def loss(table: F64, first: int, cosine: float) -> float:
    """Loss at a cosine, linear between nodes."""
    x = min(1.0, max(0.0, cosine)) * (NODES - 1)
    low = min(NODES - 2, int(x))
    return float(table[first + low] + (x - low) * (table[first + low + 1] - table[first + low]))


@inner_kernel
def index_node(ratio: float) -> tuple[int, float]:
    """Node below an index ratio in the table, and the share of the node above."""
    x = (math.log(ratio) + _LOG_RANGE) * (0.5 * (_INDICES - 1) / _LOG_RANGE)
    x = min(_INDICES - 1.0, max(0.0, x))
    low = min(_INDICES - 2, int(x))
    return low, x - low


@inner_kernel
def between(table: F64, first: int, ratio: float, entry: int) -> float:
    """A tabulated value between the nodes of the index ratio."""
    low, weight = index_node(ratio)
    k = first + low * LOBE + entry
    return float((1.0 - weight) * table[k] + weight * table[k + LOBE])


@inner_kernel
def side_loss(table: F64, first: int, ratio: float, cosine: float) -> float:
    """Loss at an index ratio and a cosine."""
    low, weight = index_node(ratio)
    k = first + low * LOBE
    return (1.0 - weight) * loss(table, k, cosine) + weight * loss(table, k + LOBE, cosine)


@inner_kernel
def compensation(table: F64, first: int, n_i: float, n_o: float) -> tuple[float, float]:
    """Shares of the compensating light that are reflected and transmitted; reciprocal."""
    mean_i = n_i * n_i * between(table, first, n_i / n_o, 2 * NODES)
    mean_o = n_o * n_o * between(table, first, n_o / n_i, 2 * NODES)
    if mean_i <= 0.0 or mean_o <= 0.0:
        return 0.5, 0.5
    # What is transmitted per mean loss must be the same both ways
    through_i = 1.0 - between(table, first, n_i / n_o, 2 * NODES + 1)
    through_o = 1.0 - between(table, first, n_o / n_i, 2 * NODES + 1)
    transmitted = min(1.0, mean_o * min(through_i / mean_o, through_o / mean_i))
    return 1.0 - transmitted, transmitted


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
    step = 1.0 / (NODES - 1)
    for k in range(NODES):
        cosine = min(1.0, max(1e-4, k * step))
        table[first + k] = _loss_by_quadrature(alpha, cosine, ratio, steps)
    total = 0.0
    table[first + NODES] = 0.0
    for k in range(NODES - 1):
        slope = (table[first + k + 1] - table[first + k]) / step
        total += lobe_integral(table[first + k], slope, k * step, step)
        table[first + NODES + k + 1] = total
    table[first + 2 * NODES] = 2.0 * total
    for k in range(NODES):
        table[first + NODES + k] = table[first + NODES + k] / total if total > 0.0 else k * step
    table[first + 2 * NODES - 1] = 1.0
    # Mean of the smooth interface's reflectance over a Lambertian source
    mean = 0.0
    for k in range(200):
        cosine = (k + 0.5) / 200
        mean += 2.0 * cosine * (fresnel_reflectance(ratio, 1.0, cosine) if ratio > 0.0 else 1.0)
    table[first + 2 * NODES + 1] = mean / 200


def conductor_table(alpha: float) -> F64:
    """Table of a rough metal for the flat pool of tables."""
    _check_roughness(alpha)
    table = np.zeros(LOBE)
    _fill_lobe(table, 0, alpha, 0.0, 64)
    return table


def dielectric_table(alpha: float) -> F64:
    """Table of a rough interface, for all index ratios from 1/e to e, for the flat pool."""
    _check_roughness(alpha)
    table = np.zeros(_INDICES * LOBE)
    for node, ratio in enumerate(np.exp(np.linspace(-_LOG_RANGE, _LOG_RANGE, _INDICES))):
        _fill_lobe(table, node * LOBE, alpha, float(ratio), 56)
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
    kept = 1.0 - float(table[2 * NODES])
    return average * average * kept / (1.0 - average * (1.0 - kept))


def _check_roughness(alpha: float) -> None:
    if not SMALLEST_ROUGHNESS <= alpha <= 1.0:
        raise SceneError(
            f"roughness must lie between {SMALLEST_ROUGHNESS:g} and 1, got {alpha:g}; "
            "use a smooth surface below"
        )
