"""A map without rays: what the detectors counted, and how many rays were emitted for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.photometry import Photometry
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
    groups: NDArray[np.int64],
    *,
    seed: int,
    statistics: dict[str, Any],
) -> None:
    """Write a portion without rays that says how many were emitted, and the detectors' sums.

    Parameters
    ----------
    groups : (n_sources,) number of the sums that each source adds to
    """
    number = writer.add_channel_set(channel_set)
    writer.start_run(seed=seed, parameters={NO_RAYS: True})
    emitted = np.round(counts.endings.emitted).astype(np.int64)
    writer.append(empty_portion(emitted, channel_set.n_channels))
    # Sums by detector do not keep sources apart: each weighs what its rays carry of the mean
    of_source = Photometry(writer.directory, channel_set).result_weights(emitted)
    weights = np.ones(int(groups.max(initial=0)) + 1)
    weights[groups[emitted > 0]] = of_source[emitted > 0]
    for k, detector in enumerate(counts.detectors.values()):
        sums, sums2 = _weighted(detector, weights)
        writer.add_detector_result(k, sums, sums2, channel_set=number)
    writer.finish(statistics)


def _weighted(detector: DetectorCount, weights: NDArray[np.float64]) -> tuple[Any, Any]:
    """Σ w c and Σ (Σ w c)² with the weight of each group of sources."""
    if np.allclose(weights, 1.0, rtol=1e-12, atol=0.0):
        return detector.sums, detector.sums2
    squares = detector.cells.squares
    even, whole = np.tensordot(weights**2, squares, axes=1), squares.sum(axis=0)
    # Squares are kept by channel or by source, not both: a cell's sources share its colours
    ratio = np.divide(even, whole, out=np.zeros_like(whole), where=whole > 0)
    sums = np.tensordot(weights, detector.by_channel, axes=1)
    return sums, detector.sums2 * ratio[:, :, None]
