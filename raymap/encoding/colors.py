"""Colours of segments: codes, runs of one code along a ray, and the table of mixed colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from raymap.model.errors import FormatError
from raymap.model.schema import COLOR_SCALE

__all__ = ["ColorCodes", "rebuild_codes", "runs_of_codes"]


@dataclass(frozen=True, slots=True, eq=False)
class ColorCodes:
    """Colour codes all of which are channels or rows of the table; `check` alone makes them.

    Attributes
    ----------
    codes : (n,) int32
    table : (n_colors, n_channels) uint16
    """

    codes: NDArray[np.int32]
    table: NDArray[np.uint16]

    @staticmethod
    def check(codes: NDArray[Any], table: NDArray[np.uint16]) -> ColorCodes:
        """Codes that compiled loops may take as rows of this table.

        Raises
        ------
        FormatError
            A code is neither a channel nor a row of the table.
        """
        top = table.shape[1] + len(table)
        if len(codes) and not 0 <= int(codes.min()) <= int(codes.max()) < top:
            raise FormatError("a colour code is not in the colour table")
        return ColorCodes(codes, table)

    def colors(self) -> NDArray[np.uint16]:
        """(n, n_channels), the light of each code."""
        out = np.empty((len(self.codes), self.table.shape[1]), np.uint16)
        _colors_of_codes(self.codes, self.table, out)
        return out

    def summed(
        self, numbers: NDArray[np.uint32], weight: NDArray[np.float32] | None, n_paths: int
    ) -> NDArray[np.float64] | NDArray[np.uint64]:
        """Sum of colour (x weight) per path.

        Parameters
        ----------
        numbers : (n,) path of each ray
        weight : (n,), or None where every ray weighs 1

        Returns
        -------
        sums : (n_paths, n_channels), in units of 1 / COLOR_SCALE and uint64 where no ray has a
            weight

        Raises
        ------
        FormatError
            A ray takes a path that there is not, or has no weight.
        """
        n = len(self.codes)
        if len(numbers) != n or (n and int(numbers.max()) >= n_paths):
            raise FormatError("a ray's path is not in the dictionary")
        if weight is None:
            exact = np.zeros((n_paths, self.table.shape[1]), np.uint64)
            _sum_colors(self.codes, self.table, numbers, exact)
            return exact
        if len(weight) != n:
            raise FormatError(f"{len(weight)} weights of {n} rays")
        sums = np.zeros((n_paths, self.table.shape[1]))
        _sum_weighted_colors(self.codes, self.table, numbers, weight, 1.0 / COLOR_SCALE, sums)
        return sums


@lean_kernel
def _color_runs(
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
    """The inverse of `runs_of_codes`; false where the runs do not fit the rays."""
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
def _colors_of_codes(
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


@lean_kernel
def _sum_colors(
    codes: NDArray[np.int32],
    color_table: NDArray[np.uint16],
    numbers: NDArray[np.uint32],
    sums: NDArray[np.uint64],
) -> None:
    """Add each ray's colour to its path, in units of 1/65535."""
    n_channels = sums.shape[1]
    for ray in range(codes.size):
        code = codes[ray]
        path = numbers[ray]
        if code < n_channels:
            sums[path, code] += np.uint64(COLOR_SCALE)
        else:
            for channel in range(n_channels):
                sums[path, channel] += np.uint64(color_table[code - n_channels, channel])


@lean_kernel
def _sum_weighted_colors(
    codes: NDArray[np.int32],
    color_table: NDArray[np.uint16],
    numbers: NDArray[np.uint32],
    weight: NDArray[np.float32],
    scale: float,
    sums: NDArray[np.float64],
) -> None:
    """Add each ray's weight x colour to its path."""
    n_channels = sums.shape[1]
    for ray in range(codes.size):
        code = codes[ray]
        path = numbers[ray]
        w = np.float64(weight[ray])
        if code < n_channels:
            sums[path, code] += w
        else:
            for channel in range(n_channels):
                sums[path, channel] += w * (scale * color_table[code - n_channels, channel])


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
    n = _color_runs(offsets, codes, first, changes, lengths, later)
    return None if n < 0 else (first, changes, lengths[:n], later[:n])
