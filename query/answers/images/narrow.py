"""Numbers in float32, as files hold them that others read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import RayMapError

__all__ = ["narrow"]


def narrow(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """Values in float32.

    Raises
    ------
    RayMapError
        One of them is larger than that holds.
    """
    if np.any(np.abs(values) > np.finfo(np.float32).max):
        raise RayMapError(
            "the file's format holds no numbers beyond 3.4e38, and the flux of a source or a "
            "weight of this map is one; write .npy or .csv where these will do"
        )
    return values.astype(np.float32)
