"""What detectors registered, summed anew from the rays: the sums that a map keeps as a cache."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import lean_kernel
from raymap.limits import CELLS_FLOOR, CELLS_PER_BYTE, affordable
from raymap.schema import COLOR_SCALE
from raymap.stored import StoredPortion

__all__ = ["add_meetings", "count_meetings"]

Sums = NDArray[np.float64]


def count_meetings(
    portion: StoredPortion, results: dict[tuple[int, int], tuple[Sums, Sums]]
) -> None:
    """Add what each detector registered in a portion.

    A detector of more cells than the file can pay for is left out: its sums are asked of the rays.

    Parameters
    ----------
    results : by detector and channel set, Σ w·c and Σ (w·c)² of (cells_v, cells_u, n_channels)
    """
    limit = affordable(portion.map.bytes, CELLS_FLOOR, CELLS_PER_BYTE)
    for detector, described in enumerate(portion.map.directory.detectors):
        columns, rows = described.cells
        channels = portion.map.channel_sets[portion.channel_set].n_channels
        if columns * rows * channels > limit:
            continue
        key = detector, portion.channel_set
        if key not in results:
            shape = (rows, columns, channels)
            results[key] = np.zeros(shape), np.zeros(shape)
        add_meetings(portion, detector, *results[key])


def add_meetings(portion: StoredPortion, detector: int, sums: Sums, sums2: Sums) -> None:
    """Add what a detector registered in a portion.

    Parameters
    ----------
    sums, sums2 : (cells_v, cells_u, n_channels), of registered meetings Σ w·c, and the sum over
        emissions of (Σ w·c)²
    """
    if not portion.n_descriptors:
        return
    meetings = portion.descriptors()
    counts = portion.column("descriptor_count")
    counted = (meetings.detector == detector) & meetings.registered
    records = np.repeat(np.arange(portion.n_records), counts)[counted]
    rays = np.searchsorted(portion.record_offsets(), records, side="right") - 1
    weight = portion.column("weight")[rays]
    colors = portion.column("color")[records]
    emission = portion.column("emission")[rays] if portion.grouped else rays.astype(np.int64)
    cell = meetings.cell[counted]
    last = np.full(sums.shape[:2], -1, np.int64)
    _count(cell, weight, emission, colors, sums, sums2, last, np.zeros(sums.shape))


@lean_kernel
def _count(
    cell: NDArray[np.uint16],
    weight: NDArray[np.float32],
    emission: NDArray[np.int64],
    colors: NDArray[np.uint16],
    sums: Sums,
    sums2: Sums,
    last: NDArray[np.int64],
    part: Sums,
) -> None:
    """Add w·c of each meeting to its cell; ``part`` is what the ``last`` emission brought there."""
    for k in range(weight.size):
        v, u = cell[k, 1], cell[k, 0]
        if last[v, u] != emission[k]:
            last[v, u] = emission[k]
            for channel in range(colors.shape[1]):
                part[v, u, channel] = 0.0
        for channel in range(colors.shape[1]):
            value = np.float64(weight[k]) * colors[k, channel] / COLOR_SCALE
            sums[v, u, channel] += value
            sums2[v, u, channel] += value * (value + 2.0 * part[v, u, channel])
            part[v, u, channel] += value
