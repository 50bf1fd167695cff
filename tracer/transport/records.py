"""One record of a block."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, unsigned
from raymap.jit.types import I32
from raymap.model.events import Event
from tracer.transport.buffers import (
    CHAIN,
    COUNT,
    COUNTED,
    EVENT,
    NORMAL_XY,
    NORMAL_Z,
    R_CODE,
    R_MEDIUM,
    TRIANGLE,
    X,
    Y,
    Z,
)

__all__ = ["ENDING", "whole", "write_record", "write_words"]

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
    words: I32, real: NDArray[np.float32], owners: I32, r: int, x: float, y: float, z: float,
    nx: float, ny: float, nz: float, obj: int, triangle: int, event: int, medium: int, code: int,
    ray: int,
) -> None:  # fmt: skip
    """Write record ``r``."""
    p, q, s = whole(nx), whole(ny), whole(nz)
    write_words(
        words, real, owners, r, x, y, z, (p & 0xFFFF) | (q << 16), (s & 0xFFFF) | (obj << 16),
        triangle, event, medium, code, ray | COUNTED if event & ENDING != 0 else ray,
    )  # fmt: skip


@inline_kernel
def whole(component: float) -> int:
    """Component of a normal as records have it."""
    return np.int64(np.int32(math.floor(component * 32767.0 + 0.5)))  # type: ignore[return-value]


@inline_kernel
def write_words(
    words: I32, real: NDArray[np.float32], owners: I32, r: int, x: float, y: float, z: float,
    normal_xy: int, normal_z: int, triangle: int, event: int, medium: int, code: int, owner: int,
) -> None:  # fmt: skip
    """Write record ``r`` of a normal (and object) that is packed already."""
    row = unsigned(r)
    real[row, X], real[row, Y], real[row, Z] = x, y, z
    words[row, NORMAL_XY] = normal_xy
    words[row, NORMAL_Z] = normal_z
    words[row, TRIANGLE] = triangle
    words[row, EVENT] = event
    words[row, R_MEDIUM] = medium
    words[row, R_CODE] = code
    owners[row] = owner
    words[row, COUNT] = 0
    words[row, CHAIN] = -1
