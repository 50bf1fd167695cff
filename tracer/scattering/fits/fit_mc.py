"""The published fit: Nelder–Mead over (ln m, ln p, atanh g) on plates traced by Monte Carlo.

Every evaluation uses the same random numbers, so that the objective is a fixed, slightly rough
function instead of a noisy one; its noise is what other random numbers would change, measured at
the end and reported. The simplex is restarted once at its best point.
"""

from __future__ import annotations

import math
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MissingExtra
from tracer.scattering.fits.fit_exact import published_objective
from tracer.scattering.fits.problem import BOUNDS, WavelengthProblem
from tracer.scattering.plates.goniophotometer import AngularGrid, plate_problem
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_kernel import TOTALS, trace_plate
from tracer.scattering.plates.tilt import SMOOTH, TiltDistribution

__all__ = ["Evaluation", "MonteCarloFit", "fit_monte_carlo", "traced_fluxes"]

Array = NDArray[np.float64]
_HEMISPHERE = AngularGrid(theta_edges_deg=np.array([0.0, 90.0]), n_phi=1)
_FIRST_STEPS = np.array([0.25, 0.4, 0.25])


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """One line of the log of a fit."""

    mean_free_path_mm: float
    absorption_per_mm: float
    g: float
    objective: float


@dataclass(frozen=True, kw_only=True)
class MonteCarloFit:
    """Result of `fit_monte_carlo`.

    Attributes
    ----------
    medium : best medium
    objective : published objective there
    noise : standard deviation of the objective there between seeds
    log : all evaluations in order
    rays, seed : per plate and angle
    seconds : wall time
    """

    medium: ScatteringMedium
    objective: float
    noise: float
    log: tuple[Evaluation, ...]
    rays: int
    seed: int
    seconds: float


def traced_fluxes(
    problem: WavelengthProblem,
    medium: ScatteringMedium,
    *,
    rays: int,
    seed: int,
    weighted: bool = False,
    face: TiltDistribution = SMOOTH,
    threads: int | None = None,
) -> Array:
    """(2 n,) R rows, then T rows of a problem by Monte Carlo; rows that do not count are nan."""
    n = len(problem.flux)
    needed = problem.used[:n] | problem.used[n:]
    values = np.full(2 * n, math.nan)

    def trace(row: int) -> None:
        plate = plate_problem(
            medium,
            float(problem.flux.thickness_mm[row]),
            float(problem.flux.incidence_deg[row]),
            grid=_HEMISPHERE,
            front=face,
            back=face,
        )
        totals = np.zeros(TOTALS)
        trace_plate(plate, seed, row * rays, rays, weighted, np.zeros((2, 1, 1)), totals)
        values[row], values[n + row] = totals[0] / rays, totals[2] / rays

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        list(pool.map(trace, np.flatnonzero(needed)))
    return values


def fit_monte_carlo(
    problem: WavelengthProblem,
    start: ScatteringMedium,
    *,
    rays: int = 10_000,
    seed: int = 1,
    evaluations: int = 40,
    weighted: bool = False,
    face: TiltDistribution = SMOOTH,
    threads: int | None = None,
) -> MonteCarloFit:
    """Fit (m, p, g) of one wavelength as published, at the exponent of ``start``.

    Parameters
    ----------
    problem : measured rows
    start : first vertex; the exact fit is a good one
    rays, seed : per plate and angle
    evaluations : of the objective, both simplexes together
    weighted : estimator of the plates
    face : tilt distribution of all faces
    threads : threads of the trace; the result does not depend on them
    """
    try:
        from scipy.optimize import minimize
    except ImportError:
        raise MissingExtra(
            "fitting needs SciPy; install it with: pip install 'raymap[fit]'"
        ) from None
    begin = time.perf_counter()
    log: list[Evaluation] = []

    def objective_of(medium: ScatteringMedium, stream: int) -> float:
        flux = traced_fluxes(
            problem, medium, rays=rays, seed=stream, weighted=weighted, face=face, threads=threads
        )
        return published_objective(problem, flux)

    def objective(x: Array) -> float:
        medium = _medium(x, start)
        value = objective_of(medium, seed)
        log.append(
            Evaluation(
                mean_free_path_mm=medium.mean_free_path_mm,
                absorption_per_mm=medium.absorption_per_mm,
                g=medium.g,
                objective=value,
            )
        )
        return value

    x = np.array(
        [
            math.log(start.mean_free_path_mm),
            math.log(max(start.absorption_per_mm, BOUNDS.absorption_low_per_mm)),
            math.atanh(start.g),
        ]
    )
    low, high = _box()
    x = np.clip(x, low, high)
    # One simplex, then a smaller one at its best point
    for share, size in ((0.65, 1.0), (1.0, 0.3)):
        budget = max(5, int(evaluations * share) - len(log))
        corners = np.vstack([x, x + size * np.diag(_FIRST_STEPS)])
        corners = np.where(corners > high, 2.0 * x - corners, corners)
        solution = minimize(
            objective,
            x,
            method="Nelder-Mead",
            bounds=list(zip(low, high, strict=True)),
            options={
                "initial_simplex": np.clip(corners, low, high),
                "maxfev": budget,
                "xatol": 1e-3,
                "fatol": 1e-3 * max(1e-9, min((e.objective for e in log), default=1e-6)),
            },
        )
        x = np.asarray(solution.x)
    best = min(log, key=lambda entry: entry.objective)
    medium = _medium(
        np.array(
            [math.log(best.mean_free_path_mm), math.log(best.absorption_per_mm), math.atanh(best.g)]
        ),
        start,
    )
    others = [objective_of(medium, seed + k) for k in range(1, 5)]
    return MonteCarloFit(
        medium=medium,
        objective=best.objective,
        noise=float(np.std([best.objective, *others], ddof=1)),
        log=tuple(log),
        rays=rays,
        seed=seed,
        seconds=time.perf_counter() - begin,
    )


def _box() -> tuple[Array, Array]:
    low = [
        math.log(BOUNDS.mean_free_path_low_mm),
        math.log(BOUNDS.absorption_low_per_mm),
        math.atanh(BOUNDS.g_low),
    ]
    high = [math.log(1e3), math.log(BOUNDS.absorption_high_per_mm), math.atanh(BOUNDS.g_high)]
    return np.array(low), np.array(high)


def _medium(x: Array, start: ScatteringMedium) -> ScatteringMedium:
    return ScatteringMedium(
        mean_free_path_mm=math.exp(x[0]),
        absorption_per_mm=math.exp(x[1]),
        g=math.tanh(x[2]),
        gamma=start.gamma,
        index=start.index,
    )
