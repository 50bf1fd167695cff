"""A map without rays: what the detectors counted, and how many rays were emitted for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from raymap.file.reader import DETECTORS, NO_RAYS
from raymap.model.portion import empty_portion

if TYPE_CHECKING:
    from raymap.file.writer import RayMapWriter
    from raymap.model.directory import ChannelSet
    from tracer.transport.counts import Counts

__all__ = ["write_counts"]


def write_counts(
    writer: RayMapWriter,
    channel_set: ChannelSet,
    counts: Counts,
    *,
    seed: int,
    statistics: dict[str, Any],
) -> None:
    """Write a portion without rays that says how many were emitted, and the detectors' sums."""
    number = writer.add_channel_set(channel_set)
    writer.start_run(seed=seed, parameters={NO_RAYS: True})
    emitted = np.round(counts.endings.emitted).astype(np.int64)
    writer.append(empty_portion(emitted, channel_set.n_channels))
    for k, detector in enumerate(counts.detectors.values()):
        writer.add_detector_result(k, *detector.relative_sums(), channel_set=number)
    detectors = {
        name: {"flux": count.total, "flux_se": count.total_se}
        for name, count in counts.detectors.items()
    }
    writer.finish(statistics | {DETECTORS: detectors})
