"""Ask shards on the workers of an executor: each searches a map of its own, one adds them up.

The answers are those of a search here; what travels is criteria, sums and marked rays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.path_keys import Part
from query.engine.scan import Cancel, Progress, Scan
from query.engine.tally import Tally
from query.expression.spellings import as_criterion
from raymap.bytes.address import Address
from raymap.model.errors import NotARayMap, RayMapError
from raymap.remote.cluster import gather

if TYPE_CHECKING:
    from query.engine.bound import BoundNode
    from raymap.file.reader import RayMap

__all__ = [
    "Found",
    "ShardPaths",
    "ShardRays",
    "ShardTask",
    "opened_shard",
    "paths_of_shards",
    "scan_shards",
    "worth_spreading",
]


@dataclass(frozen=True, kw_only=True)
class Found:
    """What the shards together answered.

    Attributes
    ----------
    scan : as if the whole map had been searched here
    tally : rays and sums of weights per source
    emitted : (n_sources,) rays emitted in the portions that the answer speaks for
    portions_read, bytes_read : by the workers
    """

    scan: Scan
    tally: Tally
    emitted: NDArray[np.int64]
    portions_read: int
    bytes_read: int


@dataclass(frozen=True)
class ShardTask:
    """One shard to be asked."""

    place: Path | Address
    on_damage: str
    criterion: dict[str, Any] | None
    rays: bool = True
    limit: int | None = None
    by: str = "face"


@dataclass(frozen=True)
class ShardRays:
    """Answer of one shard: masks by its own portions, sums, and what could not be read."""

    masks: dict[int, NDArray[np.uint8]]
    tally: Tally
    emitted: NDArray[np.int64]
    portions_read: int
    bytes_read: int
    damaged: list[int]
    damage: list[Any]


@dataclass(frozen=True)
class ShardPaths:
    """Paths of one shard, by its own portions."""

    part: Part
    by_source: Tally
    emitted: NDArray[np.int64]
    damaged: list[int]
    damage: list[Any]


def worth_spreading(map: RayMap, executor: Executor | None) -> bool:
    """Whether there are shards that workers can open."""
    return executor is not None and len(map.shards) > 1


def scan_shards(
    map: RayMap,
    node: BoundNode,
    criterion: object,
    executor: Executor,
    *,
    rays: bool,
    limit: int | None,
    progress: Callable[[Progress], None] | None,
    cancel: Cancel,
    search: Callable[[ShardTask], ShardRays],
) -> Found:
    """Search every shard on a worker.

    Parameters
    ----------
    search : asks one shard; a function that workers can import

    Raises
    ------
    RayMapError
        The workers do not see the shards, or the executor failed.
    """
    tasks = _tasks(map, criterion, rays=rays, limit=limit)
    scan = Scan(map, [node], rays=rays, use_merged=False, cancel=cancel)
    places = _places(map)
    tally, emitted = Tally.zeros(scan.n_sources), np.zeros(scan.n_sources, np.int64)
    masks: dict[int, Sequence[NDArray[np.uint8]]] = {}
    answered: list[int] = []
    portions_read = bytes_read = 0
    for number, answer in gather(executor, search, tasks, scan.is_cancelled):
        own = places[number]
        answered.append(number)
        masks |= {own[index]: (mask,) for index, mask in answer.masks.items()}
        tally, emitted = tally + answer.tally, emitted + answer.emitted
        portions_read += answer.portions_read
        bytes_read += answer.bytes_read
        scan.damaged += [own[index] for index in answer.damaged]
        _note(map, number, answer.damage)
        if progress is not None:
            matched = int(tally.rays.sum())
            progress(Progress(len(answered), len(tasks), matched, bytes_read))
    scan.masks = {index: masks[index] for index in sorted(masks)}
    scan.complete = len(answered) == len(tasks)
    # Shards that did not answer are no part of the answer
    scan.open_portions = list(range(len(map.portions)))
    served = {index for number in answered for index in places[number]}
    scan.served = sorted(served - set(scan.damaged))
    return Found(
        scan=scan,
        tally=tally,
        emitted=emitted,
        portions_read=portions_read,
        bytes_read=bytes_read,
    )


def paths_of_shards(
    map: RayMap,
    criterion: object,
    by: str,
    executor: Executor,
    *,
    progress: Callable[[Progress], None] | None,
    cancel: Cancel,
    group: Callable[[ShardTask], ShardPaths],
) -> tuple[list[Part], Tally, NDArray[np.int64], bool]:
    """Grouped paths of every shard, sums by source, rays emitted, and whether all shards answered.

    Places of merged paths become -2 - the number of the shard.

    Parameters
    ----------
    group : asks one shard; a function that workers can import

    Raises
    ------
    RayMapError
        The workers do not see the shards, or the executor failed.
    """
    tasks = _tasks(map, criterion, by=by)
    places = _places(map)
    n_sources = len(map.directory.sources)
    by_source, emitted = Tally.zeros(n_sources), np.zeros(n_sources, np.int64)
    parts: dict[int, Part] = {}
    stop = Scan(map, [], use_merged=False, cancel=cancel).is_cancelled
    for number, answer in gather(executor, group, tasks, stop):
        own = np.array([*places[number], -2 - number], np.int64)
        rows = answer.part.places.copy()
        rows[:, 0] = own[rows[:, 0]]
        parts[number] = replace(answer.part, places=rows)
        by_source, emitted = by_source + answer.by_source, emitted + answer.emitted
        _note(map, number, answer.damage)
        if progress is not None:
            progress(Progress(len(parts), len(tasks), int(by_source.rays.sum()), 0))
    ordered = [parts[number] for number in sorted(parts)]
    return ordered, by_source, emitted, len(parts) == len(tasks)


# -- here ----------------------------------------------------------------------------------------


def _places(map: RayMap) -> list[list[int]]:
    """Per shard the index in the whole map of each of its portions."""
    index = {id(portion): number for number, portion in enumerate(map.portions)}
    return [[index[id(portion)] for portion in shard.portions] for shard in map.shards]


def _tasks(map: RayMap, criterion: object, **options: Any) -> list[ShardTask]:
    tree = as_criterion(criterion)
    plain = None if tree is None else tree.to_json()
    tasks = []
    for shard in map.shards:
        place = shard.path if isinstance(shard.path, Address) else shard.path.resolve()
        tasks.append(ShardTask(place, map.on_damage, plain, **options))
    return tasks


def _note(map: RayMap, number: int, damage: list[Any]) -> None:
    for each in damage:
        map.shards[number].note_damage(each)


# -- on a worker ---------------------------------------------------------------------------------


def opened_shard(task: ShardTask) -> RayMap:
    from raymap.file.opening import open as open_map

    on_damage: Any = task.on_damage
    try:
        return open_map(task.place, on_damage=on_damage)
    except NotARayMap as error:
        raise RayMapError(
            f"a worker cannot open a shard ({error}): put the shards into a folder that all "
            "machines share, or on object storage"
        ) from None
