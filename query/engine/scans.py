"""Compiled scans over rays and their points: a handful of loops that serve every criterion.

Rays are runs of points: points of ray r are rows ``offsets[r]:offsets[r + 1]``. Nothing is compiled
per criterion; names come as tables over indices whose last entry answers for index -1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel

__all__ = [
    "any_before_last",
    "any_of_ray",
    "count_of_ray",
    "expand_rows",
    "look_up",
    "mark_events",
    "match_sequence",
    "number_rays",
    "ray_offsets",
]

Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]


@kernel
def look_up(table: Bools, index: Ints) -> Bools:
    """Table entry of each index; -1 is the last entry."""
    out = np.empty(len(index), np.bool_)
    last = len(table) - 1
    for i in range(len(index)):
        value = index[i]
        out[i] = table[value] if value >= 0 else table[last]
    return out


@kernel
def mark_events(event: Ints, mask: int) -> Bools:
    """Points at which any of the events of ``mask`` happened."""
    out = np.empty(len(event), np.bool_)
    for i in range(len(event)):
        out[i] = (event[i] & mask) != 0
    return out


@kernel
def any_of_ray(mask: Bools, offsets: Ints) -> Bools:
    """Whether a ray has a marked point."""
    n = len(offsets) - 1
    out = np.zeros(n, np.bool_)
    for ray in range(n):
        for row in range(offsets[ray], offsets[ray + 1]):
            if mask[row]:
                out[ray] = True
                break
    return out


@kernel
def any_before_last(mask: Bools, offsets: Ints) -> Bools:
    """Whether a ray has a marked point before its last one."""
    n = len(offsets) - 1
    out = np.zeros(n, np.bool_)
    for ray in range(n):
        for row in range(offsets[ray], offsets[ray + 1] - 1):
            if mask[row]:
                out[ray] = True
                break
    return out


@kernel
def count_of_ray(mask: Bools, offsets: Ints) -> NDArray[np.int32]:
    """How many marked points a ray has."""
    n = len(offsets) - 1
    out = np.zeros(n, np.int32)
    for ray in range(n):
        found = 0
        for row in range(offsets[ray], offsets[ray + 1]):
            found += mask[row]
        out[ray] = found
    return out


@kernel
def ray_offsets(offsets: Ints, paths: Ints) -> NDArray[np.int64]:
    """Offsets of rays that take these paths, one ray after the other."""
    out = np.zeros(len(paths) + 1, np.int64)
    for ray in range(len(paths)):
        path = paths[ray]
        out[ray + 1] = out[ray] + offsets[path + 1] - offsets[path]
    return out


@kernel
def expand_rows(starts: Ints, offsets: Ints) -> NDArray[np.int64]:
    """Rows of runs that begin at ``starts`` and are as long as the offsets say."""
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
    place = 0
    for byte in range(len(bits)):
        value = bits[byte]
        if value == 0:
            continue
        for bit in range(8):
            if value & (128 >> bit):
                out[place] = first + byte * 8 + bit
                place += 1


@kernel
def match_sequence(
    offsets: Ints,
    is_detector: Bools,
    masks: Bools,
    point_rows: Ints,
    meeting_offsets: Ints,
) -> Bools:
    """Whether the operands of ``->`` follow one another; the earliest match of each is enough.

    Parameters
    ----------
    offsets : (n_rays + 1,)
    is_detector : (n_operands,), the operand stands on segments
    masks : (n_cells,) marks of all operands, one after the other
    point_rows : (n_operands,) where the marks of each operand begin in ``masks``
    meeting_offsets : (n_points + 1,) meetings on the segment that starts at each point
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
            # Meetings of the segment that starts here, in order.
            if wanted < n_operands and is_detector[wanted]:
                for meeting in range(meeting_offsets[row], meeting_offsets[row + 1]):
                    if (
                        wanted < n_operands
                        and is_detector[wanted]
                        and masks[point_rows[wanted] + meeting]
                    ):
                        wanted += 1
            row += 1
        out[ray] = wanted == n_operands
    return out
