"""Detector results: additive sums per cell and channel, a cache of what the descriptors say."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.chunks import Chunk, MapFile
from raymap.bytes.layout import DETECTOR
from raymap.bytes.streams import StreamSet
from raymap.encoding.pathstreams import check_amounts
from raymap.jit.scratch import lazy_zeros
from raymap.model.directory import Directory
from raymap.model.errors import FormatError

__all__ = ["DetectorResult", "pack_result", "read_result"]

_SPARSE = 8
"""Where fewer than one in so many cells were lit, only those are stored."""

_META = struct.Struct("<IIQQIII")


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectorResult:
    """What one detector counted over some portions.

    Attributes
    ----------
    detector, channel_set : indices
    first_portion, end_portion : the portions covered, end excluded
    sums, sums2 : (cells_v, cells_u, n_channels) float64, unnormalised Σ w·c and Σ (w·c)²
    """

    detector: int
    channel_set: int
    first_portion: int
    end_portion: int
    sums: NDArray[np.float64]
    sums2: NDArray[np.float64]


def pack_result(result: DetectorResult) -> list[Any]:
    """A detector result chunk as buffers."""
    meta = _META.pack(
        result.detector,
        result.channel_set,
        result.first_portion,
        result.end_portion,
        *result.sums.shape,
    )
    streams = StreamSet()
    sums, sums2 = (array.reshape(-1, array.shape[2]) for array in (result.sums, result.sums2))
    lit = _lit_cells(sums)
    if _SPARSE * len(lit) < len(sums):
        streams.add("cells", lit.astype(np.uint32), keep=True)
        sums, sums2 = _rows(sums, lit), _rows(sums2, lit)
    streams.add("sums", sums.reshape(-1))
    streams.add("sums2", sums2.reshape(-1))
    return streams.chunk(DETECTOR, meta)


def read_result(
    file: MapFile, chunk: Chunk, directory: Directory, channels: list[int], *, data: bool = True
) -> DetectorResult:
    """A detector result, checked against the directory; without ``data`` the arrays are empty.

    Raises
    ------
    FormatError
        The chunk is damaged or does not fit the detector.
    """
    if len(chunk.header.meta) != _META.size:
        raise FormatError("detector result has a header of the wrong size")
    detector, channel_set, first, end, *shape = _META.unpack(chunk.header.meta)
    if detector >= len(directory.detectors) or channel_set >= len(channels) or first > end:
        raise FormatError("detector result names a detector or channel set that does not exist")
    cells = directory.detectors[detector].cells
    if tuple(shape) != (cells[1], cells[0], channels[channel_set]):
        raise FormatError("detector result has another size than its detector")
    sums, sums2 = _arrays(file, chunk, shape) if data else (np.empty((0, 0, 0)),) * 2
    return DetectorResult(
        detector=detector,
        channel_set=channel_set,
        first_portion=first,
        end_portion=end,
        sums=sums,
        sums2=sums2,
    )


def _arrays(
    file: MapFile, chunk: Chunk, shape: list[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both sums, all cells of them."""
    n_cells, n_channels = shape[0] * shape[1], shape[2]
    if all(entry.name != "cells" for entry in chunk.header.streams):
        n = n_cells * n_channels
        first, second = (_sums(file, chunk, name, n) for name in ("sums", "sums2"))
        return first.reshape(shape), second.reshape(shape)
    cells = file.column(chunk, "cells", None, np.int64)
    rising = np.all(np.diff(cells) > 0) and (not len(cells) or 0 <= cells[0] <= cells[-1] < n_cells)
    if not rising:
        raise FormatError("detector result names cells that do not exist, or not in order")
    n = len(cells) * n_channels
    whole = []
    for name in ("sums", "sums2"):
        array = lazy_zeros((n_cells, n_channels))
        array[cells] = _sums(file, chunk, name, n).reshape(-1, n_channels)
        whole.append(array.reshape(shape))
    return whole[0], whole[1]


def _sums(file: MapFile, chunk: Chunk, name: str, n: int) -> NDArray[np.float64]:
    column: NDArray[np.float64] = file.column(chunk, name, n, np.float64)
    check_amounts("sums of a detector", column)
    return column


def _rows(array: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """The rows of some cells."""
    return np.asarray(array[cells])


def _lit_cells(sums: NDArray[np.float64]) -> NDArray[np.int64]:
    """Rows in which anything was counted."""
    lit = np.zeros(len(sums), np.bool_)
    for channel in range(sums.shape[1]):
        lit |= sums[:, channel] != 0.0
    return np.flatnonzero(lit)
