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

from typing import NamedTuple

import numpy as np

from raymap.jit.kernels import inner_kernel, number
from raymap.jit.types import F64
from raymap.model.events import Event
from tracer.compiled import R_AIM, R_FAINT, VarianceReduction
from tracer.optics.phase import pdf_phase
from tracer.rays.random import advance, uniform
from tracer.transport.weighted.aiming import Start, aim_at, count_targets, pdf_aim

__all__ = [
    "Aim",
    "Flight",
    "aim_or_keep",
    "aim_scattered",
    "balance",
    "likely_enough",
    "roulette",
]

_RIM_HIT = int(Event.RIM_HIT)
_KILL = int(Event.ROULETTE_KILL)
_ENDING = int(
    Event.SURFACE_ABSORPTION
    | Event.VOLUME_ABSORPTION
    | Event.LEFT_SCENE
    | Event.DEPTH_LIMIT
    | Event.GEOMETRY_ERROR
)


class Aim(NamedTuple):
    """How light is aimed from a place: the probability, 0 where there is no target, and from how
    many candidates."""

    q: float
    candidates: int


class Flight(NamedTuple):
    """Where a medium has scattered light, the unit direction u in which it came, and d in which it
    goes on."""

    x: float
    y: float
    z: float
    ux: float
    uy: float
    uz: float
    dx: float
    dy: float
    dz: float


@inner_kernel
def likely_enough(share: float, least: float) -> float:
    """Probability of an outcome that light has with ``share``: at least ``least``, 0 stays 0."""
    if share <= 0.0:
        return 0.0
    return share if share >= 1.0 else max(share, least)


@inner_kernel
def aim_or_keep(
    reduction: VarianceReduction, start: Start, dx: float, dy: float, dz: float, weight: float,
    state: np.uint64,
) -> tuple[float, float, float, Aim, np.uint64]:  # fmt: skip
    """Keep the direction drawn from a law, or take an aimed one."""
    q = reduction.settings[R_AIM] / max(1.0, weight)
    count = count_targets(reduction.targets, start) if q > 0.0 else 0
    if count == 0:
        return dx, dy, dz, Aim(0.0, number(0)), state
    state = advance(state)
    if uniform(state) < q:
        a = advance(state)
        b = advance(a)
        state = advance(b)
        dx, dy, dz = aim_at(reduction.targets, start, count, uniform(a), uniform(b), uniform(state))
    return dx, dy, dz, Aim(q, count), state


@inner_kernel
def balance(
    reduction: VarianceReduction, start: Start, aim: Aim, dx: float, dy: float, dz: float,
    density: float,
) -> float:  # fmt: skip
    """Factor of the weight: the law's density over that of the mixture."""
    if aim.candidates == 0:
        return 1.0
    if density <= 0.0:
        return 0.0
    aimed = pdf_aim(reduction.targets, start, aim.candidates, dx, dy, dz)
    return density / (aim.q * aimed + (1.0 - aim.q) * density)


@inner_kernel
def aim_scattered(
    reduction: VarianceReduction, flight: Flight, phase: F64, tables: F64, weight: float,
    state: np.uint64,
) -> tuple[float, float, float, float, np.uint64]:  # fmt: skip
    """Aim light that a medium has scattered: direction, weight, state."""
    start = Start(flight.x, flight.y, flight.z, 0.0, 0.0, 1.0, False)
    dx, dy, dz, aim, state = aim_or_keep(
        reduction, start, flight.dx, flight.dy, flight.dz, weight, state
    )
    if aim.candidates > 0:
        mu = max(-1.0, min(1.0, flight.ux * dx + flight.uy * dy + flight.uz * dz))
        density = pdf_phase(phase, tables, mu)
        weight *= balance(reduction, start, aim, dx, dy, dz, density)
    return dx, dy, dz, weight, state


@inner_kernel
def roulette(
    reduction: VarianceReduction, event: int, weight: float, state: np.uint64
) -> tuple[int, float, np.uint64]:
    faint = reduction.settings[R_FAINT]
    if event & _ENDING != 0 or (weight > 0.0 and weight >= faint):
        return event, weight, state
    state = advance(state)
    if uniform(state) * faint < weight:
        return event, faint, state
    return (event & _RIM_HIT) | _KILL, 0.0, state
