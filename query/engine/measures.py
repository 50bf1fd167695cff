"""Compiled measures of rays that need positions: lengths and angles of incidence."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel

__all__ = ["incidence_angles", "optical_lengths", "path_lengths"]

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]


@kernel
def _distance(position: NDArray[np.float32], row: int) -> float:
    """Length of the segment that starts at a row."""
    here, there = np.uint64(row), np.uint64(row + 1)
    dx = float(position[there, 0]) - float(position[here, 0])
    dy = float(position[there, 1]) - float(position[here, 1])
    dz = float(position[there, 2]) - float(position[here, 2])
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def path_lengths(
    position: NDArray[np.float32], starts: Ints, n_points: Ints, left: NDArray[np.bool_]
) -> Floats:
    """Sum of the segments of each ray [scene units], without the last one of a ray that left.

    Parameters
    ----------
    position : (n_records, 3) float32
    starts, n_points : (n_rays,), first record and number of records of each ray
    left : (n_rays,), the ray left the scene
    """
    out = np.zeros(len(starts))
    for ray in range(len(starts)):
        total = 0.0
        end = starts[ray] + n_points[ray] - 1 - left[ray]
        for row in range(starts[ray], end):
            total += _distance(position, row)
        out[ray] = total
    return out


@kernel
def optical_lengths(
    position: NDArray[np.float32],
    starts: Ints,
    n_points: Ints,
    left: NDArray[np.bool_],
    medium: Ints,
    medium_offsets: Ints,
    color: Ints,
    channels: NDArray[np.bool_],
    index: Floats,
) -> Floats:
    """Sum of refractive index x length of each ray [scene units]; NaN where it is undefined.

    Parameters
    ----------
    medium : (n_points,) of the rays one after the other; ``medium_offsets`` : (n_rays + 1,)
    color : (n_rays,), row of ``channels`` that says in which channels the light is
    channels : (n_colors, n_channels) bool
    index : (n_media, n_channels); undefined where the channels of a ray disagree
    """
    out = np.zeros(len(starts))
    n_channels = channels.shape[1]
    for ray in range(len(starts)):
        total = 0.0
        for step in range(n_points[ray] - 1 - left[ray]):
            which = medium[medium_offsets[ray] + step]
            n = np.nan
            if 0 <= which < index.shape[0]:
                # All channels with light must agree on the index.
                seen = False
                for channel in range(n_channels):
                    if channels[color[ray], channel]:
                        if seen and index[which, channel] != n:
                            n = np.nan
                            break
                        n = index[which, channel]
                        seen = True
            total += n * _distance(position, starts[ray] + step)
        out[ray] = total
    return out


@kernel
def incidence_angles(
    position: NDArray[np.float32], normal: NDArray[np.int16], records: Ints
) -> Floats:
    """Angle between the arriving ray and the normal [deg]; NaN where either has no length.

    Parameters
    ----------
    position : (n_records, 3) of the portion
    normal : (n, 3) at the records; records : (n,), none of them the first of a ray
    """
    out = np.full(len(records), np.nan)
    for point in range(len(records)):
        row = np.uint64(records[point])
        before = row - np.uint64(1)
        dot = 0.0
        d2 = 0.0
        n2 = 0.0
        for axis in range(3):
            d = float(position[row, axis]) - float(position[before, axis])
            n = float(normal[point, axis])
            dot += d * n
            d2 += d * d
            n2 += n * n
        if d2 > 0.0 and n2 > 0.0:
            cos_i = min(abs(dot) / math.sqrt(d2 * n2), 1.0)
            out[point] = math.degrees(math.acos(cos_i))
    return out
