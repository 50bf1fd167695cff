"""Draws the cosine of the angle of scattering from phase functions (`raymap.laws.phase`).

``sample_*`` takes a uniform number and returns ``mu``, rising with it; because the samplers are
exact, the weight of a sample is 1 and ``pdf_phase`` equals `raymap.laws.phase.eval_phase`.

References
----------
J. R. Frisvad, J. Opt. Soc. Am. A 28, 2436 (2011), for the Rayleigh sampler.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from raymap.laws.phase import (
    GENERALIZED,
    HENYEY_GREENSTEIN,
    RAYLEIGH,
    TABULATED,
    eval_phase,
    interval,
)

__all__ = [
    "pdf_phase",
    "sample_generalized",
    "sample_henyey_greenstein",
    "sample_phase",
    "sample_rayleigh",
    "sample_tabulated_phase",
]


@lean_kernel
def sample_henyey_greenstein(g: float, u: float) -> float:
    """Cosine drawn from Henyey–Greenstein; without a division by g, so that g -> 0 is exact."""
    s = 2.0 * u - 1.0
    top = s + 0.5 * g * (s * s + 3.0) + g * g * s + 0.5 * g * g * g * (s * s - 1.0)
    bottom = 1.0 + g * s
    return min(1.0, max(-1.0, top / (bottom * bottom)))


@lean_kernel
def sample_generalized(g: float, gamma: float, u: float) -> float:
    """Cosine drawn from `eval_generalized` by the closed inverse of its distribution."""
    if abs(g) < 1e-100:
        return 2.0 * u - 1.0
    # Turn backward peaks forward
    backward = g < 0.0
    if backward:
        g = -g
        u = 1.0 - u
    # Invert the distribution of log(1 + g² - 2 g mu)
    a = gamma - 1.0
    spread = 4.0 * math.atanh(g)
    x = a * spread
    if abs(x) < 1e-14:
        t = -u * spread
    elif x > 1.0:
        t = -(x + math.log(u + (1.0 - u) * math.exp(-x))) / a
    else:
        t = -math.log1p(u * math.expm1(x)) / a
    mu = -1.0 - (1.0 + g) * (1.0 + g) * math.expm1(t) / (2.0 * g)
    mu = min(1.0, max(-1.0, mu))
    return -mu if backward else mu


@lean_kernel
def sample_rayleigh(u: float) -> float:
    """Cosine drawn from `eval_rayleigh`: the real root of mu³ + 3 mu = 8 u - 4."""
    c = 4.0 * u - 2.0
    root = np.cbrt(abs(c) + math.sqrt(1.0 + c * c))
    return min(1.0, max(-1.0, math.copysign(root - 1.0 / root, c)))


@lean_kernel
def sample_tabulated_phase(tables: NDArray[np.float64], first: int, count: int, u: float) -> float:
    """Cosine drawn from `eval_tabulated_phase`."""
    # Find the interval, then invert the quadratic inside it
    low = interval(tables, first + 2 * count, count, u)
    c_0, c_1 = tables[first + 2 * count + low], tables[first + 2 * count + low + 1]
    mu_0, mu_1 = tables[first + low], tables[first + low + 1]
    p_0, p_1 = tables[first + count + low], tables[first + count + low + 1]
    if c_1 <= c_0:
        return float(mu_0)
    v = min(1.0, max(0.0, (u - c_0) / (c_1 - c_0)))
    root = math.sqrt(p_0 * p_0 + v * (p_1 * p_1 - p_0 * p_0))
    share = v * (p_0 + p_1) / (p_0 + root) if p_0 + root > 0.0 else v
    return float(mu_0 + (mu_1 - mu_0) * min(1.0, max(0.0, share)))


@lean_kernel
def sample_phase(row: NDArray[np.float64], tables: NDArray[np.float64], u: float) -> float:
    """Cosine of the scattering angle drawn from the phase function of a parameter row."""
    kind = int(row[0])
    if kind == HENYEY_GREENSTEIN:
        return sample_henyey_greenstein(row[1], u)
    if kind == GENERALIZED:
        return sample_generalized(row[1], row[2], u)
    if kind == RAYLEIGH:
        return sample_rayleigh(u)
    if kind == TABULATED:
        return sample_tabulated_phase(tables, int(row[3]), int(row[4]), u)
    return 2.0 * u - 1.0


@lean_kernel
def pdf_phase(row: NDArray[np.float64], tables: NDArray[np.float64], mu: float) -> float:
    """Density per solid angle of `sample_phase` with a uniform azimuth: `eval_phase` itself."""
    return eval_phase(row, tables, mu)
