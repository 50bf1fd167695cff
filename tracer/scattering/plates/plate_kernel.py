"""The compiled random walk of light in one plate: free flights, scatterings, two faces.

Depth z runs from 0 at the front face, which the beam meets, to the thickness at the back. The walk
keeps the depth, the direction and the path length only. Two estimators share it: the *analog* ray
lives or dies as light does, the *weighted* ray leaves its transmitted share at every smooth face
and carries absorption as a weight. Ray number and seed alone determine the random numbers, so that
two media are compared on the same ones.

References
----------
L. Wang, S. L. Jacques, L. Zheng, Computer Methods and Programs in Biomedicine 47, 131 (1995).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from raymap.optics.frames import unit_factor
from raymap.optics.fresnel import fresnel_reflectance
from tracer.optics.phase import sample_generalized, sample_henyey_greenstein
from tracer.rays.random import advance, stream_state, uniform
from tracer.scattering.plates.tilt_kernel import rough_face

__all__ = ["TOTALS", "PlateProblem", "trace_plate"]

TOTALS = 6
"""Totals of `trace_plate`: sums over rays of R, R², T, T², absorbed flux, and scatterings."""

_GREENSTEIN, _POWER, _EXPONENTIAL, _OTHER = 0, 1, 2, 3
_ROULETTE_BELOW = 1e-3
_SURVIVAL = 0.1
_HALF_WORD = 67108864.0  # 2**26


class PlateProblem(NamedTuple):
    """One plate, one beam.

    ``front_tilt`` and ``back_tilt`` are slope tables of `tracer.scattering.plates.tilt`, of
    length 0 for smooth faces; ``cosine_edges`` (n_theta + 1,) fall from 1 to 0, the bins of the
    polar angle outside; with ``n_phi`` = 1 the walk forgets azimuths and runs faster.
    """

    mean_free_path: float
    absorption: float
    g: float
    gamma: float
    refractive_index: float
    thickness: float
    cos_incidence: float
    front_tilt: NDArray[np.float64]
    back_tilt: NDArray[np.float64]
    cosine_edges: NDArray[np.float64]
    n_phi: int


class PreparedPhase(NamedTuple):
    """Constants of the inverse distribution of one phase function."""

    kind: int
    g: float
    gamma: float
    sign: float
    drop: float
    exponent: float
    top: float


@kernel
def prepare_phase(g: float, gamma: float) -> PreparedPhase:
    """Choose the cheapest exact sampler of A / (1 + g² - 2 g mu)^gamma."""
    a = gamma - 1.0
    shape = abs(g)
    sign = -1.0 if g < 0.0 else 1.0
    if gamma == 1.5:
        return PreparedPhase(_GREENSTEIN, g, gamma, 1.0, 0.0, 0.0, 0.0)
    if shape < 0.02 or 0.0 < abs(a) < 1e-6:
        return PreparedPhase(_OTHER, g, gamma, 1.0, 0.0, 0.0, 0.0)
    spread = 4.0 * math.atanh(shape)
    if a == 0.0:
        return PreparedPhase(_EXPONENTIAL, shape, gamma, sign, 0.0, -spread, (1.0 + shape) ** 2)
    top = (1.0 - shape) ** 2 if a > 0.0 else (1.0 + shape) ** 2
    return PreparedPhase(_POWER, shape, gamma, sign, math.exp(-abs(a) * spread), -1.0 / a, top)


@kernel
def sample_prepared(phase: PreparedPhase, u: float) -> float:
    """Cosine of the scattering angle."""
    if phase.kind == _GREENSTEIN:
        return sample_henyey_greenstein(phase.g, u)
    if phase.kind == _OTHER:
        return sample_generalized(phase.g, phase.gamma, u)
    g = phase.g
    if phase.kind == _POWER:
        rest = 1.0 - u
        share = rest if phase.gamma > 1.0 else u
        q = (1.0 - share) + share * phase.drop
        w = phase.top * math.exp(phase.exponent * math.log(q))
    else:
        w = phase.top * math.exp(phase.exponent * u)
    mu = (1.0 + g * g - w) / (2.0 * g)
    return phase.sign * min(1.0, max(-1.0, mu))


@kernel
def _azimuth(state: np.uint64) -> tuple[float, float, np.uint64]:
    """Cosine and sine of a uniform azimuth: the double angle of a point of the disc."""
    while True:
        state = advance(state)
        word = uniform(state) * _HALF_WORD
        whole = math.floor(word)
        v = whole * (2.0 / _HALF_WORD) - 1.0
        w = 2.0 * (word - whole) - 1.0
        norm = v * v + w * w
        if 0.0 < norm <= 1.0:
            return (v * v - w * w) / norm, 2.0 * v * w / norm, state


@kernel
def _turn(
    dx: float, dy: float, dz: float, mu: float, cosine: float, sine: float
) -> tuple[float, float, float]:
    """Unit direction at the cosine mu from d, at a given azimuth."""
    spread = math.sqrt(max(0.0, 1.0 - mu * mu))
    across2 = dx * dx + dy * dy
    if across2 < 1e-16:
        return spread * cosine, spread * sine, math.copysign(mu, dz * mu)
    across = math.sqrt(across2)
    part = spread / across
    ox = mu * dx + part * (dx * dz * cosine - dy * sine)
    oy = mu * dy + part * (dy * dz * cosine + dx * sine)
    oz = mu * dz - spread * across * cosine
    # Pull the length back to 1, because thousands of turns follow each other
    pull = unit_factor(ox, oy, oz)
    return ox * pull, oy * pull, oz * pull


@kernel
def _deposit(
    bins: NDArray[np.float64],
    edges: NDArray[np.float64],
    side: int,
    dx: float,
    dy: float,
    cosine: float,
    flux: float,
) -> None:
    """Add flux that leaves at a polar cosine and an azimuth to its bin."""
    low, high = 0, edges.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if edges[middle] >= cosine:
            low = middle
        else:
            high = middle
    column = 0
    n_phi = bins.shape[2]
    if n_phi > 1:
        turn = math.atan2(dy, dx) / (2.0 * math.pi) * n_phi + 0.5
        column = math.floor(turn) % n_phi
    bins[side, low, column] += flux


@kernel
def trace_plate(
    problem: PlateProblem,
    seed: int,
    first_ray: int,
    n_rays: int,
    weighted: bool,
    bins: NDArray[np.float64],
    totals: NDArray[np.float64],
) -> None:
    """Trace rays and add to the tallies.

    Parameters
    ----------
    problem : plate and beam
    seed, first_ray, n_rays : the rays and their random numbers
    weighted : estimator
    bins : (2, n_theta, n_phi) flux that left in front and behind; the first column of azimuths is
        centred on the plane of incidence, forwards
    totals : (TOTALS,)
    """
    m, p, n = problem.mean_free_path, problem.absorption, problem.refractive_index
    thickness, edges = problem.thickness, problem.cosine_edges
    full = problem.n_phi > 1
    phase = prepare_phase(problem.g, problem.gamma)
    sin_incidence = math.sqrt(max(0.0, 1.0 - problem.cos_incidence * problem.cos_incidence))
    scatterings = 0

    for ray in range(first_ray, first_ray + n_rays):
        state = stream_state(seed, ray)
        reflected, transmitted, absorbed, weight = 0.0, 0.0, 0.0, 1.0
        # Meet the front face from outside
        dx, dy, dz = sin_incidence, 0.0, problem.cos_incidence
        if problem.front_tilt.size > 0:
            dx, dy, dz, through, state = rough_face(dx, dy, dz, 1.0, n, problem.front_tilt, state)
            back_share = 0.0 if through else 1.0
            outside = -dz
        else:
            back_share = fresnel_reflectance(1.0, n, dz)
            outside = dz
            if not weighted:
                state = advance(state)
                back_share = 1.0 if uniform(state) < back_share else 0.0
        if back_share > 0.0:
            _deposit(bins, edges, 0, dx, dy, outside, back_share)
        if problem.front_tilt.size == 0:
            dx /= n
            dz = math.sqrt(1.0 - dx * dx)
        reflected = back_share
        weight = 1.0 - back_share
        # An analog ray knows from the start how far absorption lets it go
        reach = math.inf
        if not weighted and p > 0.0:
            state = advance(state)
            reach = -math.log(1.0 - uniform(state)) / p
        z, length, step = 0.0, 0.0, 0

        while weight > 0.0:
            # Fly to the next scattering or to a face
            state = advance(state)
            flight = -m * math.log(1.0 - uniform(state))
            to_face = (thickness - z) / dz if dz > 0.0 else -z / dz
            inside = flight < to_face
            travel = flight if inside else to_face
            length += travel
            if length > reach:
                absorbed += weight
                break
            if inside:
                z += travel * dz
                step += 1
                state = advance(state)
                mu = sample_prepared(phase, uniform(state))
                cosine, sine, state = _azimuth(state)
                if full:
                    dx, dy, dz = _turn(dx, dy, dz, mu, cosine, sine)
                else:
                    spread = (1.0 - mu * mu) * (1.0 - dz * dz)
                    dz = mu * dz + math.sqrt(max(0.0, spread)) * cosine
                    dz = min(1.0, max(-1.0, dz))
                if not weighted or step & 63:
                    continue
            # Settle absorption, at a face and now and then on long walks
            if weighted:
                share = math.exp(-p * length)
                absorbed += weight * (1.0 - share)
                weight *= share
                length = 0.0
            if not inside:
                # Meet a face from inside
                back = dz > 0.0
                z = thickness if back else 0.0
                along = abs(dz)
                if not full:
                    dx, dy = math.sqrt(max(0.0, 1.0 - dz * dz)), 0.0
                tilt = problem.back_tilt if back else problem.front_tilt
                if tilt.size > 0:
                    dx, dy, along, through, state = rough_face(dx, dy, along, n, 1.0, tilt, state)
                    gone = weight if through else 0.0
                    if through:
                        _deposit(bins, edges, int(back), dx, dy, along, gone)
                    dz = along if back else -along
                else:
                    gone = 1.0 - fresnel_reflectance(n, 1.0, along)
                    if not weighted:
                        state = advance(state)
                        gone = 1.0 if uniform(state) < gone else 0.0
                    gone *= weight
                    if gone > 0.0:
                        outside = math.sqrt(max(0.0, 1.0 - n * n * (1.0 - dz * dz)))
                        _deposit(bins, edges, int(back), dx, dy, outside, gone)
                    dz = -dz
                weight -= gone
                if back:
                    transmitted += gone
                else:
                    reflected += gone
            # Let faint rays die, or live on brighter
            if weight < _ROULETTE_BELOW and weight > 0.0:
                state = advance(state)
                weight = weight / _SURVIVAL if uniform(state) < _SURVIVAL else 0.0

        scatterings += step
        totals[0] += reflected
        totals[1] += reflected * reflected
        totals[2] += transmitted
        totals[3] += transmitted * transmitted
        totals[4] += absorbed
    totals[5] += scatterings
