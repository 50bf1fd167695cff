"""Colours of segments: codes, runs of one code along a ray, and the table of mixed colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import lean_kernel
from raymap.schema import COLOR_SCALE

__all__ = ["color_runs", "colors_of_codes", "rebuild_codes", "runs_of_codes"]


@lean_kernel
def color_runs(
    offsets: NDArray[np.int64],
    codes: NDArray[np.int32],
    first: NDArray[np.int32],
    changes: NDArray[np.int32],
    lengths: NDArray[np.int32],
    later: NDArray[np.int32],
) -> int:
    """Split the codes of each ray into runs; returns the number of changes, -1 without room.

    Parameters
    ----------
    first : (n_rays,) out, code of each ray's first record
    changes : (n_rays,) out, how often the code changes along the ray
    lengths, later : out, per change the records since the last one, and the new code
    """
    n = 0
    for ray in range(first.size):
        start = offsets[ray]
        code = codes[np.uint64(start)]
        first[ray] = code
        before = n
        for i in range(start + 1, offsets[ray + 1]):
            here = codes[np.uint64(i)]
            if here != code:
                if n == later.size:
                    return -1
                code = here
                lengths[np.uint64(n)] = i - start
                later[np.uint64(n)] = code
                start = i
                n += 1
        changes[ray] = n - before
    return n


@lean_kernel
def rebuild_codes(
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    changes: NDArray[np.int32],
    lengths: NDArray[np.int32],
    later: NDArray[np.int32],
    codes: NDArray[np.int32],
) -> bool:
    """The inverse of `color_runs`; false where the runs do not fit the rays."""
    n = 0
    for ray in range(first.size):
        start = offsets[ray]
        end = offsets[ray + 1]
        code = first[ray]
        if changes[ray] < 0 or changes[ray] > later.size - n:
            return False
        for _ in range(changes[ray]):
            length = lengths[n]
            if length <= 0 or length >= end - start:
                return False
            for i in range(start, start + length):
                codes[i] = code
            start += length
            code = later[n]
            n += 1
        for i in range(start, end):
            codes[i] = code
    return n == later.size


@lean_kernel
def colors_of_codes(
    codes: NDArray[np.int32], table: NDArray[np.uint16], out: NDArray[np.uint16]
) -> None:
    """Write the channels of each code; a code below n_channels is light of that channel alone."""
    n_channels = out.shape[1]
    for i in range(codes.size):
        code = codes[i]
        if code < n_channels:
            for channel in range(n_channels):
                out[i, channel] = 0
            out[i, code] = COLOR_SCALE
        else:
            for channel in range(n_channels):
                out[i, channel] = table[code - n_channels, channel]


def runs_of_codes(
    offsets: NDArray[np.int64], codes: NDArray[np.int32]
) -> tuple[NDArray[np.int32], ...] | None:
    """(first, changes, lengths, later) of the codes, None where they change too often to pay."""
    n_rays = len(offsets) - 1
    room = len(codes) // 2
    first = np.empty(n_rays, np.int32)
    changes = np.empty(n_rays, np.int32)
    lengths = np.empty(room, np.int32)
    later = np.empty(room, np.int32)
    n = color_runs(offsets, codes, first, changes, lengths, later)
    return None if n < 0 else (first, changes, lengths[:n], later[:n])
