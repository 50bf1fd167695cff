"""One record of a block."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.events import Event
from raymap.kernels import inline_kernel, unsigned
from tracer.engine.buffers import (
    CHAIN,
    COUNT,
    EVENT,
    NORMAL_XY,
    NORMAL_Z,
    R_CODE,
    R_MEDIUM,
    R_RAY,
    TRIANGLE,
    X,
    Y,
    Z,
)
from tracer.scene.arrays import I32

__all__ = ["ENDING", "write_record"]

ENDING = int(
    Event.SURFACE_ABSORPTION
    | Event.VOLUME_ABSORPTION
    | Event.LEFT_SCENE
    | Event.DEPTH_LIMIT
    | Event.ROULETTE_KILL
    | Event.GEOMETRY_ERROR
)
"""Events of which the last record of a ray has exactly one."""


@inline_kernel
def write_record(
    words: I32, real: NDArray[np.float32], r: int, x: float, y: float, z: float, nx: float,
    ny: float, nz: float, obj: int, triangle: int, event: int, medium: int, code: int,
    ray: int,
) -> None:  # fmt: skip
    """Write record ``r``."""
    row = unsigned(r)
    real[row, X], real[row, Y], real[row, Z] = x, y, z
    p = np.int64(math.floor(nx * 32767.0 + 0.5))
    q = np.int64(math.floor(ny * 32767.0 + 0.5))
    s = np.int64(math.floor(nz * 32767.0 + 0.5))
    words[row, NORMAL_XY] = (p & 0xFFFF) | (q << 16)
    words[row, NORMAL_Z] = (s & 0xFFFF) | (obj << 16)
    words[row, TRIANGLE] = triangle
    words[row, EVENT] = event
    words[row, R_MEDIUM] = medium
    words[row, R_CODE] = code
    words[row, R_RAY] = ray
    words[row, COUNT] = 0
    words[row, CHAIN] = -1
