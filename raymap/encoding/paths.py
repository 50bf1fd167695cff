"""Path dictionaries: the different itineraries of many rays, each kept once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MergedPaths", "PathDictionary"]


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
    detector_offsets : (n_points + 1,) int64, crossings on the segment that starts at the point
    detector : (n_crossings,) int16
    registered : (n_crossings,) bool
    rays : (n_paths,) int64
    sum_w, sum_w2 : (n_paths,) float64, unnormalised sums of weight and weight²
    sum_wc : per channel set, (n_paths, n_channels) float64, sum of weight x colour at the ray's end
    sum_wy2 : (n_paths,) float64, unnormalised sum of (weight x worth of the light at the ray's
        end)² (see `raymap.optics.photometry`) in maps in lumen; None in watt, and where it is not
        kept
    grouped : the rays carry an ``emission`` column, several rays may stem from one emission.
        ``sum_w2`` and ``sum_wy2`` then add up per emission first, within each path; the standard
        error of several paths together needs the rays.
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
    sum_wy2: NDArray[np.float64] | None = None
    grouped: bool = False

    @property
    def n_paths(self) -> int:
        return len(self.source)

    @property
    def n_points(self) -> int:
        return int(self.offsets[-1])

    @property
    def n_crossings(self) -> int:
        return int(self.detector_offsets[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class MergedPaths:
    """The path dictionary of a whole map and where each portion's paths stand in it.

    Attributes
    ----------
    paths : counts and sums over all portions that have a dictionary
    local_to_global : per portion, (n_local,) int32, or None where the portion has plain columns
    """

    paths: PathDictionary
    local_to_global: list[NDArray[np.int32] | None]
