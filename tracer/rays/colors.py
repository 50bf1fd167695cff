"""Colour codes of rays: one channel, or a row of a table of mixed colours.

A code below the number of channels says that all light is in that channel; other codes name a row
of ``colors``, whose first rows are the colours of the sources. What happens with a different
probability in each channel changes the mixture: the ray goes on with P = Σ c_i w_i, and its colour
becomes c_i w_i / P, so that the expectation of each channel is exact. What does not go on has the
colour of the rest, c_i (1 - w_i) / (1 - P): the light that is lost closes the sum of each channel.

Quantities per channel stand in a table, from column ``column`` of row ``row`` on. ``colors`` has
spare rows behind the ``counters[COLORS]`` in use: a step adds at most three per ray, and the row
after the next one may hold weights that were only just computed.
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inner_kernel, unsigned
from raymap.jit.types import F64, I64, Integer

__all__ = ["COLORS", "mean_of", "pick_channel", "recolor", "recolor_lost"]

COLORS = 3
"""Entry of ``counters`` that holds how many rows of ``colors`` are in use."""


@inner_kernel
def pick_channel(colors: F64, code: int, u: float) -> int:
    """A channel of the ray, with the probability of its share."""
    n_channels: int = colors.shape[1]
    if code < n_channels:
        return code
    row = code - n_channels
    total = 0.0
    for k in range(n_channels - 1):
        total += colors[row, k]
        if u < total:
            return k
    return n_channels - 1


@inner_kernel
def mean_of(colors: F64, code: int, table: F64, row: Integer, column: Integer) -> float:
    """Mean of a quantity over the light of the ray."""
    n_channels: int = colors.shape[1]
    if code < n_channels:
        return float(table[row, column + code])
    mixed = unsigned(code - n_channels)
    total = 0.0
    for k in range(n_channels):
        total += colors[mixed, k] * table[row, column + k]
    return total


@inner_kernel
def recolor(
    colors: F64, code: int, table: F64, row: Integer, column: Integer, counters: I64
) -> int:
    """Code of the colour c_i w_i / Σ c_i w_i; the same code where all w_i are equal."""
    n_channels: int = colors.shape[1]
    if code < n_channels:
        return code
    old = unsigned(code - n_channels)
    total = 0.0
    equal = True
    for k in range(n_channels):
        weight = table[row, column + k]
        total += colors[old, k] * weight
        equal &= weight == table[row, column]
    if equal or not total > 0.0:
        return code
    new = int(counters[COLORS])
    counters[COLORS] = new + 1
    for k in range(n_channels):
        colors[new, k] = colors[old, k] * table[row, column + k] / total
    return n_channels + new


@inner_kernel
def recolor_lost(
    colors: F64, code: int, table: F64, row: Integer, column: Integer, counters: I64
) -> int:
    """Code of the colour c_i (1 - w_i) / Σ c_i (1 - w_i) of light that does not go on."""
    n_channels: int = colors.shape[1]
    if code < n_channels:
        return code
    spare = counters[COLORS] + 1
    for k in range(n_channels):
        colors[spare, k] = max(0.0, 1.0 - table[row, column + k])
    return recolor(colors, code, colors, spare, np.int64(0), counters)
