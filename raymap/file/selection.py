"""Save some rays of a map as a map: numbers, columns and emitted counts are kept."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.file.reader import RayMap
from raymap.file.stored import StoredPortion
from raymap.file.writer import RayMapWriter
from raymap.model.errors import DamagedPortion
from raymap.model.portion import Portion, empty_portion
from raymap.model.replacing import refuse_existing, replacing
from raymap.model.rows import can_join, join_portions, take_rays
from raymap.model.schema import PORTION_RAYS, PORTION_RECORDS

__all__ = ["copy_selection", "places_in"]


def copy_selection(
    ray_map: RayMap,
    ray_ids: NDArray[np.int64],
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    description: str = "",
) -> int:
    """Write the rays of the given numbers as a map of their own.

    The new map is a full ray map: original ray numbers, all columns, and the emitted counts of the
    whole parent, so that fluxes come out the same.

    Parameters
    ----------
    ray_ids : increasing; numbers that the map does not hold are left out
    force : replace an existing file
    description : of the selection, for people; kept with the run

    Returns
    -------
    n : rays written

    Raises
    ------
    MapExists, NotWritten, NoRays
    """
    ray_map.need_rays()
    target = Path(path)
    refuse_existing(target, force=force)
    wanted = np.unique(np.asarray(ray_ids, np.int64))
    with (
        replacing(target) as temporary,
        RayMapWriter.create(
            temporary, ray_map.directory, meshes=ray_map.meshes, trusted=True
        ) as writer,
    ):
        for channel_set in ray_map.channel_sets:
            writer.add_channel_set(channel_set)
        seeds = [run.get("seed") for run in ray_map.runs]
        writer.start_run(
            seed=seeds[0] if len(set(seeds)) == 1 else None,
            parameters={"selection_of": str(ray_map.path), "selection": description},
        )
        written = 0
        for portion in _joined(_selected(ray_map, wanted)):
            writer.append(portion)
            written += portion.n_rays
        writer.finish()
    return written


def places_in(portion: StoredPortion, wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """Places in the portion of those of the increasing ray numbers that it holds."""
    low = np.searchsorted(wanted, portion.first_ray)
    high = np.searchsorted(wanted, portion.last_ray, side="right")
    inside = wanted[low:high]
    if not len(inside):
        return inside
    ids = portion.ray_ids()
    places = np.searchsorted(ids, inside)
    found = ids[np.minimum(places, len(ids) - 1)] == inside
    kept: NDArray[np.int64] = places[found].astype(np.int64)
    return kept


def _selected(ray_map: RayMap, wanted: NDArray[np.int64]) -> Iterator[Portion]:
    """The wanted rays portion by portion; portions without any give their emitted counts."""
    emitted = np.zeros(len(ray_map.directory.sources), np.int64)
    last: Portion | None = None
    for stored in ray_map.portions:
        try:
            places = places_in(stored, wanted)
            if len(places):
                ids = stored.ray_ids()[places]
                taken = take_rays(stored.read(), places, ids)
            else:
                taken = None
        except DamagedPortion:
            if ray_map.on_damage == "raise":
                raise
            continue
        if taken is None:
            emitted += stored.emitted
            continue
        if last is not None:
            yield last
        last = taken
    if last is None:
        last = _empty(ray_map)
    # The emitted counts of portions without a wanted ray go with the last one
    yield _with_emitted(last, last.emitted + emitted)


def _with_emitted(portion: Portion, emitted: NDArray[np.int64]) -> Portion:
    return dataclasses.replace(portion, emitted=emitted)


def _empty(ray_map: RayMap) -> Portion:
    """A portion without rays."""
    channels = ray_map.channel_sets[0].n_channels if ray_map.channel_sets else 3
    return empty_portion(np.zeros(len(ray_map.directory.sources), np.int64), channels)


def _joined(portions: Iterator[Portion]) -> Iterator[Portion]:
    """Portions of the usual size from small ones."""
    waiting: list[Portion] = []
    rays = records = 0
    for portion in portions:
        full = rays + portion.n_rays > PORTION_RAYS or records + portion.n_records > PORTION_RECORDS
        if waiting and (full or not can_join(waiting[0], portion)):
            yield join_portions(waiting)
            waiting, rays, records = [], 0, 0
        waiting.append(portion)
        rays += portion.n_rays
        records += portion.n_records
    if waiting:
        yield join_portions(waiting) if len(waiting) > 1 else waiting[0]
