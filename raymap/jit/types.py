"""Types of what compiled functions take, as type checkers see them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["F64", "I32", "I64", "Integer"]

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Integer = int | np.integer
