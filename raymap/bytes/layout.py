"""Chunk headers and stream tables: bytes to values and back, every length checked.

::

    file   = magic (12) major u2 minor u2, then chunks
    chunk  = tag (8) version u2 n_streams u2 meta_size u4 chunk_size u8 checksum u8
             meta (meta_size)  stream table (64 n_streams)  streams, one after the other
    stream = name (32) kind u1 codec u1 plane u1 scope u1 width u4
             raw_size u8 stored_size u8 hash u8

The checksum is the XXH3-64 of the first 24 bytes of the header, the meta block and the stream
table; each stream's hash is the XXH3-64 of its bytes as stored. Streams follow each other without
gaps, so no table can make two of them overlap.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import xxhash

from raymap.model.errors import FormatError, LimitExceeded
from raymap.model.limits import MAX_META, MAX_STREAM_NAME, MAX_STREAMS

__all__ = [
    "CHANNELS",
    "CHUNK_HEADER_SIZE",
    "DETECTOR",
    "DIRECTORY",
    "FILE_HEADER_SIZE",
    "FOOTER",
    "KNOWN_TAGS",
    "MAGIC",
    "MAX_HEADER_SIZE",
    "PATHS",
    "PORTION",
    "READABLE",
    "RUN",
    "STREAM_ENTRY_SIZE",
    "TAG_PREFIX",
    "TAIL_MAGIC",
    "VERSION",
    "ChunkHeader",
    "StreamEntry",
    "header_size",
    "pack_chunk_header",
    "pack_file_header",
    "parse_chunk_header",
]

MAGIC = b"\x89RAYMAP\r\n\x1a\n\x00"
"""A copy in text mode changes the line ends, a copy through 7 bits the first byte."""

VERSION = (2, 0)
"""What this program writes."""

READABLE = (1, 2)
"""Major versions that it reads."""

TAIL_MAGIC = b"RMAP\r\nZ\n"
"""The last bytes of a finished map."""

TAG_PREFIX = b"RMAP:"
DIRECTORY = b"RMAP:DIR"
CHANNELS = b"RMAP:CHN"
RUN = b"RMAP:RUN"
PORTION = b"RMAP:POR"
DETECTOR = b"RMAP:DET"
PATHS = b"RMAP:PTH"
FOOTER = b"RMAP:END"
KNOWN_TAGS = (DIRECTORY, CHANNELS, RUN, PORTION, DETECTOR, PATHS, FOOTER)

_FILE = struct.Struct("<12sHH")
_CHUNK = struct.Struct("<8sHHIQ")
_CHECKSUM = struct.Struct("<Q")
_STREAM = struct.Struct("<32sBBBBIQQQ")

FILE_HEADER_SIZE = _FILE.size
CHUNK_HEADER_SIZE = _CHUNK.size + _CHECKSUM.size
STREAM_ENTRY_SIZE = _STREAM.size
MAX_HEADER_SIZE = CHUNK_HEADER_SIZE + MAX_META + MAX_STREAMS * STREAM_ENTRY_SIZE
CHUNK_VERSION = 1


@dataclass(frozen=True, slots=True)
class StreamEntry:
    """One row of a stream table.

    Attributes
    ----------
    name : of the column or of a part of its encoding
    kind : code of the element type (`raymap.bytes.streams.KINDS`)
    codec : 0 stored, 1 zstandard, 2 constant (the one byte that all bytes equal)
    plane : this byte of every element, least significant first; 255: whole elements
    scope : what a row belongs to (`raymap.bytes.streams.Scope`)
    width : elements per row
    raw_size, stored_size : bytes decoded and as stored
    hash : XXH3-64 of the bytes as stored
    offset : place in the chunk; follows from the sizes before, not stored
    """

    name: str
    kind: int
    codec: int
    plane: int
    scope: int
    width: int
    raw_size: int
    stored_size: int
    hash: int
    offset: int = 0


@dataclass(frozen=True, slots=True)
class ChunkHeader:
    """A parsed chunk header whose checksum held."""

    tag: bytes
    version: int
    size: int
    meta: bytes
    streams: tuple[StreamEntry, ...]

    @property
    def head_size(self) -> int:
        """Bytes of header, meta block and stream table."""
        return CHUNK_HEADER_SIZE + len(self.meta) + STREAM_ENTRY_SIZE * len(self.streams)


def pack_file_header() -> bytes:
    """The first 16 bytes of a map."""
    return _FILE.pack(MAGIC, *VERSION)


def header_size(prefix: bytes) -> int:
    """Bytes of header, meta block and stream table that a chunk's first 32 bytes announce."""
    _, _, n_streams, meta_size, _ = _CHUNK.unpack_from(prefix)
    if n_streams > MAX_STREAMS or meta_size > MAX_META:
        raise FormatError(f"chunk header announces {n_streams} streams, {meta_size} bytes of meta")
    return CHUNK_HEADER_SIZE + int(meta_size) + int(n_streams) * STREAM_ENTRY_SIZE


def pack_chunk_header(tag: bytes, meta: bytes, streams: list[StreamEntry]) -> bytes:
    """Header, meta block and stream table of a chunk; the streams' offsets are not needed.

    Raises
    ------
    LimitExceeded
        It has more streams, a longer meta block or a longer name than readers take.
    """
    if len(streams) > MAX_STREAMS or len(meta) > MAX_META:
        raise LimitExceeded(
            f"a chunk would have {len(streams)} streams and {len(meta)} bytes of meta; at most "
            f"{MAX_STREAMS} and {MAX_META} are read"
        )
    for entry in streams:
        if not 0 < len(entry.name.encode()) <= MAX_STREAM_NAME:
            raise LimitExceeded(
                f"a stream cannot be called {entry.name!r}: names have 1 to {MAX_STREAM_NAME} bytes"
            )
    table = b"".join(
        _STREAM.pack(
            entry.name.encode(),
            entry.kind,
            entry.codec,
            entry.plane,
            entry.scope,
            entry.width,
            entry.raw_size,
            entry.stored_size,
            entry.hash,
        )
        for entry in streams
    )
    size = CHUNK_HEADER_SIZE + len(meta) + len(table) + sum(e.stored_size for e in streams)
    head = _CHUNK.pack(tag, CHUNK_VERSION, len(streams), len(meta), size)
    checksum = xxhash.xxh3_64_intdigest(head + meta + table)
    return head + _CHECKSUM.pack(checksum) + meta + table


def parse_chunk_header(data: bytes) -> ChunkHeader:
    """Check and parse header, meta block and stream table.

    Parameters
    ----------
    data : at least `header_size` bytes from the start of the chunk

    Raises
    ------
    FormatError
        The checksum fails, or sizes contradict each other.
    """
    if len(data) < CHUNK_HEADER_SIZE:
        raise FormatError("chunk header is cut off")
    end = header_size(data)
    if len(data) < end:
        raise FormatError("chunk header is cut off")
    tag, version, _, meta_size, size = _CHUNK.unpack_from(data)
    (checksum,) = _CHECKSUM.unpack_from(data, _CHUNK.size)
    body = data[CHUNK_HEADER_SIZE:end]
    if xxhash.xxh3_64_intdigest(data[: _CHUNK.size] + body) != checksum:
        raise FormatError("chunk header fails its checksum")
    streams = []
    offset = end
    for packed_name, *fields in _STREAM.iter_unpack(body[meta_size:]):
        try:
            name = packed_name.rstrip(b"\0").decode()
        except UnicodeDecodeError:
            raise FormatError("a stream's name is not UTF-8") from None
        kind, codec, plane, scope, width, raw_size, stored_size, digest = fields
        streams.append(
            StreamEntry(
                name, kind, codec, plane, scope, width, raw_size, stored_size, digest, offset
            )
        )
        offset += stored_size
    if offset != size:
        raise FormatError(f"streams end at byte {offset} of a chunk of {size} bytes")
    return ChunkHeader(tag, version, size, body[:meta_size], tuple(streams))
