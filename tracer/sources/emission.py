"""Emission: where rays start and whither they go.

Ray numbers are dealt to sources by a repeating pattern in proportion to their flux, so that every
run of numbers holds nearly the right share of each. What a ray draws depends on the seed and on its
number alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from raymap.jit.types import F64, I64
from raymap.optics.angles import turned
from tracer.compiled import (
    COLLIMATED,
    FROM_POINT,
    FROM_RECTANGLE,
    L_AREA,
    L_DIRECTIONS,
    LAMBERTIAN_CONE,
)
from tracer.rays.directions import about, sample_cosine_cone, sample_uniform_cone, sine_of
from tracer.rays.random import advance, stream_state, uniform

__all__ = ["PATTERN", "deal_rays", "emit_ray", "emitted_counts", "place_on_area"]

PATTERN = 4096
"""Length of the pattern that deals ray numbers to sources."""


def deal_rays(shares: NDArray[np.float64]) -> NDArray[np.int64]:
    """Pattern in which sources of given shares (0: switched off) take turns.

    Every source that is on gets a turn; otherwise turns follow the shares to 1 in `PATTERN`, spread
    evenly.
    """
    active = shares > 0.0
    length = PATTERN
    while length < 4 * active.sum():
        length *= 2
    exact = shares / shares.sum() * length
    turns = np.where(active, np.maximum(1, np.floor(exact)), 0).astype(np.int64)
    # Give what rounding left over to the largest remainders
    while turns.sum() < length:
        turns[np.argmax(np.where(active, exact - turns, -np.inf))] += 1
    while turns.sum() > length:
        turns[np.argmax(np.where(turns > 1, turns - exact, -np.inf))] -= 1
    owners = np.repeat(np.arange(len(shares)), turns)
    places = np.concatenate([(np.arange(k) + 0.5) / k for k in turns if k])
    return owners[np.argsort(places, kind="stable")].astype(np.int64)


def emitted_counts(
    pattern: NDArray[np.int64], n_sources: int, first: int, n: int
) -> NDArray[np.int64]:
    """How many of the rays ``first`` to ``first + n`` each source emits, (n_sources,)."""
    whole, rest = divmod(n, len(pattern))
    counts = np.bincount(pattern, minlength=n_sources) * whole
    places = (first + np.arange(rest)) % len(pattern)
    return np.asarray(counts + np.bincount(pattern[places], minlength=n_sources), np.int64)


@lean_kernel
def emit_ray(
    source_i: I64, source_f: F64, pattern: I64, seed: int, ray_id: int
) -> tuple[int, float, float, float, float, float, float, np.uint64]:
    """Source, origin, direction and random state of a ray."""
    source = pattern[ray_id % len(pattern)]
    state = stream_state(seed, ray_id)
    area = source_i[source, L_AREA]
    x, y, z = source_f[source, 0], source_f[source, 1], source_f[source, 2]
    if area != FROM_POINT:
        state = advance(state)
        u1 = uniform(state)
        state = advance(state)
        u2 = uniform(state)
        a, b = place_on_area(area, source_f[source, 12], source_f[source, 13], u1, u2)
        x += a * source_f[source, 6] + b * source_f[source, 9]
        y += a * source_f[source, 7] + b * source_f[source, 10]
        z += a * source_f[source, 8] + b * source_f[source, 11]
    kind = source_i[source, L_DIRECTIONS]
    if kind == COLLIMATED:
        return source, x, y, z, source_f[source, 15], source_f[source, 16], source_f[source, 17], state  # fmt: skip # noqa: E501
    state = advance(state)
    u1 = uniform(state)
    state = advance(state)
    u2 = uniform(state)
    cos_max = source_f[source, 14]
    if kind == LAMBERTIAN_CONE:
        cosine = sample_cosine_cone(u1, cos_max)
    else:
        cosine = sample_uniform_cone(u1, cos_max)
    dx, dy, dz = about(
        source_f[source, 3], source_f[source, 4], source_f[source, 5], cosine, sine_of(cosine), u2
    )
    return source, x, y, z, dx, dy, dz, state


@lean_kernel
def place_on_area(area: int, a: float, b: float, u1: float, u2: float) -> tuple[float, float]:
    """Place on the emitting area, uniform: coordinates along u and v.

    A rectangle has the half sizes a and b, a disc or ring the radii a (inner) and b.
    """
    if area == FROM_RECTANGLE:
        return (2.0 * u1 - 1.0) * a, (2.0 * u2 - 1.0) * b
    radius = math.sqrt(a * a + u1 * (b * b - a * a))
    cosine, sine = turned(u2)
    return radius * cosine, radius * sine
