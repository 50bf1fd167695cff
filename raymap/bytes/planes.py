"""Byte planes: byte k of all elements stands together; high bytes repeat, low ones do not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel

__all__ = ["join_coordinate", "join_planes", "split_planes", "split_positions"]


@lean_kernel
def _split2(values: NDArray[np.uint16], planes: NDArray[np.uint8]) -> None:
    low, high = planes[0], planes[1]
    for i in range(values.size):
        value = values[i]
        low[i] = np.uint8(value)
        high[i] = np.uint8(value >> 8)


@lean_kernel
def _split4(values: NDArray[np.uint32], planes: NDArray[np.uint8]) -> None:
    p0, p1, p2, p3 = planes[0], planes[1], planes[2], planes[3]
    for i in range(values.size):
        value = values[i]
        p0[i] = np.uint8(value)
        p1[i] = np.uint8(value >> 8)
        p2[i] = np.uint8(value >> 16)
        p3[i] = np.uint8(value >> 24)


@lean_kernel
def _join2(low: NDArray[np.uint8], high: NDArray[np.uint8], values: NDArray[np.uint16]) -> None:
    for i in range(values.size):
        values[i] = np.uint16(low[i]) | np.uint16(np.uint16(high[i]) << np.uint16(8))


@lean_kernel
def _join4(
    p0: NDArray[np.uint8],
    p1: NDArray[np.uint8],
    p2: NDArray[np.uint8],
    p3: NDArray[np.uint8],
    values: NDArray[np.uint32],
) -> None:
    for i in range(values.size):
        values[i] = (
            np.uint32(p0[i])
            | (np.uint32(p1[i]) << np.uint32(8))
            | (np.uint32(p2[i]) << np.uint32(16))
            | (np.uint32(p3[i]) << np.uint32(24))
        )


@lean_kernel
def _split_points(bits: NDArray[np.uint32], planes: NDArray[np.uint8]) -> None:
    n = planes.shape[1]
    for axis in range(3):
        p0, p1 = planes[4 * axis], planes[4 * axis + 1]
        p2, p3 = planes[4 * axis + 2], planes[4 * axis + 3]
        for i in range(n):
            value = bits[3 * i + axis]
            p0[i] = np.uint8(value)
            p1[i] = np.uint8(value >> 8)
            p2[i] = np.uint8(value >> 16)
            p3[i] = np.uint8(value >> 24)


def split_positions(position: NDArray[np.float32], planes: NDArray[np.uint8]) -> None:
    """Write the byte planes of points, (12, n): those of x first, least significant first."""
    points = np.ascontiguousarray(position, np.float32)
    _split_points(points.reshape(-1).view(np.uint32), planes)


def split_planes(values: NDArray[Any], planes: NDArray[np.uint8]) -> None:
    """Write the byte planes of a contiguous array, least significant first.

    Parameters
    ----------
    values : (n,) of any little-endian type of 1, 2, 4 or 8 bytes
    planes : (itemsize, n) out
    """
    size = values.dtype.itemsize
    if size == 2:
        _split2(values.view(np.uint16), planes)
    elif size == 4:
        _split4(values.view(np.uint32), planes)
    else:
        planes[:] = values.view(np.uint8).reshape(-1, size).T


def join_planes(planes: Sequence[NDArray[np.uint8]], dtype: np.dtype[Any]) -> NDArray[Any]:
    """The array whose byte planes are given; the inverse of `split_planes`."""
    n = planes[0].size
    values = np.empty(n, dtype)
    if len(planes) == 2:
        _join2(planes[0], planes[1], values.view(np.uint16))
    elif len(planes) == 4:
        _join4(planes[0], planes[1], planes[2], planes[3], values.view(np.uint32))
    else:
        interleaved = values.view(np.uint8).reshape(n, len(planes))
        for number, plane in enumerate(planes):
            interleaved[:, number] = plane
    return values


@lean_kernel
def join_coordinate(
    p0: NDArray[np.uint8],
    p1: NDArray[np.uint8],
    p2: NDArray[np.uint8],
    p3: NDArray[np.uint8],
    axis: int,
    bits: NDArray[np.uint32],
) -> None:
    """Write one coordinate of points (n, 3), given as bits, from its byte planes."""
    for i in range(p0.size):
        bits[i, axis] = (
            np.uint32(p0[i])
            | (np.uint32(p1[i]) << np.uint32(8))
            | (np.uint32(p2[i]) << np.uint32(16))
            | (np.uint32(p3[i]) << np.uint32(24))
        )
