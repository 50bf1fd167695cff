"""The segment record and its companions: dtypes, sentinels, scales and limits, declared once.

Streams, exports, the format page and query fields derive from these declarations.
"""

from __future__ import annotations

import numpy as np

__all__ = [
    "COLOR_SCALE",
    "DESCRIPTOR_DTYPE",
    "MAX_CELLS_PER_SIDE",
    "MAX_DESCRIPTORS_PER_SEGMENT",
    "MAX_INDEX",
    "MAX_PRIMITIVES",
    "NONE",
    "NORMAL_SCALE",
    "PORTION_MAX_RECORDS",
    "PORTION_RAYS",
    "PORTION_RECORDS",
    "SEGMENT_DTYPE",
    "UV_SCALE",
    "affordable",
]

NONE = -1
"""Sentinel of every index column: no object, no primitive, no descriptor, unknown medium."""

NORMAL_SCALE = 32767
"""Normals and cosines are stored as round(value * NORMAL_SCALE) in int16."""

UV_SCALE = 65535
"""Places inside a detector are stored as round(uv * UV_SCALE) in uint16."""

COLOR_SCALE = 65535
"""The colour channels of a segment are uint16 and sum to COLOR_SCALE."""

SEGMENT_DTYPE = np.dtype(
    [
        ("source", "<i2"),
        ("object", "<i2"),
        ("triangle", "<i4"),
        ("position", "<f4", (3,)),
        ("normal", "<i2", (3,)),
        ("event", "<i4"),
        ("first_descriptor", "<i4"),
        ("descriptor_count", "<u2"),
    ]
)
"""One segment record, 36 bytes packed; every field speaks about the point where it starts."""

DESCRIPTOR_DTYPE = np.dtype(
    [
        ("detector", "<i2"),
        ("cell", "<u2", (2,)),
        ("cosine", "<i2"),
        ("uv", "<u2", (2,)),
        ("registered", "?"),
    ]
)
"""One meeting of a segment with a detector, 13 bytes packed."""

MAX_INDEX = 32767
"""At most this many objects, sources, detectors, media (indices are int16)."""

MAX_PRIMITIVES = 2**31 - 1
"""At most this many primitives in one object."""

MAX_CELLS_PER_SIDE = 65535
MAX_DESCRIPTORS_PER_SEGMENT = 65535

PORTION_RAYS = 65_536
"""Rays of a portion by default."""

PORTION_RECORDS = 2**20
"""A portion closes early when it holds this many records."""

PORTION_MAX_RECORDS = 2**24
"""No portion, and so no single ray, may hold more records."""

JSON_FLOOR, JSON_PER_BYTE = 2**22, 64
"""Bytes of a JSON text that any file may hold, and as many times the bytes of the file."""

TABLE_FLOOR, TABLE_PER_BYTE = 2**24, 64
"""Primitives of a scene in which faces have a quadric per primitive, against the directory."""

RECORDS_FLOOR, RECORDS_PER_BYTE = 2 * PORTION_RECORDS, 16
"""Records of a portion, against the bytes of its chunk: the coordinates of one cost bytes."""

CELLS_FLOOR, CELLS_PER_BYTE = 2**24, 16
"""Cells x channels of a detector whose sums are made anew, against the bytes of the file."""


def affordable(stored: int, floor: int, per_byte: int) -> int:
    """How much of something so many bytes can pay for.

    What a reader allocates grows with what lies in the file, not with what that says of itself.
    """
    return max(floor, per_byte * stored)
