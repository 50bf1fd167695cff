"""A portion in memory: rays, their segment records and companions as plain columns.

This is what a tracer hands to the writer and what a reader gives back in full. Records stand ray
after ray; a ray with n segments has n + 1 records.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Descriptors", "Portion", "empty_portion"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Descriptors:
    """Crossings of segments and detectors, in record order.

    Attributes
    ----------
    detector : (n,) int16
    cell : (n, 2) uint16
    cosine : (n,) int16, cosine between ray and detector direction x 32767
    uv : (n, 2) uint16, place inside the detector x 65535
    registered : (n,) bool
    """

    detector: NDArray[np.int16]
    cell: NDArray[np.uint16]
    cosine: NDArray[np.int16]
    uv: NDArray[np.uint16]
    registered: NDArray[np.bool_]

    @staticmethod
    def empty() -> Descriptors:
        """No crossings, as of rays that no detector saw."""
        return Descriptors(
            detector=np.empty(0, np.int16),
            cell=np.empty((0, 2), np.uint16),
            cosine=np.empty(0, np.int16),
            uv=np.empty((0, 2), np.uint16),
            registered=np.empty(0, np.bool_),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Portion:
    """Rays traced together.

    Attributes
    ----------
    emitted : (n_sources,) int64, rays emitted per source, also those that were not stored
    source : (n_rays,) int16
    records_per_ray : (n_rays,) int32, at least 1
    position : (n_records, 3) float32 [scene units]
    normal : (n_records, 3) int16, x 32767
    object : (n_records,) int16
    triangle : (n_records,) int32
    event : (n_records,) int32
    medium : (n_records,) int16, of the segment that starts at the record
    color_code : (n_records,) int32; below n_channels: all light is in that channel; from
        n_channels on: row ``color_code - n_channels`` of ``color_table``
    color_table : (n_colors, n_channels) uint16, rows sum to 65535
    descriptor_count : (n_records,) uint16
    descriptors : Descriptors
    first_ray : number of the first ray; ray i has number ``first_ray + i`` unless ``ray_ids``
    ray_ids : (n_rays,) int64, strictly increasing, or None
    channel_set : index of the channel set of the map
    weight : (n_rays,) float32, or None where every ray weighs 1
    emission : (n_rays,) int64 groups rays of one emission (splitting), or None
    implied_normals : normals of points on the directory's quadrics are those that these have at the
        stored positions, and need not be compared with them
    extra : further columns by name; each has n_rays or n_records rows
    """

    emitted: NDArray[np.int64]
    source: NDArray[np.int16]
    records_per_ray: NDArray[np.int32]
    position: NDArray[np.float32]
    normal: NDArray[np.int16]
    object: NDArray[np.int16]
    triangle: NDArray[np.int32]
    event: NDArray[np.int32]
    medium: NDArray[np.int16]
    color_code: NDArray[np.int32]
    color_table: NDArray[np.uint16]
    descriptor_count: NDArray[np.uint16]
    descriptors: Descriptors
    first_ray: int = 0
    ray_ids: NDArray[np.int64] | None = None
    channel_set: int = 0
    weight: NDArray[np.float32] | None = None
    emission: NDArray[np.int64] | None = None
    implied_normals: bool = False
    extra: dict[str, NDArray[np.generic]] = field(default_factory=dict)

    @property
    def n_rays(self) -> int:
        return len(self.records_per_ray)

    @property
    def n_records(self) -> int:
        return len(self.object)


def empty_portion(emitted: NDArray[np.int64], n_channels: int) -> Portion:
    """A portion without rays: it only says how many each source emitted."""
    return Portion(
        emitted=emitted,
        source=np.empty(0, np.int16),
        records_per_ray=np.empty(0, np.int32),
        position=np.empty((0, 3), np.float32),
        normal=np.empty((0, 3), np.int16),
        object=np.empty(0, np.int16),
        triangle=np.empty(0, np.int32),
        event=np.empty(0, np.int32),
        medium=np.empty(0, np.int16),
        color_code=np.empty(0, np.int32),
        color_table=np.empty((0, n_channels), np.uint16),
        descriptor_count=np.empty(0, np.uint16),
        descriptors=Descriptors.empty(),
    )
