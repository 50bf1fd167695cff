"""The rays that are drawn, as plain columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["DrawnRays", "no_rays"]


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnRays:
    """Rays with their records, ray after ray.

    Attributes
    ----------
    ray_ids : (n_rays,) int64
    offsets : (n_rays + 1,) int64, records of ray i are rows offsets[i]:offsets[i + 1]
    source : (n_rays,) int16
    flux : (n_rays,) float64 [flux unit]
    path : (n_rays,) int64, equal numbers took the same path
    wavelength : (n_rays,) float32 of the last record [nm], NaN while mixed
    position : (n_records, 3) float32 [scene units]
    event : (n_records,) int32
    object : (n_records,) int16
    rgb : (n_records, 3) float32, linear sRGB of the segment that starts here
    index : (n_records,) float32, refractive index for the segment that starts here, NaN unknown
    """

    ray_ids: NDArray[np.int64]
    offsets: NDArray[np.int64]
    source: NDArray[np.int16]
    flux: NDArray[np.float64]
    path: NDArray[np.int64]
    wavelength: NDArray[np.float32]
    position: NDArray[np.float32]
    event: NDArray[np.int32]
    object: NDArray[np.int16]
    rgb: NDArray[np.float32]
    index: NDArray[np.float32]

    @property
    def n_rays(self) -> int:
        return len(self.ray_ids)

    @property
    def n_records(self) -> int:
        return len(self.event)

    def take(self, rows: NDArray[np.int64]) -> DrawnRays:
        """Some of the rays, by index."""
        counts = np.diff(self.offsets)[rows]
        offsets = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        starts = np.repeat(self.offsets[rows] - offsets[:-1], counts)
        records = starts + np.arange(offsets[-1])
        columns = {
            item.name: getattr(self, item.name)[records if _per_record(item.name) else rows]
            for item in fields(self)
            if item.name != "offsets"
        }
        return DrawnRays(offsets=offsets, **columns)

    @staticmethod
    def join(parts: Sequence[DrawnRays]) -> DrawnRays:
        """All rays of several parts, one after the other."""
        if not parts:
            return no_rays()
        counts = np.concatenate([np.diff(part.offsets) for part in parts])
        columns = {
            item.name: np.concatenate([getattr(part, item.name) for part in parts])
            for item in fields(DrawnRays)
            if item.name != "offsets"
        }
        offsets = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        return DrawnRays(offsets=offsets, **columns)


def _per_record(name: str) -> bool:
    return name in ("position", "event", "object", "rgb", "index")


def no_rays() -> DrawnRays:
    """An empty set of rays."""
    return DrawnRays(
        ray_ids=np.empty(0, np.int64),
        offsets=np.zeros(1, np.int64),
        source=np.empty(0, np.int16),
        flux=np.empty(0),
        path=np.empty(0, np.int64),
        wavelength=np.empty(0, np.float32),
        position=np.empty((0, 3), np.float32),
        event=np.empty(0, np.int32),
        object=np.empty(0, np.int16),
        rgb=np.empty((0, 3), np.float32),
        index=np.empty(0, np.float32),
    )
