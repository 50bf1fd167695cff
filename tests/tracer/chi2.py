"""Does a sampler draw from the density that it claims? A χ² test on cells, and nothing else.

A cell's expected count is the integral of the density over it (Gauss points in every cell); cells
with few expected counts are pooled. The test fails below a significance that a whole suite of such
tests with fixed seeds never meets by chance.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2 as chi2_distribution

SIGNIFICANCE = 1e-4
POOL_BELOW = 8.0

Direction = tuple[float, float, float]


def chi2_counts(observed: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """p-value of observed against expected counts; asserts that none fall where none may."""
    observed, expected = observed.ravel(), expected.ravel()
    total = observed.sum()
    impossible = expected < 1e-9 * total
    assert observed[impossible].sum() <= 1e-5 * total, "samples where the density is 0"
    # Pool the small cells
    small = expected < POOL_BELOW
    pooled_observed = np.append(observed[~small], observed[small].sum())
    pooled_expected = np.append(expected[~small], expected[small].sum())
    if pooled_expected[-1] < POOL_BELOW:
        pooled_observed[-2] += pooled_observed[-1]
        pooled_expected[-2] += pooled_expected[-1]
        pooled_observed, pooled_expected = pooled_observed[:-1], pooled_expected[:-1]
    statistic = ((pooled_observed - pooled_expected) ** 2 / pooled_expected).sum()
    return float(chi2_distribution.sf(statistic, max(1, pooled_observed.size - 1)))


def chi2_line(samples: ArrayLike, density: Callable[[float], float], edges: ArrayLike) -> float:
    """Test samples of one number against a density on the cells between ``edges``."""
    drawn, cuts = np.asarray(samples, np.float64), np.asarray(edges, np.float64)
    observed = np.histogram(drawn, cuts)[0].astype(np.float64)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = np.diff(cuts)[:, None] / 2
    points = cuts[:-1, None] + half * (1 + nodes)
    values = np.vectorize(density, otypes=[float])(points)
    expected = (values * half * weights).sum(axis=1) * drawn.size
    assert expected.sum() <= drawn.size * 1.001, "the density integrates to more than 1"
    # What lies outside the edges is a cell of its own
    observed = np.append(observed, drawn.size - observed.sum())
    expected = np.append(expected, max(0.0, drawn.size - expected.sum()))
    p_value = chi2_counts(observed, expected)
    assert p_value > SIGNIFICANCE, f"χ² rejects the sampler, p = {p_value:.2e}"
    return p_value


def chi2_sphere(
    directions: NDArray[np.float64],
    pdf: Callable[[float, float, float], float],
    *,
    drawn: int | None = None,
    cells: tuple[int, int] = (24, 24),
    gauss: int = 6,
    significance: float = SIGNIFICANCE,
) -> float:
    """Test directions against a density per solid angle over the whole sphere.

    Parameters
    ----------
    directions : (n, 3) unit vectors that were sampled; samples without a direction are left out
    pdf : density per solid angle of one direction
    drawn : number of attempts, if some of them gave no direction; they form a class of their own
    cells : rows in cosine, columns in azimuth
    gauss : points per side with which the density is integrated over a cell
    """
    rows, columns = cells
    attempts = len(directions) if drawn is None else drawn
    edges_z = np.linspace(-1, 1, rows + 1)
    edges_phi = np.linspace(-np.pi, np.pi, columns + 1)
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    height = np.clip(directions[:, 2], -1, 1)
    observed = np.histogram2d(height, azimuth, [edges_z, edges_phi])[0]
    # Integrate the density over each cell of equal solid angle
    nodes, weights = np.polynomial.legendre.leggauss(gauss)
    half_z, half_phi = 1 / rows, np.pi / columns
    z = (edges_z[:-1, None] + half_z * (1 + nodes)).ravel()
    phi = (edges_phi[:-1, None] + half_phi * (1 + nodes)).ravel()
    sine = np.sqrt(1 - z * z)
    values = np.array(
        [[pdf(s * np.cos(f), s * np.sin(f), c) for f in phi] for s, c in zip(sine, z, strict=True)]
    )
    cell_weights = np.outer(np.tile(weights, rows), np.tile(weights, columns))
    blocks = (values * cell_weights).reshape(rows, gauss, columns, gauss).sum(axis=(1, 3))
    expected = blocks * half_z * half_phi * attempts
    assert expected.sum() <= attempts * 1.01, "the density integrates to more than 1"
    observed = np.append(observed.ravel(), attempts - len(directions))
    expected = np.append(expected.ravel(), max(0.0, attempts - expected.sum()))
    p_value = chi2_counts(observed, expected)
    assert p_value > significance, f"χ² rejects the sampler, p = {p_value:.2e}"
    return p_value
