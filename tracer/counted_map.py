"""A map without rays: what the detectors counted, and how many rays were emitted for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from raymap.portion import empty_portion
from raymap.reader import NO_RAYS

if TYPE_CHECKING:
    from raymap.directory import ChannelSet
    from raymap.writer import RayMapWriter
    from tracer.counts import Counts, DetectorCount

__all__ = ["write_counts"]


def write_counts(
    writer: RayMapWriter,
    channel_set: ChannelSet,
    counts: Counts,
    *,
    seed: int,
    statistics: dict[str, Any],
) -> None:
    """Write a portion without rays that says how many were emitted, and the detectors' sums.

    Sums do not tell sources apart, so all emitted rays of such a map stand for the same flux:
    where those of the trace did not, each weighs what its own flux is of the mean.
    """
    number = writer.add_channel_set(channel_set)
    writer.start_run(seed=seed, parameters={NO_RAYS: True})
    emitted = np.round(counts.endings.emitted).astype(np.int64)
    writer.append(empty_portion(emitted, channel_set.n_channels))
    for k, detector in enumerate(counts.detectors.values()):
        sums, sums2 = _evened(detector, _mean_flux(counts))
        writer.add_detector_result(k, sums, sums2, channel_set=number)
    writer.finish(statistics)


def _mean_flux(counts: Counts) -> float:
    """Flux of a ray of weight 1, on average over all that were emitted."""
    lit = counts.endings.emitted > 0
    emitted = float(counts.endings.emitted.sum())
    return float(counts.endings.source_flux[lit].sum()) / emitted if emitted else 0.0


def _evened(detector: DetectorCount, mean: float) -> tuple[Any, Any]:
    """Σ w c and Σ (Σ w c)² with weights of which one stands for the mean flux."""
    factors = detector.cells.factors
    lit = detector.cells.emitted > 0
    if not mean or np.allclose(factors[lit], mean, rtol=1e-12, atol=0.0):
        return detector.sums, detector.sums2
    weights = factors / mean
    squares = detector.cells.squares
    even = np.tensordot(weights**2, squares, axes=1)
    whole = squares.sum(axis=0)
    # Squares are kept per channel or per source, not both: a cell's sources share its colours
    ratio = np.divide(even, whole, out=np.zeros_like(whole), where=whole > 0)
    sums = np.tensordot(weights, detector.by_channel, axes=1)
    return sums, detector.sums2 * ratio[:, :, None]
