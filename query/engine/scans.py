"""Compiled scans over rays and their points: a handful of loops that serve every criterion.

Rays are runs of points, points runs of crossings (`Runs`). Nothing is compiled per criterion; names
come as tables over indices whose last entry answers for index -1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from raymap.model.errors import FormatError

__all__ = ["Runs", "look_up", "mark_events", "match_sequence", "number_rays"]

Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Rows in runs, those of run r being ``offsets[r]:offsets[r + 1]``; `check` alone makes them.

    Attributes
    ----------
    offsets : (n + 1,)
    """

    offsets: Ints

    @staticmethod
    def check(offsets: Ints) -> Runs:
        """Runs that compiled loops may walk along.

        Raises
        ------
        FormatError
            The offsets do not go up from 0.
        """
        if not len(offsets) or offsets[0] != 0 or bool((offsets[1:] < offsets[:-1]).any()):
            raise FormatError("runs do not follow one another")
        return Runs(offsets)

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def n_rows(self) -> int:
        return int(self.offsets[-1])

    def any(self, mask: Bools) -> Bools:
        """(n,) whether a run has a marked row; ``mask`` : (n_rows,)."""
        return _any_of_run(self._marks(mask), self.offsets, 0)

    def any_before_last(self, mask: Bools) -> Bools:
        """(n,) whether a run has a marked row before its last one."""
        return _any_of_run(self._marks(mask), self.offsets, 1)

    def count(self, mask: Bools) -> NDArray[np.int32]:
        """(n,) how many marked rows a run has."""
        return _count_of_run(self._marks(mask), self.offsets)

    def take(self, numbers: Ints) -> Runs:
        """The runs of these numbers, one after the other.

        Raises
        ------
        FormatError
            There is no run of such a number.
        """
        if len(numbers) and not 0 <= int(numbers.min()) <= int(numbers.max()) < len(self):
            raise FormatError("a ray takes a path that there is not")
        return Runs.check(_offsets_of_runs(self.offsets, numbers))

    def rows(self, starts: Ints) -> NDArray[np.int64]:
        """(n_rows,) rows elsewhere, where run r begins at ``starts[r]``."""
        if len(starts) != len(self):
            raise FormatError(f"{len(starts)} beginnings of {len(self)} runs")
        return _rows_of_runs(starts, self.offsets)

    def _marks(self, mask: Bools) -> Bools:
        if len(mask) != self.n_rows:
            raise FormatError(f"{len(mask)} marks of {self.n_rows} rows")
        return mask


def look_up(table: Bools, index: Ints) -> Bools:
    """Table entry of each index; -1 is the last entry.

    Raises
    ------
    FormatError
        The table has no entry for an index.
    """
    out = np.empty(len(index), np.bool_)
    if not _look_up(table, index, out):
        raise FormatError("an index is not in the table that is asked for it")
    return out


@kernel
def _look_up(table: Bools, index: Ints, out: Bools) -> bool:
    """False where an index is beyond the table."""
    n = len(table)
    if n == 0:
        return len(index) == 0
    for i in range(len(index)):
        value = index[i]
        if value >= n:
            return False
        out[i] = table[value] if value >= 0 else table[n - 1]
    return True


@kernel
def mark_events(event: Ints, mask: int) -> Bools:
    """Points at which any of the events of ``mask`` happened."""
    out = np.empty(len(event), np.bool_)
    for i in range(len(event)):
        out[i] = (event[i] & mask) != 0
    return out


@kernel
def _any_of_run(mask: Bools, offsets: Ints, without: int) -> Bools:
    """Whether a run has a marked row, so many at its end aside."""
    n = len(offsets) - 1
    out = np.zeros(n, np.bool_)
    for run in range(n):
        for row in range(offsets[run], offsets[run + 1] - without):
            if mask[row]:
                out[run] = True
                break
    return out


@kernel
def _count_of_run(mask: Bools, offsets: Ints) -> NDArray[np.int32]:
    n = len(offsets) - 1
    out = np.zeros(n, np.int32)
    for run in range(n):
        found = 0
        for row in range(offsets[run], offsets[run + 1]):
            found += mask[row]
        out[run] = found
    return out


@kernel
def _offsets_of_runs(offsets: Ints, numbers: Ints) -> NDArray[np.int64]:
    out = np.zeros(len(numbers) + 1, np.int64)
    for run in range(len(numbers)):
        number = numbers[run]
        out[run + 1] = out[run] + offsets[number + 1] - offsets[number]
    return out


@kernel
def _rows_of_runs(starts: Ints, offsets: Ints) -> NDArray[np.int64]:
    out = np.empty(offsets[len(offsets) - 1], np.int64)
    for run in range(len(starts)):
        begin = offsets[run]
        start = starts[run]
        for row in range(begin, offsets[run + 1]):
            out[row] = start + row - begin
    return out


@kernel
def number_rays(bits: NDArray[np.uint8], first: int, out: NDArray[np.int64]) -> None:
    """Numbers, from ``first``, of the rays whose bit is set; bits as `np.packbits` has them."""
    index = 0
    for byte in range(len(bits)):
        value = bits[byte]
        if value == 0:
            continue
        for bit in range(8):
            if value & (128 >> bit):
                out[index] = first + byte * 8 + bit
                index += 1


def match_sequence(
    points: Runs, crossings: Runs | None, operands: Sequence[tuple[bool, Bools]]
) -> Bools:
    """Whether the operands of ``->`` follow one another; the earliest match of each is enough.

    Parameters
    ----------
    points : of the rays
    crossings : on the segment that starts at each point; None where no operand stands on segments
    operands : whether each stands on segments, and its marks of points or crossings

    Returns
    -------
    matched : (n_rays,)

    Raises
    ------
    FormatError
        Marks are not as many as points or crossings.
    """
    if crossings is not None and len(crossings) != points.n_rows:
        raise FormatError(f"crossings of {len(crossings)} points, not of {points.n_rows}")
    for on_segments, mask in operands:
        (crossings if on_segments and crossings is not None else points)._marks(mask)
    masks = [mask for _, mask in operands]
    begins = np.concatenate(([0], np.cumsum([len(mask) for mask in masks])))[:-1]
    return _match_sequence(
        points.offsets,
        np.array([on_segments for on_segments, _ in operands]),
        np.concatenate(masks),
        begins,
        np.empty(0, np.int64) if crossings is None else crossings.offsets,
    )


@kernel
def _match_sequence(
    offsets: Ints,
    is_detector: Bools,
    masks: Bools,
    point_rows: Ints,
    crossing_offsets: Ints,
) -> Bools:
    """As `match_sequence`.

    Parameters
    ----------
    is_detector : (n_operands,), the operand stands on segments
    masks : (n_cells,) marks of all operands, one after the other
    point_rows : (n_operands,) where the marks of each operand begin in ``masks``
    """
    n_operands = len(is_detector)
    out = np.zeros(len(offsets) - 1, np.bool_)
    for ray in range(len(offsets) - 1):
        wanted = 0
        row = offsets[ray]
        end = offsets[ray + 1]
        while row < end and wanted < n_operands:
            # One point serves one operand.
            if not is_detector[wanted] and masks[point_rows[wanted] + row]:
                wanted += 1
            # Crossings of the segment that starts here, in order.
            if wanted < n_operands and is_detector[wanted]:
                for crossing in range(crossing_offsets[row], crossing_offsets[row + 1]):
                    if (
                        wanted < n_operands
                        and is_detector[wanted]
                        and masks[point_rows[wanted] + crossing]
                    ):
                        wanted += 1
            row += 1
        out[ray] = wanted == n_operands
    return out
