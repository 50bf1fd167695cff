"""Least squares on the exact model: mean free path, absorption and g of one wavelength.

R and T hardly change along g at constant mu_s', so the objective is a long flat valley, often with
two shallow minima. The fit therefore separates the parameters: with g held, mu_s' and p follow by
a few Gauss–Newton steps, because across the valley everything is close to linear; along g the
valley is scanned and its lowest point refined. The scan stays with the result: intervals are read
from it.

The published objective sums (model / measured - 1)² over plates and angles. Its minimum leans
towards small values, because a value measured too low weighs more; so deviations are taken
relative to a first fit of the model instead, which has no such bias.

References
----------
S. G. Pozdnyakov, S. V. Ershov, A. G. Voloboy, Keldysh Institute Preprints 67 (2019), for procedure
and objective.
G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 413 (1973): separation of variables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tracer.scattering.fits.problem import (
    BOUNDS,
    WavelengthProblem,
    bounds_hit,
    medium_of,
    parameters_of,
)
from tracer.scattering.plates.medium import ScatteringMedium

__all__ = ["ValleyPoint", "WavelengthFit", "fit_wavelength", "published_objective"]

Array = NDArray[np.float64]
_STEP = 1e-5
_SCANNED = np.arctanh(
    np.array([-0.499, -0.25, 0.0, 0.2, 0.35, 0.5, 0.63, 0.75, 0.85, 0.92, 0.97, 0.9899])
)
_ENOUGH = 60.0
"""A rise of the sum of squares beyond which the valley is left."""


@dataclass(frozen=True, kw_only=True)
class ValleyPoint:
    """Best mu_s' and p at one g.

    Attributes
    ----------
    shape : atanh g
    chi2 : sum of squares
    pair : (2,) ln mu_s', ln p
    deviations : (2,) their standard errors at this g, from the errors of the data
    inflation : mean factor by which weights below 1 make sums of squares differ from those of a
        likelihood: divide differences of chi2 by it
    """

    shape: float
    chi2: float
    pair: Array
    deviations: Array
    inflation: float = 1.0


@dataclass(frozen=True, kw_only=True)
class WavelengthFit:
    """Result for one wavelength and one exponent.

    Attributes
    ----------
    wavelength_nm : 0 for the spectral average
    medium : best m, p, g at the given gamma
    valley : best fits along g, rising in g; the best alone if g was held
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
    valley: tuple[ValleyPoint, ...]
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
    begin = parameters_of(start or _starting_medium(problem, gamma))
    shape = begin[2] if g is None else math.atanh(g)
    walk = _Valley(problem, gamma)
    # A first fit makes the reference for deviations
    first = walk.fit(float(shape), begin[:2])
    walk.reference = walk.flux(first)
    if g is None:
        points = _scan(walk, walk.fit(float(shape), first.pair))
    else:
        points = [walk.fit(float(shape), first.pair)]
    best = min(points, key=lambda point: point.chi2)
    medium = medium_of(np.append(best.pair, best.shape), gamma, problem.index)
    flux, section = problem.predict(medium)
    used = problem.used
    deviation = (flux[used] - problem.measured[used]) / flux[used]
    return WavelengthFit(
        wavelength_nm=wavelength_nm,
        medium=medium,
        valley=tuple(points),
        chi2=best.chi2,
        values=int(used.sum()) + section.size,
        rms=float(np.sqrt(np.mean(deviation**2))),
        objective=published_objective(problem, flux),
        bounds=bounds_hit(medium) if g is None else (),
        evaluations=walk.evaluations,
        measured=problem.measured,
        measured_error=problem.errors,
        predicted=flux,
        thickness_mm=problem.flux.thickness_mm,
        incidence_deg=problem.flux.incidence_deg,
        section=section,
    )


def published_objective(problem: WavelengthProblem, flux: Array) -> float:
    """Sum over plates and angles of [(R/R' - 1)² + (T/T' - 1)²] W, primes measured."""
    used = problem.used
    ratio = flux[used] / problem.measured[used] - 1.0
    return float(np.sum(problem.weights[used] * ratio**2))


class _Valley:
    """Fits of mu_s' and p with g held."""

    def __init__(self, problem: WavelengthProblem, gamma: float) -> None:
        self.problem, self.gamma = problem, gamma
        used = problem.used
        self.measured = problem.measured[used]
        self.scale = np.sqrt(problem.weights[used]) / problem.errors[used]
        self.reference = self.measured
        self.evaluations = 0

    def residuals(self, pair: Array, shape: float) -> Array:
        self.evaluations += 1
        medium = medium_of(np.append(pair, shape), self.gamma, self.problem.index)
        flux, section = self.problem.predict(medium)
        deviation = (flux[self.problem.used] - self.measured) / self.reference
        return np.concatenate((deviation * self.scale, self.problem.shape_residuals(section)))

    def flux(self, point: ValleyPoint) -> Array:
        medium = medium_of(np.append(point.pair, point.shape), self.gamma, self.problem.index)
        return np.asarray(self.problem.predict(medium)[0][self.problem.used])

    def fit(self, shape: float, pair: Array) -> ValleyPoint:
        """Levenberg–Marquardt from a neighbour's values; the Jacobian is kept while it serves."""
        low, high = _pair_box()
        x = np.clip(pair, low, high)
        at = self.residuals(x, shape)
        jacobian = self._jacobian(x, at, shape)
        fresh, damping = True, 1e-6
        for _ in range(40):
            hessian = jacobian.T @ jacobian
            damped = hessian + damping * np.diag(np.diag(hessian) + 1e-12)
            step = np.clip(-np.linalg.solve(damped, jacobian.T @ at), -1.5, 1.5)
            tried = np.clip(x + step, low, high)
            there = self.residuals(tried, shape)
            gain = float(at @ at - there @ there)
            if gain >= 0.0:
                predicted = -float(step @ (jacobian.T @ at))
                moved = np.abs(tried - x)
                x, at, fresh = tried, there, False
                damping = max(1e-9, 0.1 * damping)
                if np.all(moved < 1e-3) or gain < 1e-6 * float(at @ at):
                    break
                if gain < 0.5 * predicted:
                    jacobian, fresh = self._jacobian(x, at, shape), True
            elif np.all(np.abs(step) < 1e-6):
                break
            elif fresh:
                damping = max(1e-3, 10.0 * damping)
            else:
                jacobian, fresh = self._jacobian(x, at, shape), True
        deviations, inflation = self._errors(jacobian)
        return ValleyPoint(
            shape=shape, chi2=float(at @ at), pair=x, deviations=deviations, inflation=inflation
        )

    def _errors(self, jacobian: Array) -> tuple[Array, float]:
        """Standard errors of both parameters, and the mean factor on differences of chi2.

        A weight below 1 makes the fit look away from a value; it does not make that value worse
        than its error says. So the covariance is the sandwich H⁻¹ G H⁻¹ of a weighted fit, not H⁻¹
        (Rotnitzky and Jewell, Biometrika 77, 485 (1990)).
        """
        weight = np.ones(len(jacobian))
        weight[: self.measured.size] = self.problem.weights[self.problem.used]
        inverse = np.linalg.pinv(jacobian.T @ jacobian)
        weighted = jacobian.T @ (weight[:, np.newaxis] * jacobian)
        covariance = inverse @ weighted @ inverse
        factor = float(np.trace(inverse @ weighted)) / len(inverse)
        return np.sqrt(np.diag(covariance)), max(factor, 1e-3)

    def _jacobian(self, x: Array, at: Array, shape: float) -> Array:
        moved = [self.residuals(x + _STEP * e, shape) for e in np.eye(2)]
        return np.stack([(m - at) / _STEP for m in moved], axis=1)


def _scan(walk: _Valley, start: ValleyPoint) -> list[ValleyPoint]:
    """Best fits along g, closer together about the lowest."""
    points = {start.shape: start}
    shapes = _SCANNED
    upwards = shapes > start.shape
    for side in (shapes[upwards], shapes[~upwards][::-1]):
        neighbour = start
        for shape in side:
            neighbour = _visit(walk, points, float(shape), neighbour)
            lowest = min(p.chi2 for p in points.values())
            if neighbour.chi2 > lowest + _ENOUGH:
                break
    # Refine the lowest point by parabolas, then sample its width
    for _ in range(4):
        shape, width = _parabola(points)
        _visit(walk, points, shape, _nearest(points, shape))
    _, width = _parabola(points)
    best = min(points.values(), key=lambda p: p.chi2).shape
    for offset in (-1.8, -1.0, -0.5, 0.5, 1.0, 1.8):
        shape = best + offset * width
        if _SCANNED[0] < shape < _SCANNED[-1]:
            _visit(walk, points, shape, _nearest(points, shape))
    inside = [p for p in points.values() if not _clamped(walk, p)]
    return sorted(inside or points.values(), key=lambda p: p.shape)


def _visit(
    walk: _Valley, points: dict[float, ValleyPoint], shape: float, neighbour: ValleyPoint
) -> ValleyPoint:
    if all(abs(shape - known) > 1e-4 for known in points):
        points[shape] = walk.fit(shape, neighbour.pair)
        return points[shape]
    return neighbour


def _nearest(points: dict[float, ValleyPoint], shape: float) -> ValleyPoint:
    return points[min(points, key=lambda known: abs(known - shape))]


def _parabola(points: dict[float, ValleyPoint]) -> tuple[float, float]:
    """Lowest point of the parabola through the lowest three neighbours, and its 1-sigma width."""
    shapes = np.array(sorted(points))
    chi2 = np.array([points[s].chi2 for s in shapes])
    k = int(np.argmin(chi2))
    if shapes.size < 3 or k in (0, shapes.size - 1):
        inner = shapes[1] if k == 0 else shapes[-2] if shapes.size > 1 else shapes[0]
        return 0.5 * (float(shapes[k]) + float(inner)), 0.3
    x, y = shapes[k - 1 : k + 2], chi2[k - 1 : k + 2]
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    curvature = (right - left) / (x[2] - x[0])
    if curvature <= 0.0:
        return float(x[1]), 0.3
    lowest = 0.5 * (x[0] + x[1]) - 0.5 * left / curvature
    return float(np.clip(lowest, x[0], x[2])), float(min(0.4, 1.0 / math.sqrt(curvature)))


def _clamped(walk: _Valley, point: ValleyPoint) -> bool:
    """Whether g gave way because m would fall below its bound."""
    medium = medium_of(np.append(point.pair, point.shape), walk.gamma, walk.problem.index)
    return abs(math.atanh(medium.g) - point.shape) > 1e-6


def _starting_medium(problem: WavelengthProblem, gamma: float) -> ScatteringMedium:
    """Best of a coarse scan over mu_s' and p at a middling g."""
    shape = math.atanh(0.6 if gamma < 4.0 else 0.4)
    best: tuple[float, ScatteringMedium] | None = None
    for reduced in np.geomspace(0.02, 60.0, 12):
        for absorption in (3e-4, 3e-3, 0.03, 0.3, 3.0):
            y = np.array([math.log(reduced), math.log(absorption), shape])
            medium = medium_of(y, gamma, problem.index)
            ratio = problem.predict(medium)[0] / problem.measured
            log_ratio = np.log(np.maximum(ratio[problem.used], 1e-12))
            misfit = float(np.sum(problem.weights[problem.used] * log_ratio**2))
            if best is None or misfit < best[0]:
                best = (misfit, medium)
    assert best is not None
    return best[1]


def _pair_box() -> tuple[Array, Array]:
    low = [math.log(1e-4), math.log(BOUNDS.absorption_low_per_mm)]
    high = [math.log(1e4), math.log(BOUNDS.absorption_high_per_mm)]
    return np.array(low), np.array(high)
