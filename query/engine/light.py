"""The light that detectors were met by, ray by ray."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.optics.photometry import Photometry

__all__ = ["light_at", "records_at"]

Floats = NDArray[np.float64]


def records_at(portion: Any, descriptors: NDArray[np.int64]) -> NDArray[np.int64]:
    """Records where the segments start that met a detector, by the rows of their descriptors."""
    first, counts = portion.column("first_descriptor"), portion.column("descriptor_count")
    met = np.flatnonzero(counts)
    records: NDArray[np.int64] = met[np.searchsorted(first[met], descriptors, side="right") - 1]
    return records


def light_at(
    portion: Any,
    light: Photometry,
    rays: NDArray[Any],
    records: NDArray[Any],
    *,
    whole: bool = True,
) -> Floats:
    """(n, n_channels) watt by channel on segments, of a unit of radiant flux per emitted ray.

    Parameters
    ----------
    light : of the map that is asked
    rays, records : (n,) rows of the portion
    whole : as of `raymap.file.stored.StoredPortion.carried`
    """
    weight, shares = portion.carried(rays, records, whole=whole)
    return np.asarray(weight[:, None] * light.amounts(shares))
