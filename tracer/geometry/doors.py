"""Signatures by which the engine calls the functions of shapes of other distributions."""

from __future__ import annotations

import numpy as np

from raymap.jit.compiling import Door

__all__ = ["HIT", "NORMAL"]

_POINT = (0.0, 0.0, 0.0)

HIT = Door(0.0, (np.zeros(1), *_POINT, *_POINT, True))
"""``hit(own, x, y, z, dx, dy, dz, leaves) -> t``: the distance, more than 0, to the nearest point
at which a ray from (x, y, z) along a unit vector meets the shape; 0 or less where it meets none.
With ``leaves`` the ray starts on the shape: the root that its start is does not count, others do.
"""

NORMAL = Door((0.0, 0.0, 0.0), (np.zeros(1), *_POINT))
"""``normal(own, x, y, z) -> nx, ny, nz``: the outward unit normal at a point on the shape."""
