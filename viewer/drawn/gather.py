"""From the rays of stored portions to the rays that are drawn.

Which rays are drawn is reproducible and nested: portions in their order, and within a portion the
rays whose number has the smallest hash. More rays only add to fewer, and every source of a portion
gets its share though sources may stand one after the other in it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import ChannelSet
from raymap.optics.photometry import colors_of_codes, displayed, ray_weights
from viewer.drawn.rays import DrawnRays

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["read_rays", "thin"]


def thin(ray_ids: NDArray[np.int64], limit: int) -> NDArray[np.int64]:
    """Indices of at most ``limit`` rays, in order, chosen by a hash of their numbers.

    A larger limit keeps the rays of a smaller one.
    """
    if len(ray_ids) <= limit:
        return np.arange(len(ray_ids))
    # Finaliser of SplitMix64 (Steele, Lea, Flood 2014)
    key = ray_ids.astype(np.uint64)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    key ^= key >> np.uint64(31)
    return np.sort(np.argpartition(key, limit)[:limit])


def _indices(channel_set: ChannelSet, n_media: int) -> NDArray[np.float64]:
    """(n_media + 1, n_channels) refractive indices; the last row, of no medium, is NaN."""
    table = np.full((n_media + 1, channel_set.n_channels), np.nan)
    known = np.array(channel_set.refractive_index, np.float64)
    if known.size:
        table[: min(n_media, len(known))] = known[:n_media]
    return table


def read_rays(
    ray_map: RayMap,
    portion_index: int,
    rows: NDArray[np.int64],
    emitted: NDArray[np.int64] | None = None,
) -> DrawnRays:
    """Read some rays of one portion.

    Parameters
    ----------
    ray_map : an open map
    portion_index : index in ``ray_map.portions``
    rows : (n,) rays of the portion, increasing
    emitted : (n_sources,) rays emitted, to scale the flux with; None takes the whole map

    Returns
    -------
    DrawnRays; ``path`` is the row in the merged paths of the map, or below zero and different for
    each ray where there are none.
    """
    portion = ray_map.portions[portion_index]
    offsets = portion.record_offsets()
    counts = np.diff(offsets)[rows]
    own = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    records = np.repeat(offsets[rows] - own[:-1], counts) + np.arange(own[-1])

    # Colour of each record, mixed light by the portion's table
    channel_set = ray_map.channel_sets[portion.channel_set]
    n_channels = channel_set.n_channels
    codes = portion.column("color_code")[records]
    shares = colors_of_codes(portion.color_table(), n_channels)
    rgb = displayed(channel_set, shares)[codes]

    # Index of refraction in the light of the segment
    medium = portion.column("medium")[records]
    table = _indices(channel_set, len(ray_map.directory.media))
    by_color = shares @ table.T
    index = by_color[codes, np.where(medium < 0, table.shape[0] - 1, medium)]

    # Wavelength of the last record, where it is a single one
    wavelengths = np.append(np.array(channel_set.wavelengths_nm, np.float32), np.float32(np.nan))
    last = codes[own[1:] - 1]
    wavelength = wavelengths[np.where(last < n_channels, last, n_channels)]

    source = portion.column("source")[rows]
    flux = np.array([entry.flux for entry in ray_map.directory.sources], np.float64)
    total = ray_map.emitted if emitted is None else emitted
    flux_per_ray = flux / np.maximum(total, 1)
    weight = ray_weights(portion, rows)
    ray_ids = portion.ray_ids()[rows]
    return DrawnRays(
        ray_ids=ray_ids,
        offsets=own,
        source=source,
        flux=flux_per_ray[source] * (1.0 if weight is None else weight),
        path=_paths(ray_map, portion_index, rows, ray_ids),
        wavelength=wavelength,
        position=portion.column("position")[records],
        event=portion.column("event")[records],
        object=portion.column("object")[records],
        rgb=rgb.astype(np.float32),
        index=index.astype(np.float32),
    )


def _paths(
    ray_map: RayMap, portion_index: int, rows: NDArray[np.int64], ray_ids: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Row of the merged paths that each ray took."""
    merged = ray_map.merged
    local = merged.local_to_global[portion_index] if merged is not None else None
    if local is None:
        return -1 - ray_ids
    return local[ray_map.portions[portion_index].path_numbers()[rows]].astype(np.int64)
