"""Least squares on the exact model: mean free path, absorption and g of one wavelength.

The published objective sums (model / measured - 1)² over plates and angles. Its minimum leans
towards small values, because a value measured too low weighs more; so the fit takes one more turn
with deviations relative to the model found first, which has no such bias.

References
----------
S. G. Pozdnyakov, S. V. Ershov, A. G. Voloboy, Keldysh Institute Preprints 67 (2019), for procedure
and objective.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.errors import MissingExtra
from tracer.scattering.medium import ScatteringMedium
from tracer.scattering.problem import (
    BOUNDS,
    WavelengthProblem,
    bounds_hit,
    medium_of,
    parameters_of,
)

__all__ = [
    "WavelengthFit",
    "conditional_fit",
    "fit_wavelength",
    "published_objective",
    "starting_medium",
]

Array = NDArray[np.float64]
_STEP = 1e-5
_SCANNED_SHAPES = np.array([-0.3, 0.1, 0.3, 0.5, 0.7, 0.85, 0.95])
_SHAPE_SPREAD = 0.9
"""Prior standard deviation of atanh g: half of the range between the bounds."""


@dataclass(frozen=True, kw_only=True)
class WavelengthFit:
    """Result for one wavelength and one exponent.

    Attributes
    ----------
    wavelength_nm : 0 for the spectral average
    medium : best m, p, g at the given gamma
    covariance : (3, 3) of (ln mu_s', ln p, atanh g)
    chi2 : sum of squared deviations over their errors, weights included
    values : how many measured values took part
    rms : root mean square relative deviation of R and T that count
    objective : the published objective
    bounds : bounds at which the fit stands, in words
    evaluations : of the model
    measured, measured_error, predicted : (2 n,) R rows, then T rows; errors are relative
    thickness_mm, incidence_deg : (n,) of the rows
    section : BTDF of the thinnest plate at the measured angles, if it took part
    """

    wavelength_nm: float
    medium: ScatteringMedium
    covariance: Array
    chi2: float
    values: int
    rms: float
    objective: float
    bounds: tuple[str, ...]
    evaluations: int
    measured: Array
    measured_error: Array
    predicted: Array
    thickness_mm: Array
    incidence_deg: Array
    section: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def reduced_scattering_error(self) -> float:
        """Relative standard error of mu_s'."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def absorption_error(self) -> float:
        """Relative standard error of p."""
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def g_error(self) -> float:
        """Standard error of g."""
        return float(np.sqrt(self.covariance[2, 2]) * (1.0 - self.medium.g**2))

    @property
    def mean_free_path_error(self) -> float:
        """Relative standard error of m, which inherits that of g at constant mu_s'."""
        step = 1e-4
        gamma, index = self.medium.gamma, self.medium.index
        base = parameters_of(self.medium)
        moved = base + np.array([0.0, 0.0, step])
        slope = (
            math.log(medium_of(moved, gamma, index).mean_free_path_mm)
            - math.log(medium_of(base, gamma, index).mean_free_path_mm)
        ) / step
        row = np.array([-1.0, 0.0, slope])
        return float(np.sqrt(row @ self.covariance @ row))


def fit_wavelength(
    problem: WavelengthProblem,
    gamma: float,
    *,
    start: ScatteringMedium | None = None,
    g: float | None = None,
    wavelength_nm: float = 0.0,
) -> WavelengthFit:
    """Fit (m, p, g) of one wavelength at a fixed exponent.

    Parameters
    ----------
    problem : measured rows
    gamma : exponent of the phase function
    start : where to start; a neighbouring wavelength, or a scan if not given
    g : hold g at this value
    wavelength_nm : noted in the result
    """
    x = parameters_of(start or starting_medium(problem, gamma))
    free = np.array([True, True, g is None])
    x = np.clip(x, *_box())
    if g is None:
        x = _best_along_g(problem, gamma, x)
    else:
        x[2] = math.atanh(g)
    counts = np.zeros(1, np.int64)
    used = problem.used
    scale = np.sqrt(problem.weights[used]) / problem.errors[used]

    def model(parameters: Array) -> tuple[Array, Array]:
        counts[0] += 1
        flux, section = problem.predict(medium_of(parameters, gamma, problem.index))
        return flux[used], section

    # First with deviations relative to the measurement, then to the model found
    reference = problem.measured[used]
    for tolerance in (1e-3, 1e-6):

        def residuals(parameters: Array, reference: Array = reference) -> Array:
            flux, section = model(parameters)
            return np.concatenate(
                ((flux - problem.measured[used]) / reference * scale,
                 problem.shape_residuals(section))
            )  # fmt: skip

        x = _minimise(residuals, x, free, tolerance)
        reference = model(x)[0]

    medium = medium_of(x, gamma, problem.index)
    flux, section = problem.predict(medium)
    deviation = (flux[used] - problem.measured[used]) / flux[used]
    shape = problem.shape_residuals(section)
    chi2 = float(np.sum((deviation * scale) ** 2) + np.sum(shape**2))
    jacobian = _jacobian(lambda y: residuals(y, reference), parameters_of(medium))
    weights = np.concatenate((problem.weights[used], np.ones(shape.size)))
    values = int(used.sum()) + shape.size
    return WavelengthFit(
        wavelength_nm=wavelength_nm,
        medium=medium,
        covariance=_covariance(jacobian, weights, free, chi2 / max(1, values - int(free.sum()))),
        chi2=chi2,
        values=values,
        rms=float(np.sqrt(np.mean(deviation**2))),
        objective=published_objective(problem, flux),
        bounds=bounds_hit(medium) if g is None else (),
        evaluations=int(counts[0]),
        measured=problem.measured,
        measured_error=problem.errors,
        thickness_mm=problem.flux.thickness_mm,
        incidence_deg=problem.flux.incidence_deg,
        predicted=flux,
        section=section,
    )


def conditional_fit(
    problem: WavelengthProblem, gamma: float, start: Array, shape: float
) -> tuple[float, Array, Array]:
    """Fit ln mu_s' and ln p with atanh g held, by Gauss–Newton: there both are nearly linear.

    Parameters
    ----------
    problem : measured rows
    gamma : exponent
    start : (2,) ln mu_s', ln p of a neighbour
    shape : atanh g

    Returns
    -------
    chi2 : sum of squares
    parameters : (2,) best ln mu_s', ln p
    deviations : (2,) standard errors at this g
    """
    used = problem.used
    scale = np.sqrt(problem.weights[used]) / problem.errors[used]
    low, high = _box()

    def residuals(pair: Array) -> Array:
        medium = medium_of(np.append(pair, shape), gamma, problem.index)
        flux, section = problem.predict(medium)
        deviation = (flux[used] - problem.measured[used]) / flux[used]
        return np.concatenate((deviation * scale, problem.shape_residuals(section)))

    x = start
    at = residuals(x)
    jacobian = np.stack([(residuals(x + _STEP * e) - at) / _STEP for e in np.eye(2)], axis=1)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    deviations = np.sqrt(np.diag(inverse))
    for _ in range(6):
        step = -inverse @ (jacobian.T @ at)
        # Halve steps that overshoot
        for _ in range(4):
            tried = np.clip(x + step, low[:2], high[:2])
            there = residuals(tried)
            if there @ there <= at @ at * (1.0 + 1e-12):
                x, at = tried, there
                break
            step = 0.5 * step
        if np.all(np.abs(step) < 0.02 * deviations + 1e-9):
            break
    return float(at @ at), x, deviations


def published_objective(problem: WavelengthProblem, flux: Array) -> float:
    """Sum over plates and angles of [(R/R' - 1)² + (T/T' - 1)²] W, primes measured."""
    used = problem.used
    ratio = flux[used] / problem.measured[used] - 1.0
    return float(np.sum(problem.weights[used] * ratio**2))


def starting_medium(problem: WavelengthProblem, gamma: float) -> ScatteringMedium:
    """Best of a coarse scan over mu_s' and p at a middling g."""
    shape = 0.6 if gamma < 4.0 else 0.4
    best: tuple[float, ScatteringMedium] | None = None
    for reduced in np.geomspace(0.02, 60.0, 14):
        for absorption in (3e-4, 3e-3, 0.03, 0.3, 3.0):
            y = np.array([math.log(reduced), math.log(absorption), math.atanh(shape)])
            medium = medium_of(y, gamma, problem.index)
            ratio = problem.predict(medium)[0] / problem.measured
            log_ratio = np.log(np.maximum(ratio[problem.used], 1e-12))
            misfit = float(np.sum(problem.weights[problem.used] * log_ratio**2))
            if best is None or misfit < best[0]:
                best = (misfit, medium)
    assert best is not None
    return best[1]


def _best_along_g(problem: WavelengthProblem, gamma: float, start: Array) -> Array:
    """Start where a coarse scan along g is lowest: the valley can have two minima."""
    best, lowest = start, math.inf
    pair = start[:2]
    for shape in np.arctanh(_SCANNED_SHAPES):
        chi2, pair, _ = conditional_fit(problem, gamma, pair, float(shape))
        if chi2 < lowest:
            best, lowest = np.append(pair, shape), chi2
    return best


def _box() -> tuple[Array, Array]:
    lower = [
        math.log(1e-4), math.log(BOUNDS.absorption_low_per_mm), math.atanh(BOUNDS.g_low)
    ]  # fmt: skip
    upper = [
        math.log(1e4), math.log(BOUNDS.absorption_high_per_mm), math.atanh(BOUNDS.g_high)
    ]  # fmt: skip
    return np.array(lower), np.array(upper)


def _minimise(residuals: Any, start: Array, free: NDArray[np.bool_], tolerance: float) -> Array:
    """Bounded least squares over the free parameters."""
    try:
        from scipy.optimize import least_squares
    except ImportError:
        raise MissingExtra(
            "fitting needs SciPy; install it with: pip install 'raymap[fit]'"
        ) from None
    low, high = _box()

    def full(part: Array) -> Array:
        x = start.copy()
        x[free] = part
        return x

    margin = 1e-9
    solution = least_squares(
        lambda part: residuals(full(part)),
        np.clip(start[free], low[free] + margin, high[free] - margin),
        jac=lambda part: _jacobian(residuals, full(part))[:, free],
        bounds=(low[free], high[free]),
        xtol=tolerance,
        ftol=tolerance,
        gtol=1e-12,
        max_nfev=40,
    )
    return full(np.asarray(solution.x))


def _jacobian(residuals: Any, x: Array) -> Array:
    """Forward differences; a step back where the upper bound is near."""
    high = _box()[1]
    base = residuals(x)
    columns = []
    for k in range(x.size):
        step = _STEP if x[k] + _STEP < high[k] else -_STEP
        moved = x.copy()
        moved[k] += step
        columns.append((residuals(moved) - base) / step)
    return np.stack(columns, axis=1)


def _covariance(
    jacobian: Array, weights: Array, free: NDArray[np.bool_], reduced_chi2: float
) -> Array:
    """Covariance of the parameters; what the data leave open is as wide as the bounds.

    Weights in the objective are a choice, not a statement about errors: the covariance counts the
    stated errors (sandwich form). Deviations twice as large as stated widen it.
    """
    prior = np.diag([0.0, 0.0, _SHAPE_SPREAD**-2])
    j = jacobian.copy()
    j[:, ~free] = 0.0
    hessian = j.T @ j + prior + np.diag(np.where(free, 0.0, 1e12))
    spread = (j.T * weights) @ j + prior
    inverse = np.linalg.pinv(hessian)
    covariance = inverse @ spread @ inverse
    covariance[~free] = 0.0
    covariance[:, ~free] = 0.0
    return np.asarray(covariance * (reduced_chi2 if reduced_chi2 > 2.0 else 1.0))
