"""Compiled measures of rays that need positions: lengths and angles of incidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.engine.scans import Runs
from raymap.jit.kernels import kernel
from raymap.model.errors import FormatError

__all__ = ["RayRecords", "incidence_angles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class RayRecords:
    """Rays whose records a portion has; `check` alone makes them.

    Attributes
    ----------
    position : (n_records, 3) float32, of the portion
    starts : (n_rays,) first record of each ray
    points : of each ray, which are its records
    left : (n_rays,) the ray left the scene
    """

    position: NDArray[np.float32]
    starts: Ints
    points: Runs
    left: NDArray[np.bool_]

    @staticmethod
    def check(
        position: NDArray[np.float32], starts: Ints, points: Runs, left: NDArray[np.bool_]
    ) -> RayRecords:
        """Rays that compiled loops may walk along.

        Raises
        ------
        FormatError
            The portion does not have the records of a ray.
        """
        n = len(points)
        if position.shape[1:] != (3,) or not len(starts) == len(left) == n:
            raise FormatError(f"places {position.shape} and {len(starts)} beginnings of {n} rays")
        ends = starts + np.diff(points.offsets)
        if n and (int(starts.min()) < 0 or int(ends.max()) > len(position)):
            raise FormatError("a ray goes on beyond the records of its portion")
        return RayRecords(position, starts, points, left)

    def lengths(self) -> Floats:
        """(n_rays,) sum of the segments [scene units], without the last one of a ray that left."""
        return _path_lengths(self.position, self.starts, self.points.offsets, self.left)

    def optical_lengths(
        self, medium: Ints, color: Ints, channels: NDArray[np.bool_], index: Floats
    ) -> Floats:
        """(n_rays,) sum of refractive index x length [scene units]; NaN where it is undefined.

        Parameters
        ----------
        medium : (n_points,) of the segment that starts at each point
        color : (n_rays,), row of ``channels`` that says in which channels the light is
        channels : (n_colors, n_channels) bool
        index : (n_media, n_channels); undefined where the channels of a ray disagree

        Raises
        ------
        FormatError
            Media or colours are not those of these rays, or a colour is not among the channels.
        """
        if len(medium) != self.points.n_rows or len(color) != len(self.points):
            raise FormatError(f"{len(medium)} media and {len(color)} colours of other rays")
        if len(color) and not 0 <= int(color.min()) <= int(color.max()) < len(channels):
            raise FormatError("a colour code is not in the colour table")
        if index.shape[1:] != channels.shape[1:]:
            raise FormatError(f"refractive indices {index.shape} of {channels.shape[1]} channels")
        return _optical_lengths(
            self.position, self.starts, self.points.offsets, self.left,
            medium, color, channels, index,
        )  # fmt: skip


def incidence_angles(
    position: NDArray[np.float32], normal: NDArray[np.int16], records: Ints
) -> Floats:
    """Angle between the arriving ray and the normal [deg]; NaN where either has no length.

    Parameters
    ----------
    position : (n_records, 3) of the portion
    normal : (n, 3) at the records; records : (n,), none of them the first of a ray

    Raises
    ------
    FormatError
        There is no such record, or none before it.
    """
    if position.shape[1:] != (3,) or normal.shape != (len(records), 3):
        raise FormatError(f"places {position.shape}, normals {normal.shape} of {len(records)}")
    if len(records) and not 0 < int(records.min()) <= int(records.max()) < len(position):
        raise FormatError("a record is not in its portion")
    return _incidence_angles(position, normal, records)


@kernel
def _distance(position: NDArray[np.float32], row: int) -> float:
    """Length of the segment that starts at a row."""
    here, there = np.uint64(row), np.uint64(row + 1)
    dx = float(position[there, 0]) - float(position[here, 0])
    dy = float(position[there, 1]) - float(position[here, 1])
    dz = float(position[there, 2]) - float(position[here, 2])
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def _path_lengths(
    position: NDArray[np.float32], starts: Ints, offsets: Ints, left: NDArray[np.bool_]
) -> Floats:
    out = np.zeros(len(starts))
    for ray in range(len(starts)):
        total = 0.0
        end = starts[ray] + offsets[ray + 1] - offsets[ray] - 1 - left[ray]
        for row in range(starts[ray], end):
            total += _distance(position, row)
        out[ray] = total
    return out


@kernel
def _optical_lengths(
    position: NDArray[np.float32],
    starts: Ints,
    offsets: Ints,
    left: NDArray[np.bool_],
    medium: Ints,
    color: Ints,
    channels: NDArray[np.bool_],
    index: Floats,
) -> Floats:
    out = np.zeros(len(starts))
    n_channels = channels.shape[1]
    for ray in range(len(starts)):
        total = 0.0
        for step in range(offsets[ray + 1] - offsets[ray] - 1 - left[ray]):
            which = medium[offsets[ray] + step]
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
def _incidence_angles(
    position: NDArray[np.float32], normal: NDArray[np.int16], records: Ints
) -> Floats:
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
