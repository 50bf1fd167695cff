"""What all surfaces share in the weighted mode: aiming, least probabilities, thinning out.

Scattered light is aimed with a probability q: its direction comes from the mixture
q p_aim + (1 - q) f of the density of aiming and the law's own density f, and its factor is f over
that mixture, at most 1 / (1 - q) (the balance heuristic). For a ray of weight w, q is
``settings[R_AIM]`` / max(1, w): the weight of light that is never aimed then grows in proportion to
the number of its scatterings. With the same q everywhere it would double at each of them, and the
few rays of huge weight that carry the light of a white cavity would not be found.

References
----------
E. Veach, L. J. Guibas, Optimally combining sampling techniques for Monte Carlo rendering, SIGGRAPH
1995.
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64
from raymap.model.events import Event
from tracer.compiled import R_AIM, R_FAINT, RareLight
from tracer.optics.phase import pdf_phase
from tracer.rays.random import advance, uniform
from tracer.transport.aiming import aim_at, count_targets, pdf_aim

__all__ = ["aim_or_keep", "aim_scattered", "balance", "likely_enough", "thin_out"]

Directed = tuple[float, float, float, float, np.uint64]

_RIM_HIT = int(Event.RIM_HIT)
_KILL = int(Event.ROULETTE_KILL)
_ENDING = int(
    Event.SURFACE_ABSORPTION
    | Event.VOLUME_ABSORPTION
    | Event.LEFT_SCENE
    | Event.DEPTH_LIMIT
    | Event.GEOMETRY_ERROR
)


@inner_kernel
def likely_enough(share: float, least: float) -> float:
    """Probability of an outcome that light has with ``share``: at least ``least``, 0 stays 0."""
    if share <= 0.0:
        return 0.0
    return share if share >= 1.0 else max(share, least)


@inner_kernel
def aim_or_keep(
    rare: RareLight, x: float, y: float, z: float, nx: float, ny: float, nz: float, horizon: bool,
    dx: float, dy: float, dz: float, weight: float, state: np.uint64,
) -> tuple[float, float, float, float, int, np.uint64]:  # fmt: skip
    """Keep the direction drawn from a law, or take an aimed one.

    Returns
    -------
    d : the direction
    q : probability with which light is aimed from here, 0 where there is no target
    count : candidates
    """
    q = rare.settings[R_AIM] / max(1.0, weight)
    count = count_targets(rare.targets, x, y, z, nx, ny, nz, horizon) if q > 0.0 else 0
    if count == 0:
        return dx, dy, dz, 0.0, 0, state
    state = advance(state)
    if uniform(state) < q:
        a = advance(state)
        b = advance(a)
        state = advance(b)
        dx, dy, dz = aim_at(
            rare.targets, x, y, z, nx, ny, nz, horizon, count, uniform(a), uniform(b),
            uniform(state),
        )  # fmt: skip
    return dx, dy, dz, q, count, state


@inner_kernel
def balance(
    rare: RareLight, x: float, y: float, z: float, nx: float, ny: float, nz: float, horizon: bool,
    dx: float, dy: float, dz: float, q: float, count: int, density: float,
) -> float:  # fmt: skip
    """Factor of the weight: the law's density over that of the mixture."""
    if count == 0:
        return 1.0
    if density <= 0.0:
        return 0.0
    aimed = pdf_aim(rare.targets, x, y, z, nx, ny, nz, horizon, count, dx, dy, dz)
    return density / (q * aimed + (1.0 - q) * density)


@inner_kernel
def aim_scattered(
    rare: RareLight, x: float, y: float, z: float, ux: float, uy: float, uz: float, dx: float,
    dy: float, dz: float, weight: float, medium_f: F64, tables: F64, medium: int, n_channels: int,
    state: np.uint64,
) -> Directed:  # fmt: skip
    dx, dy, dz, q, count, state = aim_or_keep(
        rare, x, y, z, 0.0, 0.0, 1.0, False, dx, dy, dz, weight, state
    )
    if count > 0:
        mu = max(-1.0, min(1.0, ux * dx + uy * dy + uz * dz))
        density = pdf_phase(medium_f[medium, 3 * n_channels :], tables, mu)
        weight *= balance(rare, x, y, z, 0.0, 0.0, 1.0, False, dx, dy, dz, q, count, density)
    return dx, dy, dz, weight, state


@inner_kernel
def thin_out(
    rare: RareLight, event: int, weight: float, state: np.uint64
) -> tuple[int, float, np.uint64]:
    faint = rare.settings[R_FAINT]
    if event & _ENDING != 0 or (weight > 0.0 and weight >= faint):
        return event, weight, state
    state = advance(state)
    if uniform(state) * faint < weight:
        return event, faint, state
    return (event & _RIM_HIT) | _KILL, 0.0, state
