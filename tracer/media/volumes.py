"""Free flight through a medium that absorbs or scatters."""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from tracer.compiled import M_PARTICIPATING
from tracer.optics.phase import sample_phase
from tracer.rays.colors import COLORS, mean_of, pick_channel, recolor, recolor_lost
from tracer.rays.directions import about, sine_of
from tracer.rays.random import advance, uniform

__all__ = ["fly_freely", "passes_surely"]

_SCATTER = int(Event.VOLUME_SCATTER)
_ABSORPTION = int(Event.VOLUME_ABSORPTION)


@inline_kernel
def passes_surely(
    participating: int, medium_f: F64, medium: int, t: float, code: int, n_channels: int,
    state: np.uint64,
) -> bool:  # fmt: skip
    """Whether the next number alone says that the ray flies farther than ``t``, as most do.

    A flight of -log(1 - u) / s is no shorter than u / s. True says what `fly_freely` would do: draw
    that number and let the ray through.
    """
    if participating == 2 and code >= n_channels:
        return False
    k = code if code < n_channels else 0
    extinction = medium_f[medium, n_channels + k] + medium_f[medium, 2 * n_channels + k]
    surely = uniform(advance(state)) > 1.000000001 * t * extinction
    return bool(surely and extinction > 0.0)


@inner_kernel
def fly_freely(
    medium_i: I64, medium_f: F64, tables: F64 | None, medium: int, t: float, dx: float,
    dy: float, dz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> tuple[int, float, float, float, float, int, np.uint64]:  # fmt: skip
    """Fly at most ``t`` through ``medium``.

    The distance to the next event is drawn from the mixture Σ c_i s_i exp(-s_i t) of the channels'
    densities (s: extinction). Where the channels differ, the colour follows: c_i s_i exp(-s_i t) at
    an event, c_i exp(-s_i t) where the ray gets through.

    Returns
    -------
    event, t, dx, dy, dz, code, state : event 0 where the ray gets through
    """
    if tables is None:
        return 0, t, dx, dy, dz, code, state
    n_channels = colors.shape[1]
    mixed = code >= n_channels and medium_i[medium, M_PARTICIPATING] == 2
    k = 0
    if code < n_channels:
        k = code
    elif mixed:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
    extinction = medium_f[medium, n_channels + k] + medium_f[medium, 2 * n_channels + k]
    if extinction <= 0.0 and not mixed:
        return 0, t, dx, dy, dz, code, state
    state = advance(state)
    flight = -math.log(1.0 - uniform(state)) / extinction if extinction > 0.0 else math.inf
    through = flight >= t
    distance = t if through else flight
    if mixed and distance < math.inf:
        spare = counters[COLORS] + 1
        for i in range(n_channels):
            s = medium_f[medium, n_channels + i] + medium_f[medium, 2 * n_channels + i]
            colors[spare, i] = math.exp(-s * distance) * (1.0 if through else s)
        code = recolor(colors, code, colors, spare, np.int64(0), counters)
    if through:
        return 0, t, dx, dy, dz, code, state
    # Choose between absorption and scattering
    state = advance(state)
    u = uniform(state)
    if mixed:
        spare = counters[COLORS] + 1
        for i in range(n_channels):
            s = medium_f[medium, n_channels + i] + medium_f[medium, 2 * n_channels + i]
            colors[spare, i] = medium_f[medium, 2 * n_channels + i] / s if s > 0.0 else 0.0
        if u >= mean_of(colors, code, colors, spare, np.int64(0)):
            code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
            return _ABSORPTION, distance, dx, dy, dz, code, state
        code = recolor(colors, code, colors, spare, np.int64(0), counters)
    elif u * extinction >= medium_f[medium, 2 * n_channels + k]:
        return _ABSORPTION, distance, dx, dy, dz, code, state
    state = advance(state)
    mu = sample_phase(medium_f[medium, 3 * n_channels :], tables, uniform(state))
    state = advance(state)
    dx, dy, dz = about(dx, dy, dz, mu, sine_of(mu), uniform(state))
    return _SCATTER, distance, dx, dy, dz, code, state
