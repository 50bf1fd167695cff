"""Record on many machines: ranges of rays, each traced by one worker into a map of its own.

A worker needs nothing but this package: the compiled scene travels with the task. A shard appears
in the folder when it is complete, so a task that runs twice (its worker was lost, or thought to be)
does no harm. Numbers of rays and the seed say everything about a ray: the shards together hold the
rays that one machine would have recorded.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import secrets
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zstandard

from raymap.address import Address, place_of
from raymap.cluster import TRIES, worker_count
from raymap.errors import MapExists, MapLocked, RayMapError, SceneError, SceneMismatch
from raymap.locking import try_lock
from raymap.opening import open as open_map
from raymap.resume import scene_difference
from raymap.shards import SUFFIX, shard_paths
from raymap.writer import RayMapWriter
from tracer.scene.arrays import R_RAYS, R_SPLITS, CompiledScene

if TYPE_CHECKING:
    from tracer.record import Progress, RecordResult
    from tracer.scene.compile import Compilation

__all__ = ["ShardTask", "record_shards", "trace_shard"]

LEAST_RAYS, MOST_RAYS = 2**13, 2**20
"""Rays of a shard, unless they are given."""


@dataclass(frozen=True, kw_only=True)
class ShardTask:
    """One shard to trace; all that a worker needs to know.

    Attributes
    ----------
    scene : the packed compilation
    name : of the file
    first_ray, rays, seed : which rays (emissions, where rays split)
    seconds : stop after so long, or None
    folder : where it is written: a path, an `Address`, or None to send it back
    probe : a file in the folder by which a worker knows that it sees the same folder
    meshes : store display meshes
    """

    scene: bytes
    name: str
    first_ray: int
    rays: int
    seed: int
    seconds: float | None
    portion_rays: int | None
    raw: bool
    compact: bool
    folder: Path | Address
    probe: str | None
    meshes: bool


@dataclass(frozen=True, kw_only=True)
class _Shard:
    """What a worker answers: counts, and the file where it could not put it into the folder."""

    name: str
    result: RecordResult
    size: int
    data: bytes | None


def record_shards(
    compilation: Compilation,
    folder: str | os.PathLike[str] | Address,
    executor: Executor,
    *,
    rays: int | None,
    seconds: float | None,
    seed: int | None,
    append: bool = False,
    force: bool = False,
    raw: bool = False,
    compact: bool = False,
    portion_rays: int | None = None,
    shard_rays: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Callable[[], bool] | None = None,
) -> RecordResult:
    """Trace a scene on the workers of an executor, into a folder of maps that opens as one.

    Parameters
    ----------
    folder : of the shards; also an address (``s3://bucket/lens``). Workers that do not see it send
        their shards back
    rays, seconds, seed, append, force, raw, compact, portion_rays, progress, cancel : as for
        `record`
    shard_rays : rays per shard (emissions, where rays split); by default about four shards for
        each worker

    Raises
    ------
    SceneError, MapExists, MapLocked, SceneMismatch
    RayMapError
        The executor lost its workers; the shards that are complete are served.
    """
    place = place_of(folder)
    if place.suffix == SUFFIX:
        raise SceneError(
            f"{str(place)!r}: an executor of many machines writes a folder of maps; name a folder, "
            f"without {SUFFIX}"
        )
    with _owned(place):
        first, known_seed = _begin(place, compilation, append=append, force=force)
        chosen = known_seed if seed is None else seed
        trace = _SpreadTrace(
            compilation, place, executor, first_ray=first, seed=chosen, rays=rays, seconds=seconds,
            raw=raw, compact=compact, portion_rays=portion_rays, shard_rays=shard_rays,
        )  # fmt: skip
        return trace.run(progress, cancel)


# -- the folder --------------------------------------------------------------------------------


@contextmanager
def _owned(place: Path | Address) -> Iterator[None]:
    """Hold a local folder for one recording at a time."""
    if isinstance(place, Address):
        yield
        return
    try:
        place.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise MapExists(
            f"{str(place)!r} is a file; an executor of many machines writes a folder of maps: "
            "choose another name"
        ) from None
    except OSError as error:
        raise RayMapError(f"folder {place} cannot be made: {error.strerror}") from None
    if os.name == "nt":  # pragma: no cover
        yield
        return
    descriptor = os.open(place, os.O_RDONLY)
    try:
        if not try_lock(descriptor):
            raise MapLocked(
                f"another program records into {place}: wait until it ends, or name another folder"
            )
        yield
    finally:
        os.close(descriptor)


def _begin(
    place: Path | Address, compilation: Compilation, *, append: bool, force: bool
) -> tuple[int, int]:
    """(first ray, seed where none is given); refuses or removes what is there."""
    from tracer.record import DEFAULT_SEED

    there = _shards_in(place)
    if not there:
        return 0, DEFAULT_SEED
    if append:
        with open_map(there, on_damage="skip") as known:
            difference = scene_difference(known.directory, compilation.directory)
            if difference:
                raise SceneMismatch(f"{place} was recorded from another scene: {difference}")
            after = max((p.last_ray + 1 for p in known.portions if p.n_rays), default=0)
            first = -(-after // fan(compilation.arrays))
            seeds = [run["seed"] for run in known.runs if run.get("seed") is not None]
        return first, int(seeds[-1]) if seeds else DEFAULT_SEED
    if not force:
        raise MapExists(
            f"{str(place)!r} holds {len(there)} maps and stays as it is; continue with --append, "
            "write over them with --force, or choose another name"
        )
    for each in there:
        _remove(each)
    return 0, DEFAULT_SEED


def _shards_in(place: Path | Address) -> list[Any]:
    from raymap.errors import NotARayMap

    with suppress(NotARayMap):
        if isinstance(place, Address):
            from raymap.remotebytes import map_addresses

            return map_addresses(place, SUFFIX) or []
        return list(shard_paths(place))
    return []


def _remove(shard: Path | Address) -> None:
    if isinstance(shard, Address):
        from raymap.remotebytes import file_system

        system, path = file_system(shard)
        system.rm(path)
    else:
        shard.unlink()


# -- the side that hands out -------------------------------------------------------------------


class _SpreadTrace:
    """Hands out ranges of rays, takes lost ones up again, adds results together."""

    def __init__(
        self,
        compilation: Compilation,
        place: Path | Address,
        executor: Executor,
        *,
        first_ray: int,
        seed: int,
        rays: int | None,
        seconds: float | None,
        raw: bool,
        compact: bool,
        portion_rays: int | None,
        shard_rays: int | None,
    ) -> None:
        self.place, self.executor = place, executor
        self.first_ray, self.seed = first_ray, seed
        self.rays, self.seconds = rays, seconds
        self.workers = worker_count(executor)
        share = MOST_RAYS if rays is None else -(-rays // (4 * self.workers))
        self.shard_rays = shard_rays or max(LEAST_RAYS, min(MOST_RAYS, share))
        self.probe: str | None = None
        self.task = ShardTask(
            scene=pack(compilation),
            name="",
            first_ray=first_ray,
            rays=0,
            seed=seed,
            seconds=seconds,
            portion_rays=portion_rays,
            raw=raw,
            compact=compact,
            folder=place,
            probe=None,
            meshes=False,
        )
        self.done: dict[int, _Shard] = {}
        self.planned = 0

    def run(
        self, progress: Callable[[Progress], None] | None, cancel: Callable[[], bool] | None
    ) -> RecordResult:
        """Trace everything; what is complete stays, whatever happens."""
        began = time.perf_counter()
        with self._probed():
            interrupted = self._trace(began, progress, cancel)
        results = [self.done[first].result for first in sorted(self.done)]
        if not results:
            raise RayMapError("the recording was stopped before any rays were traced")
        return _joined(
            results,
            bytes=sum(shard.size for shard in self.done.values()),
            seconds=time.perf_counter() - began,
            workers=self.workers,
            interrupted=interrupted,
        )

    @contextmanager
    def _probed(self) -> Iterator[None]:
        """A file by which workers know the folder; leftovers of lost workers go with it."""
        if isinstance(self.place, Address):
            yield
            return
        probe = self.place / f".probe-{secrets.token_hex(8)}"
        probe.touch()
        self.task = replace(self.task, probe=probe.name)
        try:
            yield
        finally:
            for left in [probe, *self.place.glob(".*.part")]:
                with suppress(OSError):
                    left.unlink()

    def _trace(
        self,
        began: float,
        progress: Callable[[Progress], None] | None,
        cancel: Callable[[], bool] | None,
    ) -> bool:
        """True if it was stopped before its end."""
        pending: dict[Future[_Shard], tuple[ShardTask, int]] = {}
        stopped = False
        while True:
            try:
                while not stopped and len(pending) < 2 * self.workers:
                    if cancel is not None and cancel():
                        stopped = True
                        break
                    task = self._next(began)
                    if task is None:
                        break
                    self._submit(task, 1, pending)
                if not pending:
                    return stopped
                finished, _ = wait(pending, timeout=0.5, return_when=FIRST_COMPLETED)
                if not stopped and cancel is not None and cancel():
                    stopped = True
                    self._drop_queued(pending)
                for future in finished:
                    task, tries = pending.pop(future)
                    if future.cancelled():
                        continue
                    self._take(future, task, tries, pending)
                    if progress is not None:
                        progress(self._progress(began))
            except KeyboardInterrupt:
                stopped = True
                self._drop_queued(pending)
            except BaseException:
                self._drop_queued(pending)
                raise

    def _drop_queued(self, pending: dict[Future[_Shard], tuple[ShardTask, int]]) -> None:
        """What is under way is finished and kept, what is only queued is dropped."""
        for future in [each for each in pending if each.cancel()]:
            del pending[future]

    def _next(self, began: float) -> ShardTask | None:
        left = None
        if self.seconds is not None:
            left = self.seconds - (time.perf_counter() - began)
            if left <= 0.0:
                return None
        n = self.shard_rays
        if self.rays is not None:
            n = min(n, self.rays - self.planned)
            if n == 0:
                return None
        first = self.first_ray + self.planned
        self.planned += n
        return replace(
            self.task,
            name=f"rays-{first:012d}{SUFFIX}",
            first_ray=first,
            rays=n,
            seconds=left,
            meshes=first == 0,
        )

    def _submit(
        self, task: ShardTask, tries: int, pending: dict[Future[_Shard], tuple[ShardTask, int]]
    ) -> None:
        try:
            pending[self.executor.submit(trace_shard, task)] = task, tries
        except (BrokenExecutor, RuntimeError, OSError) as error:
            raise self._lost(task, error) from None

    def _take(
        self,
        future: Future[_Shard],
        task: ShardTask,
        tries: int,
        pending: dict[Future[_Shard], tuple[ShardTask, int]],
    ) -> None:
        try:
            shard = future.result()
        except RayMapError:
            raise
        except Exception as error:  # every kind of executor loses workers in its own way
            if tries >= TRIES or isinstance(error, BrokenExecutor):
                raise self._lost(task, error) from None
            self._submit(task, tries + 1, pending)
            return
        if shard.data is not None:
            self._put(shard)
        self.done[task.first_ray] = replace(shard, data=None)

    def _put(self, shard: _Shard) -> None:
        """Write a shard that was sent back."""
        assert shard.data is not None
        assert isinstance(self.place, Path)
        beside = self.place / f".{shard.name}.{secrets.token_hex(4)}.part"
        try:
            beside.write_bytes(shard.data)
            os.replace(beside, self.place / shard.name)
        except OSError as error:
            raise RayMapError(f"{self.place / shard.name} cannot be written: {error}") from None

    def _lost(self, task: ShardTask, error: BaseException) -> RayMapError:
        traced = sum(shard.result.rays for shard in self.done.values())
        line = " ".join(str(error).split()) or "no reason given"
        return RayMapError(
            f"rays {task.first_ray} to {task.first_ray + task.rays - 1} could not be traced: the "
            f"executor failed ({type(error).__name__}: {line[:300]}); {traced} rays are complete "
            f"in {self.place}: see that the workers have Raymap and memory enough, and go on with "
            "--append"
        )

    def _progress(self, began: float) -> Progress:
        from tracer.record import Progress

        shards = self.done.values()
        return Progress(
            rays=sum(shard.result.rays for shard in shards),
            records=sum(shard.result.records for shard in shards),
            seconds=time.perf_counter() - began,
            bytes=sum(shard.size for shard in shards),
            total_rays=self.rays,
            total_seconds=self.seconds,
        )


def _joined(
    results: list[RecordResult], *, bytes: int, seconds: float, workers: int, interrupted: bool
) -> RecordResult:
    """One result of many."""
    from tracer.record import RecordResult

    rays = sum(result.rays for result in results)
    detectors = {
        name: tuple(sum(result.detectors[name][k] for result in results) for k in range(2))
        for name in results[0].detectors
    }
    return RecordResult(
        rays=rays,
        records=sum(result.records for result in results),
        seconds=seconds,
        rays_per_second=rays / seconds if seconds > 0.0 else 0.0,
        bytes=bytes,
        threads=workers,
        seed=results[0].seed,
        audit=_summed([result.audit for result in results]),
        absorbed_by=_summed([result.absorbed_by for result in results]),
        warnings=list(dict.fromkeys(note for result in results for note in result.warnings)),
        interrupted=interrupted,
        detectors=detectors,
    )


def _summed(tables: list[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    total: dict[str, dict[str, float]] = {}
    for table in tables:
        for name, row in table.items():
            own = total.setdefault(name, {})
            for key, value in row.items():
                own[key] = own.get(key, 0) + value
    return total


# -- the side that traces ----------------------------------------------------------------------

_compilations: dict[str, Compilation] = {}
_compiling = threading.Lock()


def fan(scene: CompiledScene) -> int:
    """Ray numbers that an emission takes: several where rays split."""
    if scene.rare is None or scene.rare.settings[R_SPLITS] <= 0.0:
        return 1
    return int(scene.rare.settings[R_RAYS])


def pack(compilation: Compilation) -> bytes:
    """A compilation as bytes, for workers of the same version."""
    return zstandard.compress(pickle.dumps(compilation, protocol=5), 3)


def _unpacked(scene: bytes) -> Compilation:
    """The scene of a task; the last one is kept, as most tasks have the same."""
    key = hashlib.sha256(scene).hexdigest()
    with _compiling:
        if key not in _compilations:
            _compilations.clear()
            _compilations[key] = pickle.loads(zstandard.decompress(scene))
        return _compilations[key]


def trace_shard(task: ShardTask) -> _Shard:
    """Trace the rays of a task and write them as a map (on a worker)."""
    if isinstance(task.folder, Path) and task.probe and (task.folder / task.probe).exists():
        part = task.folder / f".{task.name}.{secrets.token_hex(4)}.part"
        try:
            result = _trace_into(task, part)
            size = part.stat().st_size
            os.replace(part, task.folder / task.name)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)
        return _Shard(name=task.name, result=result, size=size, data=None)
    with tempfile.TemporaryDirectory(prefix="raymap-") as own:
        part = Path(own) / task.name
        result = _trace_into(task, part)
        data = part.read_bytes()
    if isinstance(task.folder, Address):
        from raymap.remotebytes import upload

        upload(data, task.folder / task.name)
        return _Shard(name=task.name, result=result, size=len(data), data=None)
    return _Shard(name=task.name, result=result, size=len(data), data=data)


def _trace_into(task: ShardTask, path: Path) -> RecordResult:
    from tracer.record import run_into

    compilation = _unpacked(task.scene)
    with (
        warnings.catch_warnings(),
        RayMapWriter.create(
            path,
            compilation.directory,
            meshes=compilation.meshes if task.meshes else {},
            raw=task.raw,
            compact=task.compact,
            trusted=True,
            first_ray=task.first_ray * fan(compilation.arrays),
        ) as writer,
    ):
        # What there is to warn of stands in the result
        warnings.simplefilter("ignore")
        return run_into(
            compilation,
            writer,
            rays=task.rays,
            seconds=task.seconds,
            seed=task.seed,
            portion_rays=task.portion_rays,
        )
