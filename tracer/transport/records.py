"""One record of a block."""

from __future__ import annotations

import math
from typing import NamedTuple

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

__all__ = ["ENDING", "Record", "RecordColumns", "whole", "write_record", "write_words"]

ENDING = int(
    Event.SURFACE_ABSORPTION
    | Event.VOLUME_ABSORPTION
    | Event.LEFT_SCENE
    | Event.DEPTH_LIMIT
    | Event.ROULETTE_KILL
    | Event.GEOMETRY_ERROR
)
"""Events of which the last record of a ray has exactly one."""


class RecordColumns(NamedTuple):
    """Where records are written, columns of `tracer.transport.buffers.Buffers`."""

    words: I32
    real: NDArray[np.float32]
    owners: I32


class Record(NamedTuple):
    """A point of a ray: place, normal, what was met and what happened, the medium and the colour
    code from there on, the ray's number in the block."""

    x: float
    y: float
    z: float
    nx: float
    ny: float
    nz: float
    object: int
    triangle: int
    event: int
    medium: int
    code: int
    ray: int


@inline_kernel
def write_record(columns: RecordColumns, r: int, s: Record) -> None:
    """Write record ``r``."""
    p, q, n = whole(s.nx), whole(s.ny), whole(s.nz)
    write_words(
        columns, r, s.x, s.y, s.z, (p & 0xFFFF) | (q << 16), (n & 0xFFFF) | (s.object << 16),
        s.triangle, s.event, s.medium, s.code, s.ray | COUNTED if s.event & ENDING != 0 else s.ray,
    )  # fmt: skip


@inline_kernel
def whole(component: float) -> int:
    """Component of a normal as records have it."""
    return np.int64(np.int32(math.floor(component * 32767.0 + 0.5)))  # type: ignore[return-value]


@inline_kernel
def write_words(
    columns: RecordColumns, r: int, x: float, y: float, z: float, normal_xy: int, normal_z: int,
    triangle: int, event: int, medium: int, code: int, owner: int,
) -> None:  # fmt: skip
    """Write record ``r`` of a normal (and object) that is packed already."""
    words, real, row = columns.words, columns.real, unsigned(r)
    real[row, X], real[row, Y], real[row, Z] = x, y, z
    words[row, NORMAL_XY] = normal_xy
    words[row, NORMAL_Z] = normal_z
    words[row, TRIANGLE] = triangle
    words[row, EVENT] = event
    words[row, R_MEDIUM] = medium
    words[row, R_CODE] = code
    columns.owners[row] = owner
    words[row, COUNT] = 0
    words[row, CHAIN] = -1
