"""Arrays that a thread uses again from portion to portion: fresh pages cost more than the sums."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["scratch"]

_KEPT_BYTES = 2**26
_local = threading.local()


def scratch(name: str, n: int, dtype: Any) -> NDArray[Any]:
    """An array of n elements of any content, the thread's own under this name.

    It is valid until the thread asks for the name again, so nothing that outlives the encoding of
    a portion may refer to it. Very long arrays are fresh ones.
    """
    wanted = np.dtype(dtype)
    size = n * wanted.itemsize
    if size > _KEPT_BYTES:
        return np.empty(n, wanted)
    kept: dict[str, NDArray[np.uint8]] = _local.__dict__.setdefault("arrays", {})
    if name not in kept or kept[name].size < size:
        kept[name] = np.empty(size + size // 4, np.uint8)
    return kept[name][:size].view(wanted)
