"""The meta block of a portion's chunk: numbers, counts, flags, rays emitted."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import FormatError
from raymap.model.limits import (
    MAX_CHANNEL_SETS,
    MAX_DESCRIPTORS,
    MAX_DESCRIPTORS_PER_SEGMENT,
    MAX_RAY,
    MAX_RECORDS,
    RECORDS_FLOOR,
    RECORDS_PER_BYTE,
    affordable,
)

__all__ = ["DESCRIPTOR_STREAMS", "Encoding", "PortionMeta"]

_FIXED = struct.Struct("<QqqIIQIIQHHI")

DESCRIPTOR_STREAMS = (
    "descriptor.cell_u",
    "descriptor.cell_v",
    "descriptor.cosine",
    "descriptor.u",
    "descriptor.v",
)


class Encoding(IntFlag):
    """How columns of a portion are stored; bits 4 to 8 of its flags."""

    SOLVED_FACES = 1 << 4
    """One coordinate of points on faces with a quadric is a residual."""
    SOLVED_SPHERE = 1 << 5
    """So is that of the ends of rays that left, on the bounding sphere."""
    NORMALS = 1 << 6
    """Normals are residuals."""
    CROSSINGS = 1 << 7
    """Descriptors are residuals."""
    REVERSED = 1 << 8
    """Their cosine is positive against the direction of the detector."""


_ENCODINGS = 0x1F0


@dataclass(frozen=True, kw_only=True, eq=False)
class PortionMeta:
    """What a portion's header says, and the footer repeats.

    Attributes
    ----------
    number : place of the portion in the map
    first_ray, last_ray : numbers of its first and last ray; last_ray = first_ray - 1 without rays
    n_rays, n_records, n_descriptors : rows of the columns
    n_paths, n_points, n_crossings : rows of the path dictionary; those of the columns without one
    channel_set : index of the channel set
    has_paths : it has a dictionary and path numbers, not plain columns
    has_ids : ray numbers have gaps and are stored
    has_weights, grouped : columns ``weight`` and ``emission`` exist
    encodings : bits of `Encoding`
    emitted : (n_sources,) int64
    """

    number: int
    first_ray: int
    last_ray: int
    n_rays: int
    n_records: int
    n_descriptors: int
    n_paths: int
    n_points: int
    n_crossings: int
    channel_set: int
    has_paths: bool
    has_ids: bool
    has_weights: bool
    grouped: bool
    encodings: int
    emitted: NDArray[np.int64]

    @property
    def flags(self) -> int:
        marks = self.has_paths | self.has_ids << 1 | self.has_weights << 2 | self.grouped << 3
        return marks | self.encodings

    def pack(self) -> bytes:
        """The meta block."""
        fixed = _FIXED.pack(
            self.number,
            self.first_ray,
            self.last_ray,
            self.n_rays,
            self.n_records,
            self.n_descriptors,
            self.n_paths,
            self.n_points,
            self.n_crossings,
            self.channel_set,
            self.flags,
            len(self.emitted),
        )
        return fixed + self.emitted.astype("<i8").tobytes()

    @staticmethod
    def parse(data: bytes, n_sources: int) -> PortionMeta:
        """Parse and check a meta block.

        Raises
        ------
        FormatError
            A count breaks the limits of the format or contradicts another one.
        """
        if len(data) < _FIXED.size:
            raise FormatError("portion header is too short")
        fields = _FIXED.unpack_from(data)
        if fields[11] != n_sources or len(data) != _FIXED.size + 8 * n_sources:
            raise FormatError(f"portion header counts {fields[11]} sources, not {n_sources}")
        flags = fields[10]
        meta = PortionMeta(
            number=fields[0],
            first_ray=fields[1],
            last_ray=fields[2],
            n_rays=fields[3],
            n_records=fields[4],
            n_descriptors=fields[5],
            n_paths=fields[6],
            n_points=fields[7],
            n_crossings=fields[8],
            channel_set=fields[9],
            **PortionMeta.marks(flags),
            emitted=np.frombuffer(data, "<i8", n_sources, _FIXED.size).astype(np.int64),
        )
        meta.check()
        return meta

    @staticmethod
    def marks(flags: int) -> dict[str, Any]:
        """The fields that the flags hold.

        Raises
        ------
        FormatError
            A flag is set that this version does not know: the columns cannot be decoded.
        """
        if flags & ~(_ENCODINGS | 0xF):
            raise FormatError(
                f"portion uses encodings that this version does not know ({flags:#x})"
            )
        return {
            "has_paths": bool(flags & 1),
            "has_ids": bool(flags & 2),
            "has_weights": bool(flags & 4),
            "grouped": bool(flags & 8),
            "encodings": flags & _ENCODINGS,
        }

    @property
    def least_size(self) -> int:
        """Bytes that a chunk must have to pay for so many records."""
        most = max(self.n_records, self.n_descriptors)
        return 0 if most <= RECORDS_FLOOR else -(-most // RECORDS_PER_BYTE)

    def check_size(self, stored: int) -> None:
        """Refuse more records than a chunk of ``stored`` bytes can pay for."""
        limit = affordable(stored, RECORDS_FLOOR, RECORDS_PER_BYTE)
        if max(self.n_records, self.n_descriptors) > limit:
            raise FormatError(
                f"portion of {stored} bytes declares {self.n_records} records and "
                f"{self.n_descriptors} descriptors; it may have {limit}"
            )

    def check(self) -> None:
        """Refuse impossible counts before anything is allocated for them."""
        n_rays, n_records = self.n_rays, self.n_records
        span = self.last_ray - self.first_ray + 1
        sound = (
            n_rays <= n_records <= MAX_RECORDS
            and (n_rays > 0 or n_records == 0)
            and self.n_descriptors <= min(MAX_DESCRIPTORS, n_records * MAX_DESCRIPTORS_PER_SEGMENT)
            and 0 <= self.first_ray <= MAX_RAY
            and (span >= n_rays > 0 if self.has_ids else span == n_rays)
            and self.last_ray < MAX_RAY
            and self.channel_set < MAX_CHANNEL_SETS
            and self.number < MAX_RAY
            and bool(((self.emitted >= 0) & (self.emitted < MAX_RAY)).all())
        )
        if self.has_paths:
            sound = (
                sound
                and 1 <= self.n_paths <= n_rays
                and self.n_paths <= self.n_points <= n_records
                and self.n_crossings <= self.n_descriptors
            )
        else:
            counts = (self.n_paths, self.n_points, self.n_crossings)
            sound = sound and counts == (n_rays, n_records, self.n_descriptors)
        if not sound:
            raise FormatError(
                f"portion header declares impossible counts ({n_rays} rays, {n_records} records, "
                f"{self.n_descriptors} descriptors, {self.n_paths} paths)"
            )
