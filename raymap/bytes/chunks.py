"""A map as a file of chunks: positional reads by many threads, walking, search after damage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.address import Address
from raymap.bytes.bytesource import open_bytes
from raymap.bytes.layout import (
    CHUNK_HEADER_SIZE,
    FILE_HEADER_SIZE,
    MAGIC,
    READABLE,
    TAG_PREFIX,
    TAIL_MAGIC,
    ChunkHeader,
    StreamEntry,
    header_size,
    parse_chunk_header,
)
from raymap.bytes.streams import decode_bytes, decode_column
from raymap.model.errors import FormatError, NotARayMap, UnsupportedVersion
from raymap.model.limits import JSON_FLOOR, JSON_PER_BYTE, MAX_JSON, affordable, may_expand, surplus

__all__ = ["Chunk", "ChunkColumns", "Gap", "MapFile"]

_SEARCH_BLOCK = 2**20
_READ_AHEAD = 8192
FAR_SEARCH = 2**28
"""Bytes that are fetched in search of the next chunk of a file behind an address: it may state any
length, and send zeros as long as it is asked."""


@dataclass(frozen=True)
class Chunk:
    """A complete chunk whose header is sound."""

    offset: int
    header: ChunkHeader

    @cached_property
    def by_name(self) -> dict[str, list[StreamEntry]]:
        """Its streams by name, in the order of the table."""
        table: dict[str, list[StreamEntry]] = {}
        for entry in self.header.streams:
            table.setdefault(entry.name, []).append(entry)
        return table

    @property
    def tag(self) -> bytes:
        return self.header.tag

    @property
    def end(self) -> int:
        return self.offset + self.header.size


@dataclass(frozen=True)
class ChunkColumns:
    """The columns of a chunk whose names begin with a prefix."""

    file: MapFile
    chunk: Chunk
    prefix: str = ""

    def text(self, name: str) -> bytes | None:
        """Opaque bytes; None where there are none."""
        if self.prefix + name not in self.chunk.by_name:
            return None
        return self.file.text_of(self.chunk, self.prefix + name)

    def column(
        self, name: str, rows: int | None, dtype: Any, *, matrix: bool = False
    ) -> NDArray[Any]:
        """A column of numbers; one that is not there has no rows."""
        if rows is None and self.prefix + name not in self.chunk.by_name:
            rows = 0
        return self.file.column(self.chunk, self.prefix + name, rows, dtype, matrix=matrix)


@dataclass(frozen=True, slots=True)
class Gap:
    """Bytes that are no chunk: damage, or at the end of the file a torn tail."""

    offset: int
    end: int
    reason: str


class MapFile:
    """An open map; reads do not move a shared position and may run on many threads.

    Attributes
    ----------
    major : version of the format; 0 of a file far away whose beginning was not read yet, as its end
        says that it is a map
    """

    def __init__(self, path: Path | Address) -> None:
        self.path = path
        self.bytes = open_bytes(path)
        self.major = 0
        try:
            if not self.bytes.distant or self._tail() != TAIL_MAGIC:
                self.check_magic()
        except (NotARayMap, UnsupportedVersion):
            self.close()
            raise
        except FormatError as error:
            self.close()
            raise NotARayMap(str(error)) from None

    def close(self) -> None:
        """Close the file; reading raises afterwards."""
        self.bytes.close()

    @property
    def size(self) -> int:
        """Bytes of the file now."""
        return self.bytes.size

    @property
    def bytes_read(self) -> int:
        """Bytes fetched so far."""
        return self.bytes.bytes_read

    def read(self, offset: int, length: int) -> bytes:
        """Exactly ``length`` bytes, fewer only at the end of the file."""
        return self.bytes.read(offset, length)

    def chunk_at(self, offset: int, size: int, head_size: int = 0) -> Chunk:
        """The chunk at an offset of a file of the given size.

        Parameters
        ----------
        head_size : of header, meta block and stream table, 0 where that is not known

        Raises
        ------
        FormatError
            There is no sound chunk header, or the chunk is longer than the file.
        """
        wanted = max(head_size, CHUNK_HEADER_SIZE) if head_size else _READ_AHEAD
        data = self.read(offset, min(wanted, max(0, size - offset)))
        if len(data) < CHUNK_HEADER_SIZE:
            raise FormatError("chunk header is cut off")
        if not data.startswith(TAG_PREFIX):
            raise FormatError("there is no chunk tag")
        needed = header_size(data)
        if needed > len(data):
            data += self.read(offset + len(data), needed - len(data))
        header = parse_chunk_header(data)
        if header.size > size - offset:
            raise FormatError(f"chunk of {header.size} bytes is cut off after {size - offset}")
        _check_expansion(header)
        return Chunk(offset, header)

    def walk(self, start: int, size: int) -> Iterator[Chunk | Gap]:
        """Chunks in file order; what is none is reported as a gap up to the next sound header."""
        offset = start
        while offset < size:
            try:
                chunk = self.chunk_at(offset, size)
            except FormatError as error:
                far = min(size, offset + FAR_SEARCH) if self.bytes.distant else size
                found = self._search(offset + 1, far, size)
                end = size if found is None else found.offset
                reason = str(error)
                if found is None and far < size:
                    reason += f"; {FAR_SEARCH} bytes further on is none: copy the file here"
                yield Gap(offset, end, reason)
                if found is None:
                    return
                chunk = found
            yield chunk
            offset = chunk.end

    def _search(self, start: int, far: int, size: int) -> Chunk | None:
        """The next chunk with a sound header at or after ``start`` and before ``far``."""
        overlap = len(TAG_PREFIX) - 1
        while start < far:
            block = self.read(start, min(_SEARCH_BLOCK + overlap, size - start))
            index = block.find(TAG_PREFIX)
            while 0 <= index < _SEARCH_BLOCK:
                try:
                    return self.chunk_at(start + index, size)
                except FormatError:
                    index = block.find(TAG_PREFIX, index + 1)
            start += _SEARCH_BLOCK
        return None

    def stored(self, chunk: Chunk, entry: StreamEntry) -> bytes:
        """The stored bytes of one stream."""
        return self.read(chunk.offset + entry.offset, entry.stored_size)

    def text_of(self, chunk: Chunk, name: str = "json") -> bytes:
        """A text, checked and decompressed.

        Raises
        ------
        FormatError
            It is damaged, or longer than the file can pay for.
        """
        entries = chunk.by_name.get(name, [])
        if len(entries) != 1:
            raise FormatError(f"chunk at byte {chunk.offset} has no stream {name!r}")
        limit = min(MAX_JSON, affordable(chunk.end, JSON_FLOOR, JSON_PER_BYTE))
        if entries[0].raw_size > limit:
            raise FormatError(
                f"chunk at byte {chunk.offset} holds a text of {entries[0].raw_size} bytes; a file "
                f"of {chunk.end} bytes may hold {limit}"
            )
        return bytes(decode_bytes(entries[0], self.stored(chunk, entries[0])))

    def column(
        self, chunk: Chunk, name: str, rows: int | None, dtype: Any, *, matrix: bool = False
    ) -> NDArray[Any]:
        """A column of a chunk, checked and decoded, as the expected type.

        A column that is not there has no rows; where ``rows`` is None it must be there.
        """
        entries = chunk.by_name.get(name, [])
        if not entries and rows == 0:
            return np.empty(0, dtype)
        if not entries:
            raise FormatError(f"chunk at byte {chunk.offset} has no stream {name!r}")
        column = decode_column(entries, lambda entry: self.stored(chunk, entry), rows)
        wanted = np.dtype(dtype)
        if column.ndim > 1 and not matrix:
            raise FormatError(f"stream {name!r} has {column.shape[1]} elements per row")
        if column.dtype == wanted:
            return column
        if column.dtype.kind in "iu" and wanted.kind in "iu":
            return column.astype(wanted)
        raise FormatError(f"stream {name!r} holds {column.dtype}, expected {wanted}")

    def _tail(self) -> bytes:
        size = self.bytes.size
        return self.read(max(0, size - len(TAIL_MAGIC)), len(TAIL_MAGIC))

    def check_magic(self) -> None:
        """Check what the file begins with, and take its version from there.

        Raises
        ------
        NotARayMap, UnsupportedVersion
        """
        head = self.read(0, FILE_HEADER_SIZE)
        if len(head) < FILE_HEADER_SIZE or not head.startswith(MAGIC):
            raise NotARayMap(_wrong_magic(self.path, head))
        major = int.from_bytes(head[12:14], "little")
        self.take_version(major)

    def take_version(self, major: int) -> None:
        """Read on as a file of this version.

        Raises
        ------
        UnsupportedVersion
        """
        if major not in READABLE:
            raise UnsupportedVersion(
                f"{self.path} has format version {major}, this program reads versions "
                f"{READABLE[0]} to {READABLE[-1]}: install a newer Raymap"
            )
        self.major = major


def _check_expansion(header: ChunkHeader) -> None:
    """Refuse chunks that declare far more bytes than they can honestly hold."""
    for entry in header.streams:
        if not may_expand(entry.raw_size, entry.stored_size):
            raise FormatError(f"stream {entry.name!r} declares {entry.raw_size} bytes")
    if surplus(((e.raw_size, e.stored_size) for e in header.streams), header.size):
        raw = sum(entry.raw_size for entry in header.streams)
        raise FormatError(f"chunk of {header.size} bytes declares {raw} bytes of streams")


def _wrong_magic(path: Path | Address, head: bytes) -> str:
    if not head:
        return f"{path} is empty, not a ray map"
    if head[1:7] == MAGIC[1:7] or head[:6] == MAGIC[1:7]:
        return (
            f"{path} was a ray map, but its first bytes are damaged (a copy in text mode?): "
            "copy it again in binary mode"
        )
    return f"{path} is not a ray map (its first bytes are not those of one)"
