"""What a ray map may hold: one table that the writer obeys and the reader checks.

Whatever keeps to it can be written and opened again; the page of the format repeats it, by test.
"""

from __future__ import annotations

from collections.abc import Iterable

__all__ = [
    "CELLS_FLOOR",
    "CELLS_PER_BYTE",
    "EXPANSION",
    "FREE_CHUNK",
    "FREE_STREAM",
    "JSON_FLOOR",
    "JSON_PER_BYTE",
    "MAX_CELLS_PER_SIDE",
    "MAX_CHANNELS",
    "MAX_CHANNEL_SETS",
    "MAX_DESCRIBED",
    "MAX_DESCRIPTORS",
    "MAX_DESCRIPTORS_PER_SEGMENT",
    "MAX_EXTRA_NAME",
    "MAX_FLUX",
    "MAX_INDEX",
    "MAX_JSON",
    "MAX_META",
    "MAX_NAME",
    "MAX_NUMBER",
    "MAX_PRIMITIVES",
    "MAX_RAY",
    "MAX_RECORDS",
    "MAX_STREAMS",
    "MAX_STREAM_NAME",
    "MAX_WAVELENGTH_NM",
    "PICTURE_FLOOR",
    "PICTURE_PER_BYTE",
    "RECORDS_FLOOR",
    "RECORDS_PER_BYTE",
    "affordable",
    "may_expand",
    "surplus",
]

MAX_INDEX = 32767
"""At most this many objects, sources, detectors, media, surfaces (int16 indices)."""

MAX_PRIMITIVES = 2**31 - 1
"""At most this many primitives in one object, and faces in one map (int32 indices)."""

MAX_NAME = 1024
"""Characters of a name; a name has at least one."""

MAX_CELLS_PER_SIDE = 65535
MAX_CHANNELS = 4096
MAX_CHANNEL_SETS = 4096
MAX_DESCRIPTORS_PER_SEGMENT = 65535

MAX_RECORDS = 2**24
"""No portion, and so no single ray, holds more records."""

MAX_DESCRIPTORS = 2**26
"""Of one portion."""

MAX_RAY = 2**62
"""Ray and portion numbers, and rays emitted, stay below."""

MAX_EXTRA_NAME = 30
"""Bytes of the name of a further column."""

MAX_JSON = 2**28
"""Bytes of one JSON text."""

MAX_DESCRIBED = 2**27
"""Bytes of the JSON of all channel sets and runs together, which the footer repeats."""

MAX_META = 2**20
"""Bytes of a chunk's meta block."""

MAX_STREAMS = 65535
"""Streams of a chunk."""

MAX_STREAM_NAME = 32
"""Bytes of a stream's name."""

MAX_WAVELENGTH_NM = 10**12
"""Of a channel: a kilometre; `float32`, in which light leaves a map, holds it."""

MAX_FLUX = 10**40
"""Of a source: squares of all light of as many rays as there may be are numbers."""

MAX_NUMBER = 10**30
"""Amount of a component of a vector, or of a number of a channel set."""

JSON_FLOOR, JSON_PER_BYTE = 2**22, 64
"""Bytes of a JSON text that any file may hold, and as many times the bytes of the file."""

RECORDS_FLOOR, RECORDS_PER_BYTE = 2**21, 16
"""Records, or descriptors, of a portion, against the bytes of its chunk."""

CELLS_FLOOR, CELLS_PER_BYTE = 2**24, 16
"""Cells x channels of a detector whose sums are made anew, against the bytes of the file."""

PICTURE_FLOOR, PICTURE_PER_BYTE = 2**24, 4
"""Cells of all pictures that are asked for at once, against the bytes of the file."""

FREE_STREAM = 2**27
FREE_CHUNK = 2**30
EXPANSION = 256
"""A stream may expand to FREE_STREAM bytes, the streams of a chunk together to FREE_CHUNK, in any
case; beyond that to EXPANSION times the bytes as stored."""


def affordable(stored: int, floor: int, per_byte: int) -> int:
    """How much of something so many bytes can pay for.

    What a reader allocates grows with what lies in the file, not with what that says of itself.
    """
    return max(floor, per_byte * stored)


def may_expand(raw_size: int, stored_size: int, free: int = FREE_STREAM) -> bool:
    """Whether so many stored bytes may stand for so many raw ones."""
    return raw_size <= max(free, EXPANSION * stored_size)


def surplus(sizes: Iterable[tuple[int, int]], chunk_size: int) -> int:
    """Bytes by which a chunk is too small for what its streams expand to.

    Parameters
    ----------
    sizes : raw and stored size of each stream
    """
    raw = sum(raw_size for raw_size, _ in sizes)
    return 0 if raw <= FREE_CHUNK else max(0, -(-raw // EXPANSION) - chunk_size)
