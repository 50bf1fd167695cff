"""Sums of paths, computed from rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.rows import squares_by_emission
from raymap.optics.photometry import Photometry

__all__ = ["PathSums", "sums_of_paths"]

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PathSums:
    """Of the paths of a portion: unnormalised, as in `raymap.encoding.paths.PathDictionary`."""

    weight: F64
    squares: F64
    colors: F64
    worth_squares: F64 | None


def sums_of_paths(
    numbers: Any, n_paths: int, weight: F64, shares: F64, portion: Any, light: Photometry
) -> PathSums:
    """Sums of rays by their path.

    Parameters
    ----------
    numbers : (n_rays,) path of each
    weight, shares : (n_rays,) and (n_rays, n_channels) of light at the ends of rays
    portion : tells sources and emissions
    """
    emission = portion.column("emission") if portion.grouped else None
    source = portion.column("source")
    lit = weight[:, None] * shares
    worth_squares = None
    if light.changes:
        worth = weight * _worth(light, source, shares)
        worth_squares = squares_by_emission(numbers, worth, emission, n_paths)
    return PathSums(
        np.bincount(numbers, weight, n_paths).astype(np.float64),
        squares_by_emission(numbers, weight, emission, n_paths),
        np.stack([np.bincount(numbers, column, n_paths) for column in lit.T], axis=1),
        worth_squares,
    )


def _worth(light: Photometry, source: Any, shares: F64) -> F64:
    """(n,) Y(c) / Y(c0) of light of sources."""
    seen = shares @ light.efficacy
    return np.where(light.known[source], seen / light.emitted_efficacy[source], 1.0)
