"""The segment record and its companions: dtypes, sentinels, scales, declared once.

Streams, exports, the format page and query fields derive from these declarations.
"""

from __future__ import annotations

import numpy as np

__all__ = [
    "COLOR_SCALE",
    "DESCRIPTOR_DTYPE",
    "NONE",
    "NORMAL_SCALE",
    "PORTION_RAYS",
    "PORTION_RECORDS",
    "SEGMENT_DTYPE",
    "UV_SCALE",
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
"""One crossing of a detector by a segment, 13 bytes packed."""

PORTION_RAYS = 65_536
"""Rays of a portion by default."""

PORTION_RECORDS = 2**20
"""A portion closes early when it holds this many records."""
