"""Flux of sums of weights, and its standard error: the one estimator, of traces and of maps.

A ray of weight w that source s emitted carries Φ_s / N_s w, N_s being the rays (emissions, where
they split) that the source sent. For what they bring to some place, w being all that one emission
brings there:

    flux = Σ_s Φ_s/N_s Σw,    se² = Σ_s (Φ_s/N_s)² [Σw² - (Σw)²/N_s].

Rays that bring nothing are among the N_s: the sums need not know them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["flux_per_ray", "spread", "variances"]

Floats = NDArray[np.float64]


def flux_per_ray(flux: ArrayLike, emitted: NDArray[Any]) -> Floats:
    """Flux of a ray of weight 1 of each source; 0 where a source emitted nothing."""
    whole = np.asarray(flux, np.float64)
    result: Floats = np.divide(whole, emitted, out=np.zeros(whole.shape), where=emitted > 0)
    return result


def spread(emitted: ArrayLike, sum_w: Floats, sum_w2: Floats) -> Floats:
    """Squared standard error of Σw of one source.

    Parameters
    ----------
    emitted : rays or emissions of the source, broadcast against the sums; where there are none,
        nothing is subtracted
    sum_w, sum_w2 : (...) Σw and Σw²
    """
    sent = np.asarray(emitted)
    mean = np.divide(sum_w**2, sent, out=np.zeros(np.shape(sum_w)), where=sent > 0)
    result: Floats = np.maximum(sum_w2 - mean, 0.0)
    return result


def variances(factors: ArrayLike, emitted: ArrayLike, sum_w: Floats, sum_w2: Floats) -> Floats:
    """Squared standard error of the flux of each source, of `flux_per_ray` ``factors``."""
    result: Floats = np.asarray(factors, np.float64) ** 2 * spread(emitted, sum_w, sum_w2)
    return result
