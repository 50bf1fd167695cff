"""What measured plates tell about (m, p, g, gamma), and what they do not.

R and T depend on m and g nearly through mu_s' = (1 - <cos theta>) / m alone. So the likelihood has
a long valley along g. The fit keeps the best mu_s' and p at each g, and all intervals are read from
there.

g and m, which such data may leave open, get profile intervals: where the smallest sum of squares
rises by 1. For mu_s' and p, which the data fix whatever g is, g is a nuisance: their intervals hold
the middle 68 % of the likelihood integrated over g. (A profile takes the worst g instead of the
average one; where g is open altogether its intervals cover 79 % for 68 %.) Particles in a plastic
scatter forward rather than backward, so the integral runs over 0 <= g, unless the data rule that
out.

References
----------
J. O. Berger, B. Liseo, R. L. Wolpert, Statistical Science 14, 1 (1999): integrated likelihoods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.scattering.fits.fit_exact import WavelengthFit
from tracer.scattering.fits.problem import WavelengthProblem, medium_of
from tracer.scattering.plates.medium import ScatteringMedium

__all__ = ["Interval", "Profile", "Sensitivity", "profile_along_g", "sensitivity"]

Array = NDArray[np.float64]

_TAIL = 0.158655
"""Probability beyond one standard deviation, on one side."""


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """Singular values of d ln(R, T) / d(ln m, ln p, g) at a medium.

    Attributes
    ----------
    singular_values : (3,) falling
    directions : (3, 3) rows: unit combinations of (ln m, ln p, g)
    """

    singular_values: Array
    directions: Array


def sensitivity(problem: WavelengthProblem, medium: ScatteringMedium) -> Sensitivity:
    """Which combinations of (ln m, ln p, g) move R and T, and how much."""
    step = 1e-4
    base = np.array([math.log(medium.mean_free_path_mm), math.log(medium.absorption_per_mm)])
    used = problem.used

    def logs(shift: Array) -> Array:
        moved = ScatteringMedium(
            mean_free_path_mm=math.exp(base[0] + shift[0]),
            absorption_per_mm=math.exp(base[1] + shift[1]),
            g=medium.g + shift[2],
            gamma=medium.gamma,
            index=medium.index,
        )
        return np.asarray(np.log(problem.predict(moved)[0][used]))

    columns = [(logs(step * axis) - logs(-step * axis)) / (2.0 * step) for axis in np.eye(3)]
    _, values, directions = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    return Sensitivity(
        singular_values=np.asarray(values, np.float64),
        directions=np.asarray(directions, np.float64),
    )


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A 68 % interval; ``open_low`` and ``open_high``: it ends at a bound of the fit."""

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Best fits along g and the intervals that follow.

    Attributes
    ----------
    g : (n,) values held
    chi2 : (n,) -2 ln of likelihood, less its smallest value
    reduced_scattering, absorption, mean_free_path : (n,) best values there
    intervals : of "reduced_scattering_per_mm" and "absorption_per_mm", integrated over g; of
        "mean_free_path_mm" and "g", by profile
    """

    g: Array
    chi2: Array
    reduced_scattering: Array
    absorption: Array
    mean_free_path: Array
    intervals: dict[str, Interval]


def profile_along_g(fit: WavelengthFit) -> Profile:
    """Likelihood of a fit along g, and 68 % intervals of its parameters."""
    gamma, index = fit.medium.gamma, fit.medium.index
    ts = np.array([point.shape for point in fit.valley])
    sums = np.array([point.chi2 for point in fit.valley]) - fit.chi2
    sums /= min(fit.valley, key=lambda point: point.chi2).inflation
    best = np.array([point.pair for point in fit.valley])
    spread = np.array([point.deviations for point in fit.valley])
    # Refine between the points, then profile each parameter
    fine = np.unique(np.concatenate((ts, np.linspace(ts[0], ts[-1], 600))))
    smooth = _interpolate(ts, np.column_stack([sums, best, spread]), fine)
    chi2 = np.maximum(0.0, smooth[:, 0])
    lost = np.array(
        [math.log(1.0 - medium_of(np.array([0.0, 0.0, t]), gamma, index).mean_cosine) for t in fine]
    )
    share = _share_of_shapes(fine, chi2)
    intervals = {
        "reduced_scattering_per_mm": _integrated(smooth[:, 1], smooth[:, 3], share),
        "absorption_per_mm": _integrated(smooth[:, 2], smooth[:, 4], share),
        "mean_free_path_mm": _profiled(lost - smooth[:, 1], smooth[:, 3], chi2),
    }
    inside = fine[chi2 <= 1.0]
    intervals["g"] = Interval(
        low=math.tanh(inside[0]),
        high=math.tanh(inside[-1]),
        open_low=bool(inside[0] <= ts[0]),
        open_high=bool(inside[-1] >= ts[-1]),
    )
    return Profile(
        g=np.tanh(ts),
        chi2=sums,
        reduced_scattering=np.exp(best[:, 0]),
        absorption=np.exp(best[:, 1]),
        mean_free_path=np.exp(np.interp(ts, fine, lost) - best[:, 0]),
        intervals=intervals,
    )


def _share_of_shapes(shapes: Array, chi2: Array) -> Array:
    """Likelihood times step in g, over g >= 0 where the data allow that; sums to 1."""
    if shapes.size < 2:
        return np.ones(shapes.size)
    forward = shapes >= 0.0
    allowed = forward if np.any(chi2[forward] <= 1.0) else np.ones(shapes.size, np.bool_)
    share = np.where(allowed, np.gradient(np.tanh(shapes)) * np.exp(-0.5 * chi2), 0.0)
    return np.asarray(share / share.sum())


def _integrated(middle: Array, deviation: Array, share: Array) -> Interval:
    """Middle 68 % of a mixture of normal distributions of a logarithm."""
    kept = share > 1e-6 * share.max()
    middle, deviation, share = middle[kept], deviation[kept], share[kept]
    low, high = (_quantile(middle, deviation, share, tail) for tail in (_TAIL, 1.0 - _TAIL))
    return Interval(low=math.exp(low), high=math.exp(high))


def _quantile(middle: Array, deviation: Array, share: Array, level: float) -> float:
    """Quantile of a mixture of normal distributions, by bisection."""
    low = float((middle - 8.0 * deviation).min())
    high = float((middle + 8.0 * deviation).max())
    for _ in range(48):
        x = 0.5 * (low + high)
        below = 0.5 * (1.0 + _erf((x - middle) / (math.sqrt(2.0) * deviation)))
        if float(share @ below) < level:
            low = x
        else:
            high = x
    return 0.5 * (low + high)


def _erf(x: Array) -> Array:
    return np.array([math.erf(value) for value in x.tolist()])


def _profiled(middle: Array, deviation: Array, chi2: Array) -> Interval:
    """Ends of where min over g of chi2 + ((x - middle) / deviation)² stays below 1."""
    inside = chi2 <= 1.0
    reach = deviation[inside] * np.sqrt(1.0 - chi2[inside])
    return Interval(
        low=float(np.exp((middle[inside] - reach).min())),
        high=float(np.exp((middle[inside] + reach).max())),
    )


def _interpolate(x: Array, columns: Array, fine: Array) -> Array:
    """Monotone cubics (Fritsch–Butland) between the points: no wiggles beside steep walls."""
    if x.size < 3:
        return np.column_stack([np.interp(fine, x, column) for column in columns.T])
    width = np.diff(x)[:, None]
    slope = np.diff(columns, axis=0) / width
    inner = np.zeros_like(columns[1:-1])
    same = slope[:-1] * slope[1:] > 0.0
    a, b = 2.0 * width[1:] + width[:-1], width[1:] + 2.0 * width[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        harmonic = (a + b) / (a / slope[:-1] + b / slope[1:])
    inner[same] = harmonic[same]
    tangent = np.vstack((slope[:1], inner, slope[-1:]))
    low = np.clip(np.searchsorted(x, fine, side="right") - 1, 0, x.size - 2)
    h = width[low]
    s = (fine - x[low])[:, None] / h
    return np.asarray(
        (1 + 2 * s) * (1 - s) ** 2 * columns[low]
        + s * (1 - s) ** 2 * h * tangent[low]
        + s**2 * (3 - 2 * s) * columns[low + 1]
        + s**2 * (s - 1) * h * tangent[low + 1]
    )
