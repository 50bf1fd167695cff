"""Detector results: additive sums per cell and channel, a cache of what the descriptors say."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.chunks import Chunk, MapFile
from raymap.directory import Directory
from raymap.errors import FormatError
from raymap.layout import DETECTOR, pack_chunk_header
from raymap.streams import StreamSet

__all__ = ["DetectorResult", "pack_result", "read_result"]

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
    streams.add("sums", result.sums.reshape(-1))
    streams.add("sums2", result.sums2.reshape(-1))
    return [pack_chunk_header(DETECTOR, meta, streams.entries), *streams.buffers]


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
    n = int(np.prod(shape, dtype=np.int64)) if data else 0
    empty = np.empty((0, 0, 0))
    return DetectorResult(
        detector=detector,
        channel_set=channel_set,
        first_portion=first,
        end_portion=end,
        sums=file.column(chunk, "sums", n, np.float64).reshape(shape) if data else empty,
        sums2=file.column(chunk, "sums2", n, np.float64).reshape(shape) if data else empty,
    )
