"""What detectors registered, summed anew from the rays: the sums that a map keeps as a cache."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.detector_crossings import CheckedCrossings
from raymap.file.stored import StoredPortion
from raymap.jit.kernels import lean_kernel
from raymap.model.limits import CELLS_FLOOR, CELLS_PER_BYTE, affordable
from raymap.model.schema import COLOR_SCALE

__all__ = ["DetectorSums"]

Sums = NDArray[np.float64]


class DetectorSums:
    """What each detector registered in the portions that were added; one pass over each.

    A detector of more cells than the file can pay for is left out: its sums are asked of the rays.

    Attributes
    ----------
    sums : by detector and channel set, Σ w·c of registered crossings, and the sum over emissions of
        (Σ w·c)²; (cells_v, cells_u, n_channels)
    """

    def __init__(self) -> None:
        self.sums: dict[tuple[int, int], tuple[Sums, Sums]] = {}
        self._begun: set[int] = set()

    def add(self, portion: StoredPortion) -> None:
        """Add what every detector registered in a portion."""
        if portion.channel_set not in self._begun:
            self._begin(portion)
        crossings = portion.descriptors()
        checked = CheckedCrossings.check(crossings.detector, crossings.cell, portion.map.detectors)
        if not crossings.registered.any():
            return
        records = np.repeat(np.arange(portion.n_records), portion.column("descriptor_count"))
        weights, colors = portion.column("weight"), portion.column("color")
        offsets = portion.record_offsets()
        emissions = portion.column("emission") if portion.grouped else None
        # Take the crossings detector by detector, those of each in their order
        registered = np.flatnonzero(crossings.registered)
        owner = checked.detector[registered]
        order = registered[np.argsort(owner, kind="stable")]
        met, first = np.unique(checked.detector[order], return_index=True)
        for detector, rows in zip(met.tolist(), np.split(order, first[1:]), strict=True):
            known = self.sums.get((detector, portion.channel_set))
            if known is None:
                continue
            rays = np.searchsorted(offsets, records[rows], side="right") - 1
            emission = rays.astype(np.int64) if emissions is None else emissions[rays]
            last = np.full(known[0].shape[:2], -1, np.int64)
            part = np.zeros(known[0].shape)
            color = colors[records[rows]]
            _count(checked.cell[rows], weights[rays], emission, color, *known, last, part)

    def _begin(self, portion: StoredPortion) -> None:
        """Begin the sums of all detectors in the channel set of a portion."""
        self._begun.add(portion.channel_set)
        limit = affordable(portion.map.bytes, CELLS_FLOOR, CELLS_PER_BYTE)
        channels = portion.map.channel_sets[portion.channel_set].n_channels
        for detector, described in enumerate(portion.map.directory.detectors):
            columns, rows = described.cells
            if columns * rows * channels <= limit:
                shape = (rows, columns, channels)
                self.sums[detector, portion.channel_set] = np.zeros(shape), np.zeros(shape)


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
    """Add w·c of each crossing to its cell; ``part`` is what emission ``last`` brought there."""
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
