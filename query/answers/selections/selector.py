"""The rays that satisfy a criterion: `select` and several at once, `select_many`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from query.answers.selections.reasons import reason_for_nothing
from query.answers.selections.selection import Selection
from query.answers.selections.sharded import (
    ShardRays,
    ShardTask,
    opened_shard,
    scan_shards,
    worth_spreading,
)
from query.engine.bind import Binder
from query.engine.bound import BoundNode
from query.engine.logic import BoundEverything
from query.engine.scan import Cancel, Progress, Scan, map_facts
from query.engine.second_try import asked_again
from query.engine.tally import Tally
from query.expression.spellings import as_criterion
from raymap.model.errors import CriterionError
from raymap.optics.photometry import ray_weights

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

Ids = NDArray[np.int64]

__all__ = ["bind_all", "select", "select_many"]


def bind_all(map: RayMap, criteria: Sequence[object]) -> list[BoundNode]:
    """Bind criteria in any spelling to a map; None stands for every ray."""
    binder = Binder(map_facts(map))
    bound: list[BoundNode] = []
    for spelling in criteria:
        node = as_criterion(spelling)
        if node is None:
            bound.append(BoundEverything())
        else:
            bound.append(binder.bind(node, spelling if isinstance(spelling, str) else None))
    return bound


@asked_again
def select(
    map: RayMap,
    criterion: object = None,
    *,
    limit: int | None = None,
    rays: bool = True,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
    threads: int | None = None,
    use_merged: bool = True,
    executor: Executor | None = None,
) -> Selection:
    """Find the rays of a map that satisfy a criterion.

    Parameters
    ----------
    map : an open ray map
    criterion : text, tree or JSON; None selects every ray
    limit : only the rays with the smallest numbers, this many; stops early
    rays : find the ray numbers too; without them a count often needs no portion at all, and the
        numbers are found when they are asked for
    progress : called with a `Progress` after each portion
    cancel : an Event or a function; once it is set or true the search stops within a portion and
        what was found so far is returned, with ``complete`` False
    threads : default: the cores this process may use
    use_merged : False ignores the merged dictionary; the answer is the same
    executor : searches the shards of a map on its workers (Dask's ``client.get_executor()``, a
        process pool), which must see the files; progress then counts shards

    Raises
    ------
    CriterionError, UnknownName
        the criterion cannot be read or does not fit the map.
    DamagedPortion
        unless the map was opened with ``on_damage="skip"``.
    """
    start = time.perf_counter()
    if limit is not None and limit < 1:
        raise CriterionError(f"limit must be at least 1, found {limit}")
    [node] = bind_all(map, [criterion])
    if executor is not None and worth_spreading(map, executor):
        return _spread(map, node, criterion, executor, limit, rays, progress, cancel, start)
    scan = Scan(
        map,
        [node],
        rays=rays or limit is not None,
        threads=threads,
        progress=progress,
        cancel=cancel,
        use_merged=use_merged,
    )
    if limit is None:
        [totals] = scan.run()
        selection = Selection(map, node, criterion, scan, 0, totals.by_source, scan.emitted)
    else:
        selection = _first(scan, node, criterion, limit)
    selection.seconds = time.perf_counter() - start
    if selection.matched == 0 and selection.complete:
        selection.reason = reason_for_nothing(scan, node)
    return selection


def _spread(
    map: RayMap,
    node: BoundNode,
    criterion: object,
    executor: Executor,
    limit: int | None,
    rays: bool,
    progress: Callable[[Progress], None] | None,
    cancel: Cancel,
    start: float,
) -> Selection:
    """The selection of a sharded map, searched by the workers of an executor."""
    found = scan_shards(
        map, node, criterion, executor, rays=rays or limit is not None, limit=limit,
        progress=progress, cancel=cancel, search=_search,
    )  # fmt: skip
    scan, tally, limited = found.scan, found.tally, False
    if limit is not None and tally.rays.sum() >= limit:
        # Every shard sent its own smallest numbers: keep the smallest of all
        numbers = [
            (index, map.portions[index].ray_ids()[scan.rays_of(index, 0)]) for index in scan.masks
        ]
        joined = np.concatenate([ids for _, ids in numbers])
        reach = int(np.partition(joined, limit - 1)[limit - 1])
        tally, limited = _trim(scan, numbers, reach), True
    selection = Selection(map, node, criterion, scan, 0, tally, found.emitted)
    selection.limited = limited
    selection.portions_read, selection.bytes_read = found.portions_read, found.bytes_read
    selection.seconds = time.perf_counter() - start
    if selection.matched == 0 and selection.complete:
        selection.reason = reason_for_nothing(Scan(map, [node]), node)
    return selection


def _search(task: ShardTask) -> ShardRays:
    """The selection of one shard, on a worker."""
    with opened_shard(task) as shard:
        found = select(shard, task.criterion, limit=task.limit, rays=task.rays, threads=1)
        scan = found._scan
        return ShardRays(
            masks={index: masks[0] for index, masks in scan.masks.items()},
            tally=found.tally,
            emitted=found.emitted,
            portions_read=found.portions_read,
            bytes_read=shard.bytes_read,
            damaged=list(scan.damaged),
            damage=list(shard.damage),
        )


@asked_again
def select_many(
    map: RayMap,
    criteria: Sequence[object],
    *,
    rays: bool = True,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
    threads: int | None = None,
) -> list[Selection]:
    """Several criteria in one pass over the map; parameters as for `select`."""
    start = time.perf_counter()
    nodes = bind_all(map, criteria)
    scan = Scan(map, nodes, rays=rays, threads=threads, progress=progress, cancel=cancel)
    all_totals = scan.run()
    seconds = time.perf_counter() - start
    selections = []
    for number, totals in enumerate(all_totals):
        selection = Selection(
            map, nodes[number], criteria[number], scan, number, totals.by_source, scan.emitted
        )
        selection.seconds = seconds
        if selection.matched == 0 and selection.complete:
            selection.reason = reason_for_nothing(scan, nodes[number])
        selections.append(selection)
    return selections


def _first(scan: Scan, node: BoundNode, criterion: object, limit: int) -> Selection:
    """The rays with the smallest numbers; stops when no later portion can hold one of them."""
    portions = scan.map.portions
    wanted = scan.open_portions
    found: list[tuple[int, Ids]] = []
    count, reach = 0, None
    for visit in scan.visits(everything=True):
        rays = scan.rays_of(visit.index, 0)
        if len(rays):
            found.append((visit.index, portions[visit.index].ray_ids()[rays]))
            count += len(rays)
        scan.report(count)
        if count < limit:
            continue
        if len(rays):
            ids = np.concatenate([numbers for _, numbers in found])
            reach = int(np.partition(ids, limit - 1)[limit - 1])
        done = len(scan.served) + len(scan.damaged)
        if done >= len(wanted) or (reach is not None and portions[wanted[done]].first_ray > reach):
            break
    tally = _trim(scan, found, reach)
    lost = set(scan.damaged)
    emitted = np.zeros(scan.n_sources, np.int64)
    for index, portion in enumerate(portions):
        if index not in lost:
            emitted += portion.emitted
    selection = Selection(scan.map, node, criterion, scan, 0, tally, emitted)
    selection.limited = reach is not None
    return selection


def _trim(scan: Scan, found: list[tuple[int, Ids]], reach: int | None) -> Tally:
    """Keep the rays up to number ``reach`` and count them."""
    tally = Tally.zeros(scan.n_sources)
    masks: dict[int, Sequence[NDArray[np.uint8]]] = {}
    for index, ids in found:
        portion = scan.map.portions[index]
        rays = scan.rays_of(index, 0)
        kept = rays if reach is None else rays[ids <= reach]
        mask = np.zeros(portion.n_rays, np.bool_)
        mask[kept] = True
        masks[index] = (np.packbits(mask),)
        source = portion.column("source")[kept]
        weight = ray_weights(portion, kept)
        emission = portion.column("emission")[kept] if portion.grouped else None
        tally = tally + Tally.of_rays(source, weight, emission, scan.n_sources)
    scan.masks = masks
    return tally
