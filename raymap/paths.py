"""Path dictionaries: the different itineraries of many rays, each kept once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PathDictionary"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PathDictionary:
    """Different paths and how much light took them.

    Attributes
    ----------
    source : (n_paths,) int16
    offsets : (n_paths + 1,) int64, points of path p are rows offsets[p]:offsets[p + 1]
    object : (n_points,) int16
    face : (n_points,) int32, face index (row of `Directory.faces`), -1 none
    event : (n_points,) int32
    medium : (n_points,) int16
    detector_offsets : (n_points + 1,) int64, meetings on the segment that starts at the point
    detector : (n_meetings,) int16
    registered : (n_meetings,) bool
    rays : (n_paths,) int64
    sum_w, sum_w2 : (n_paths,) float64, unnormalised sums of weight and weight²
    sum_wc : per channel set, (n_paths, n_channels) float64, sum of weight x colour at the ray's end
    """

    source: NDArray[np.int16]
    offsets: NDArray[np.int64]
    object: NDArray[np.int16]
    face: NDArray[np.int32]
    event: NDArray[np.int32]
    medium: NDArray[np.int16]
    detector_offsets: NDArray[np.int64]
    detector: NDArray[np.int16]
    registered: NDArray[np.bool_]
    rays: NDArray[np.int64]
    sum_w: NDArray[np.float64]
    sum_w2: NDArray[np.float64]
    sum_wc: tuple[NDArray[np.float64], ...]

    @property
    def n_paths(self) -> int:
        return len(self.source)
