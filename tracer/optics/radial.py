"""Draws directions from scattering of polished surfaces (`raymap.laws.radial`)."""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.types import F64
from raymap.laws.radial import RADIAL_HEAD, RADIAL_NODES, eval_radial, scatter_share
from raymap.optics.angles import turned

__all__ = ["pdf_radial", "sample_radial"]


@inner_kernel
def _sample_rho(table: F64, first: int, u: float) -> float:
    """Distance from the specular ray with density proportional to f(rho) rho, up to rho = 2."""
    cumulative = first + RADIAL_HEAD + RADIAL_NODES
    low, high = 0, RADIAL_NODES - 1
    if u < table[cumulative]:
        return float(table[first] * math.sqrt(u / table[cumulative]))
    while high - low > 1:
        middle = (low + high) // 2
        if table[cumulative + middle] <= u:
            low = middle
        else:
            high = middle
    part = table[cumulative + low + 1] - table[cumulative + low]
    share = (u - table[cumulative + low]) / part if part > 0.0 else 0.5
    # Invert the power law rho^(k + 1) of the interval, k the slope of f in the logarithms
    step = table[first + 1]
    left = table[first] * math.exp(low * step)
    fall = math.log(table[first + RADIAL_HEAD + low + 1] / table[first + RADIAL_HEAD + low]) / step
    growth = (fall + 2.0) * step
    if abs(growth) < 1e-9:
        return float(left * math.exp(share * step))
    return float(left * math.exp(math.log1p(share * math.expm1(growth)) / (fall + 2.0)))


@lean_kernel
def sample_radial(
    table: F64, first: int, beta_x: float, beta_y: float, u1: float, u2: float
) -> tuple[float, float, float]:
    """A scattered direction around the specular one.

    Parameters
    ----------
    table, first : flat pool and where the table of `radial_table` stands in it
    beta_x, beta_y : projection of the specular direction on the surface
    u1, u2 : uniform numbers; if the draw falls beyond the horizon, further ones are derived

    Returns
    -------
    x, y, z : unit direction, z >= 0 on the side of the specular ray; the density of (x, y) is
        f / TIS over the unit disc: per solid angle f z / TIS
    """
    a, b = u1, u2
    for _ in range(64):
        rho = _sample_rho(table, first, a)
        cosine, sine = turned(b)
        x, y = beta_x + rho * cosine, beta_y + rho * sine
        square = x * x + y * y
        if square < 1.0:
            return x, y, math.sqrt(1.0 - square)
        # Draw again: stretch the low digits of both numbers
        a, b = _again(a, b), _again(b, a + 0.5)
    return beta_x, beta_y, math.sqrt(max(0.0, 1.0 - beta_x * beta_x - beta_y * beta_y))


@inner_kernel
def _again(a: float, b: float) -> float:
    """A further uniform number from two, by SplitMix64's mixing of their digits."""
    word = np.uint64(a * 9007199254740992.0) * np.uint64(0x9E3779B97F4A7C15)
    word ^= np.uint64((b - math.floor(b)) * 9007199254740992.0)
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    word ^= word >> np.uint64(31)
    return (word >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@lean_kernel
def pdf_radial(
    table: F64, first: int, beta_x: float, beta_y: float, x: float, y: float, z: float
) -> float:
    """Density of `sample_radial` per solid angle of the direction (x, y, z), z > 0."""
    if z <= 0.0:
        return 0.0
    share = scatter_share(table, first, math.hypot(beta_x, beta_y))
    if share <= 0.0:
        return 0.0
    return eval_radial(table, first, math.hypot(x - beta_x, y - beta_y)) * z / share
