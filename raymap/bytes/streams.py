"""One column and its compressed streams: byte planes, zstandard, checksums.

A column of elements of k bytes becomes k streams, one per byte plane, or one stream of whole
elements where these repeat or are few. A plane whose bytes are all equal is stored as that byte; a
plane that a trial shows to be incompressible is stored as it is; the rest goes through zstandard.
A column of no rows has no stream.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

import numpy as np
import xxhash
import zstandard
from numpy.typing import NDArray

from raymap.bytes.layout import STREAM_ENTRY_SIZE, StreamEntry, pack_chunk_header
from raymap.jit.scratch import scratch
from raymap.model.errors import FormatError
from raymap.model.limits import JSON_FLOOR, JSON_PER_BYTE, affordable, may_expand, surplus

__all__ = [
    "CONSTANT",
    "KINDS",
    "STORED",
    "WHOLE",
    "ZSTD",
    "Scope",
    "StreamSet",
    "decode_bytes",
    "decode_column",
    "decode_planes",
    "is_known_type",
    "kind_of",
    "repeats_whole",
    "stream_rows",
]

KINDS: dict[int, np.dtype[Any]] = {
    0: np.dtype("u1"),
    1: np.dtype("i1"),
    2: np.dtype("<u2"),
    3: np.dtype("<i2"),
    4: np.dtype("<u4"),
    5: np.dtype("<i4"),
    6: np.dtype("<u8"),
    7: np.dtype("<i8"),
    8: np.dtype("<f4"),
    9: np.dtype("<f8"),
    10: np.dtype("?"),
    11: np.dtype("<c8"),
    12: np.dtype("<c16"),
}
"""Element types of streams by their code in the stream table."""

STORED, ZSTD, CONSTANT = 0, 1, 2
WHOLE = 255
LEVEL = 1
_TRIAL = 8192
_STRETCH = 4096
_WORTHWHILE = 0.9
_SMALL = 2**15
_FEW = 64
_FEW_BYTES = 2**14
"""Columns of so many bytes are stored whole where the table of their planes would be longer."""
_PATIENT = 9
_BLOCK = 2**17
_MOST_WINDOW = 2**27
_FRAME = bytes.fromhex("28B52FFD A0")
"""Magic number and the descriptor of a frame of one segment whose content size has 4 bytes."""


class Scope(IntEnum):
    """What a row of a stream belongs to."""

    OTHER = 0
    RAY = 1
    RECORD = 2
    DESCRIPTOR = 3
    PATH = 4
    POINT = 5
    CROSSING = 6


_BY_NAME = (Scope.RAY, Scope.RECORD)
"""Scopes of columns that say by their being there that a portion has them, also without rows."""

_local = threading.local()


def _compressor() -> zstandard.ZstdCompressor:
    if not hasattr(_local, "compressor"):
        _local.compressor = zstandard.ZstdCompressor(level=LEVEL)
    return _local.compressor  # type: ignore[no-any-return]


def _decompressor() -> zstandard.ZstdDecompressor:
    if not hasattr(_local, "decompressor"):
        _local.decompressor = zstandard.ZstdDecompressor()
    return _local.decompressor  # type: ignore[no-any-return]


def kind_of(dtype: np.dtype[Any]) -> int:
    """Code of an element type.

    Raises
    ------
    KeyError
        The format has no such element type.
    """
    little = dtype.newbyteorder("<")
    for code, known in KINDS.items():
        if known == little:
            return code
    raise KeyError(f"the format has no element type {dtype}")


def is_known_type(dtype: np.dtype[Any]) -> bool:
    """Whether columns of this type can be stored."""
    return dtype.newbyteorder("<") in KINDS.values()


@dataclass
class StreamSet:
    """Streams of one chunk under construction.

    Attributes
    ----------
    raw : store everything as it is, for debugging
    entries, buffers : stream table and stored bytes, in order
    """

    raw: bool = False
    entries: list[StreamEntry] = field(default_factory=list)
    buffers: list[bytes | NDArray[np.uint8]] = field(default_factory=list)

    @property
    def stored_bytes(self) -> int:
        return sum(entry.stored_size for entry in self.entries)

    def add(
        self,
        name: str,
        values: NDArray[Any],
        scope: Scope = Scope.OTHER,
        *,
        keep: bool = False,
    ) -> None:
        """Encode a column; rows of a matrix stay together, its elements share the planes.

        Parameters
        ----------
        keep : store it also without rows, as its being there says something
        """
        kind = kind_of(values.dtype)
        flat = np.ascontiguousarray(values, KINDS[kind]).reshape(-1)
        if not flat.size and not keep and scope not in _BY_NAME:
            return
        width = int(np.prod(values.shape[1:], dtype=np.int64))
        size = flat.dtype.itemsize
        content = flat.view(np.uint8)
        if self.raw or size > 8 or size == 1 or not flat.size:
            plane = 0 if size == 1 and not self.raw else WHOLE
            codec, stored = (STORED, content) if self.raw else compress_plane(content)
            if stored is content and np.may_share_memory(content, values):
                # The caller may use its column again before the stream is written
                stored = content.copy()
            self._append(name, kind, codec, plane, scope, width, content.size, stored)
            return
        planes = [compress_plane(plane) for plane in _split(flat)]
        if content.size <= _FEW_BYTES:
            codec, stored = compress_plane(content)
            apart = sum(len(each) for _, each in planes) + (size - 1) * STREAM_ENTRY_SIZE
            if len(stored) <= apart:
                kept = content.copy() if stored is content else stored
                self._append(name, kind, codec, WHOLE, scope, width, content.size, kept)
                return
        for plane, (codec, stored) in enumerate(planes):
            # The planes are this thread's scratch
            kept = stored.copy() if isinstance(stored, np.ndarray) else stored
            self._append(name, kind, codec, plane, scope, width, flat.size, kept)

    def add_smallest(self, name: str, values: NDArray[Any]) -> None:
        """Encode a column that is written once, whole or by planes, with more patience."""
        kind = kind_of(values.dtype)
        flat = np.ascontiguousarray(values, KINDS[kind]).reshape(-1)
        if not flat.size:
            return
        width = int(np.prod(values.shape[1:], dtype=np.int64))
        content = flat.view(np.uint8)
        planes = content.reshape(-1, flat.dtype.itemsize).T.copy()
        if self.raw or len(planes) == 1 or _quickly(content) <= sum(map(_quickly, planes)):
            codec, stored = self._patiently(content)
            self._append(name, kind, codec, WHOLE, Scope.OTHER, width, content.size, stored)
            return
        for number, plane in enumerate(planes):
            codec, stored = self._patiently(plane)
            self._append(name, kind, codec, number, Scope.OTHER, width, plane.size, stored)

    def _patiently(self, content: NDArray[np.uint8]) -> tuple[int, bytes | NDArray[np.uint8]]:
        if self.raw:
            return STORED, content.copy()
        if int(content.min()) == int(content.max()):
            return CONSTANT, bytes(content[:1])
        packed = zstandard.ZstdCompressor(level=_PATIENT).compress(content.data)
        return (ZSTD, packed) if len(packed) < content.size else (STORED, content.copy())

    def add_planes(
        self, name: str, dtype: Any, planes: Iterable[NDArray[np.uint8]], scope: Scope
    ) -> None:
        """Encode a column of which the byte planes are there already; they stay as they are."""
        kind = kind_of(np.dtype(dtype))
        for plane, content in enumerate(planes):
            codec, stored = compress_plane(content)
            self._append(name, kind, codec, plane, scope, 1, content.size, stored)

    def add_split(
        self, name: str, column: NDArray[Any], planes: NDArray[np.uint8], scope: Scope
    ) -> None:
        """Encode a column, of which the byte planes are there already, whole or by planes.

        A stretch in the middle is tried: where whole elements repeat, as coordinates do on faces
        across an axis, they are found once and not in every plane.
        """
        if not repeats_whole(column, planes):
            self.add_planes(name, column.dtype, planes, scope)
            return
        content = np.ascontiguousarray(column).view(np.uint8)
        codec, stored = compress_plane(content)
        kind = kind_of(column.dtype)
        self._append(name, kind, codec, WHOLE, scope, 1, content.size, stored)

    def add_sparse(
        self,
        name: str,
        rows: int,
        places: NDArray[np.int32],
        values: NDArray[Any],
        scope: Scope,
    ) -> None:
        """Encode a column of zeros but for a few values at increasing places."""
        kind = kind_of(values.dtype)
        if self.raw or len(places) > _FEW:
            column = scratch("sparse", rows, values.dtype)
            column.fill(0)
            column[places] = values
            self.add(name, column, scope)
            return
        planes = values.view(np.uint8).reshape(len(values), values.itemsize).T
        for plane, content in enumerate(planes):
            there = np.flatnonzero(content)
            if len(there):
                codec, stored = ZSTD, frame_of_zeros(rows, places[there], content[there])
            else:
                codec, stored = CONSTANT, b"\0"
            self._append(name, kind, codec, plane, scope, 1, rows, stored)

    def add_bytes(self, name: str, data: bytes, level: int = 9) -> None:
        """Store opaque bytes (text) under one name."""
        packed = zstandard.ZstdCompressor(level=level).compress(data)
        if (
            self.raw
            or len(packed) >= len(data)
            or len(data) > affordable(len(packed), JSON_FLOOR, JSON_PER_BYTE)
        ):
            self._append(name, 0, STORED, WHOLE, Scope.OTHER, 1, len(data), data)
        else:
            self._append(name, 0, ZSTD, WHOLE, Scope.OTHER, 1, len(data), packed)

    def take(self, other: StreamSet, prefix: str) -> None:
        """Repeat the streams of another chunk under longer names."""
        self.entries += [replace(entry, name=prefix + entry.name) for entry in other.entries]
        self.buffers += other.buffers

    def _append(
        self,
        name: str,
        kind: int,
        codec: int,
        plane: int,
        scope: Scope,
        width: int,
        raw_size: int,
        stored: bytes | NDArray[np.uint8],
    ) -> None:
        digest = xxhash.xxh3_64_intdigest(stored if isinstance(stored, bytes) else stored.data)
        size = len(stored)
        self.entries.append(
            StreamEntry(name, kind, codec, plane, int(scope), width, raw_size, size, digest)
        )
        self.buffers.append(stored)
        if not may_expand(raw_size, size):
            self._store_plainly(len(self.entries) - 1)

    def chunk(self, tag: bytes, meta: bytes = b"", least: int = 0) -> list[Any]:
        """The chunk as buffers to be written one after the other.

        Parameters
        ----------
        least : bytes that it must have, for readers to trust what it declares

        Raises
        ------
        LimitExceeded
            It has more streams than a chunk may have.
        """
        while True:
            missing = max(surplus(self._sizes(), self.stored_bytes), least - self.stored_bytes)
            if missing <= 0:
                break
            # Give up the compression of the smallest stream that makes up for it
            gains = [(e.raw_size - e.stored_size, k) for k, e in enumerate(self.entries)]
            enough = [gain for gain in gains if gain[0] >= missing]
            if not max(gains)[0]:
                break
            self._store_plainly(min(enough)[1] if enough else max(gains)[1])
        return [pack_chunk_header(tag, meta, self.entries), *self.buffers]

    def _sizes(self) -> list[tuple[int, int]]:
        return [(entry.raw_size, entry.stored_size) for entry in self.entries]

    def _store_plainly(self, number: int) -> None:
        """Store the bytes of a stream as they are: it would expand to more than readers trust."""
        entry = self.entries[number]
        stored = self.buffers[number]
        content = decode_bytes(entry, stored if isinstance(stored, bytes) else stored.tobytes())
        data = content if isinstance(content, bytes) else content.tobytes()
        self.entries[number] = replace(
            entry, codec=STORED, stored_size=len(data), hash=xxhash.xxh3_64_intdigest(data)
        )
        self.buffers[number] = data


def compress_plane(content: NDArray[np.uint8]) -> tuple[int, bytes | NDArray[np.uint8]]:
    """Choose the codec of one plane and apply it: (codec, stored bytes)."""
    n = content.size
    if n == 0:
        return STORED, content
    # Store one byte where all are equal; the ends and the middle settle most other planes
    if content[0] == content[-1] == content[n // 2] and int(content.min()) == int(content.max()):
        return CONSTANT, bytes(content[:1])
    # Try two blocks before feeding a long plane to the compressor
    compressor = _compressor()
    if n > 4 * _TRIAL:
        trial = 0
        for start in (n // 3, 2 * n // 3):
            trial += len(compressor.compress(content[start : start + _TRIAL].data))
        if trial > 2 * _TRIAL * _WORTHWHILE:
            return STORED, content
    packed = compressor.compress(content.data)
    return (ZSTD, packed) if len(packed) < n * _WORTHWHILE else (STORED, content)


def _quickly(content: NDArray[np.uint8]) -> int:
    """About how many bytes a stream takes, with its row of the table."""
    return STREAM_ENTRY_SIZE + len(_compressor().compress(content.data))


def repeats_whole(column: NDArray[Any], planes: NDArray[np.uint8]) -> bool:
    """Whether a stretch of whole elements is smaller when compressed than its byte planes."""
    n = len(column)
    if n < _SMALL:
        return False
    compressor = _compressor()
    stretch = slice(n // 2, n // 2 + _STRETCH)
    lowest = len(compressor.compress(planes[0, stretch].data))
    if lowest > _STRETCH // 2:
        return False
    whole = len(compressor.compress(np.ascontiguousarray(column[stretch]).data))
    apart = lowest + sum(len(compressor.compress(plane[stretch].data)) for plane in planes[1:])
    return whole < _WORTHWHILE * apart


def frame_of_zeros(n: int, places: NDArray[np.int32], values: NDArray[np.uint8]) -> bytes:
    """The zstandard frame of n bytes that are zero but for those at the (increasing) places.

    Blocks of one repeated byte between blocks of bytes as they are: nothing of the length n is made
    or searched.
    """
    blocks: list[tuple[int, int, bytes]] = []
    done = 0
    for index, value in zip([*places.tolist(), n], [*values.tolist(), 0], strict=True):
        for start in range(done, index, _BLOCK):
            blocks.append((1, min(_BLOCK, index - start), b"\0"))
        if index < n:
            blocks.append((0, 1, bytes([value])))
        done = index + 1
    frame = [_FRAME, n.to_bytes(4, "little")]
    for number, (kind, size, content) in enumerate(blocks):
        last = number == len(blocks) - 1
        frame += [(last | kind << 1 | size << 3).to_bytes(3, "little"), content]
    return b"".join(frame)


def stream_rows(entry: StreamEntry) -> int:
    """Rows of the column of which the entry is a stream.

    Raises
    ------
    FormatError
        Element type or codec are unknown, or sizes contradict each other.
    """
    dtype = KINDS.get(entry.kind)
    if dtype is None:
        raise FormatError(f"stream {entry.name!r} has unknown element type {entry.kind}")
    unit = entry.width * (dtype.itemsize if entry.plane == WHOLE else 1)
    if unit == 0 or entry.raw_size % unit:
        raise FormatError(f"stream {entry.name!r}: {entry.raw_size} bytes are no whole rows")
    return entry.raw_size // unit


def decode_bytes(entry: StreamEntry, stored: bytes) -> bytes | NDArray[np.uint8]:
    """Check one stream and undo its codec.

    Raises
    ------
    FormatError
        The checksum fails, the codec is unknown or the sizes are not the declared ones.
    """
    if len(stored) != entry.stored_size or xxhash.xxh3_64_intdigest(stored) != entry.hash:
        raise FormatError(f"stream {entry.name!r} fails its checksum")
    if entry.codec == STORED and entry.raw_size == entry.stored_size:
        return stored
    if entry.codec == CONSTANT and entry.stored_size == 1:
        return np.full(entry.raw_size, stored[0], np.uint8)
    if entry.codec == ZSTD:
        try:
            if zstandard.frame_content_size(stored) == entry.raw_size and _is_plain(stored):
                # One frame and nothing behind it, as other readers may not look there
                return _decompressor().decompress(
                    stored, max_output_size=entry.raw_size, allow_extra_data=False
                )
        except zstandard.ZstdError:
            pass
        raise FormatError(
            f"stream {entry.name!r} is no single frame of {entry.raw_size} bytes within the limits"
        )
    raise FormatError(f"stream {entry.name!r}: codec {entry.codec} is unknown or its sizes differ")


def _is_plain(frame: bytes) -> bool:
    """Whether it is no skippable frame, and needs no more memory than its content or the limit.

    A frame of a single segment states no window: its content is all that is kept.
    """
    if frame[:4] != _FRAME[:4]:
        return False
    single_segment = bool(frame[4] & 0x20)
    return single_segment or zstandard.get_frame_parameters(frame).window_size <= _MOST_WINDOW


def decode_planes(
    entries: Sequence[StreamEntry], fetch: Callable[[StreamEntry], bytes], rows: int, dtype: Any
) -> list[NDArray[np.uint8]] | None:
    """The byte planes of a column of numbers; None where it is not stored in planes.

    Raises
    ------
    FormatError
        Damage, or another number of rows.
    """
    wanted = np.dtype(dtype)
    if [entry.plane for entry in entries] != list(range(wanted.itemsize)):
        return None
    if any((KINDS.get(e.kind), e.width, e.raw_size) != (wanted, 1, rows) for e in entries):
        return None
    return [_retyped(np.frombuffer(decode_bytes(e, fetch(e)), np.uint8)) for e in entries]


def decode_column(
    entries: Sequence[StreamEntry], fetch: Callable[[StreamEntry], bytes], rows: int | None = None
) -> NDArray[Any]:
    """Decode a column from its streams.

    Parameters
    ----------
    entries : the streams of one name, in table order
    fetch : gives the stored bytes of an entry
    rows : expected number of rows; checked before anything is allocated

    Returns
    -------
    column : (rows,) or (rows, width), a fresh array

    Raises
    ------
    FormatError
        Damage, or planes that do not make a column.
    """
    first = entries[0]
    n = stream_rows(first)
    if rows is not None and n != rows:
        raise FormatError(f"stream {first.name!r} has {n} rows, expected {rows}")
    dtype = KINDS[first.kind]
    planes = [entry.plane for entry in entries]
    whole = planes == [WHOLE]
    if not whole and planes != list(range(dtype.itemsize)):
        raise FormatError(f"stream {first.name!r} has planes {planes}")
    if any(
        (e.kind, e.width, e.raw_size) != (first.kind, first.width, first.raw_size) for e in entries
    ):
        raise FormatError(f"planes of stream {first.name!r} differ in type or size")
    if whole or dtype.itemsize == 1:
        flat = np.frombuffer(decode_bytes(first, fetch(first)), np.uint8)
        column: NDArray[Any] = (flat != 0) if dtype == np.bool_ else flat.copy().view(dtype)
    else:
        content = [np.frombuffer(decode_bytes(e, fetch(e)), np.uint8) for e in entries]
        column = _join(content, dtype)
    return column if first.width == 1 else column.reshape(n, first.width)


def _split(flat: NDArray[Any]) -> NDArray[np.uint8]:
    """Byte planes of a column, valid until the next ones are asked for."""
    size = flat.dtype.itemsize
    if flat.size < _SMALL or size == 8:
        return flat.view(np.uint8).reshape(-1, size).T.copy()
    from raymap.bytes.planes import split_planes

    planes = scratch("planes", size * flat.size, np.uint8).reshape(size, -1)
    split_planes(flat, planes)
    return planes


def _join(planes: list[NDArray[np.uint8]], dtype: np.dtype[Any]) -> NDArray[Any]:
    if planes[0].size < _SMALL or dtype.itemsize == 8:
        values = np.empty((planes[0].size, dtype.itemsize), np.uint8)
        for number, plane in enumerate(planes):
            values[:, number] = plane
        return values.reshape(-1).view(dtype)
    from raymap.bytes.planes import join_planes

    return join_planes([_retyped(plane) for plane in planes], dtype)


class _Buffer:
    """Lends bytes to numpy without the read-only mark, which would double the compiled variants."""

    def __init__(self, plane: NDArray[np.uint8]) -> None:
        self.plane = plane
        address = plane.__array_interface__["data"][0]
        self.__array_interface__ = {
            "version": 3,
            "shape": plane.shape,
            "typestr": "|u1",
            "data": (address, False),
        }


def _retyped(plane: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return plane if plane.flags.writeable else np.asarray(_Buffer(plane))
