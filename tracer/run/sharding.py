"""Record on many machines: ranges of rays, each traced by one worker into a map of its own.

A worker needs nothing but this package: the compiled scene travels with the task. A shard appears
in the folder when it is complete, so a task that runs twice (its worker was lost, or thought to be)
does no harm. Numbers of rays and the seed say everything about a ray: the shards together hold the
rays that one machine would have recorded.
"""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from raymap.bytes.address import Address, place_of
from raymap.file.shards import SUFFIX
from raymap.model.errors import RayMapError, SceneError
from raymap.remote.cluster import TRIES, worker_count
from tracer.run.results import Progress, RecordResult
from tracer.run.shard_folder import begin_folder, owned_folder
from tracer.run.shard_tasks import Shard, ShardTask, pack, trace_shard
from tracer.run.trace import Trace
from tracer.run.traces import trace_of
from tracer.scene.compile import Compilation
from tracer.scene.model import Scene
from tracer.transport.counts import add_counts

__all__ = ["record_shards"]

LEAST_RAYS, MOST_RAYS = 2**13, 2**20
"""Rays of a shard, unless they are given."""


def record_shards(
    scene: str | Path | Scene | Compilation | Trace,
    folder: str | os.PathLike[str] | Address,
    executor: Executor,
    *,
    rays: int | None,
    seconds: float | None,
    seed: int | None,
    append: bool = False,
    force: bool = False,
    raw: bool = False,
    portion_rays: int | None = None,
    shard_rays: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Callable[[], bool] | None = None,
) -> RecordResult:
    """Trace a scene on the workers of an executor, into a folder of maps that opens as one.

    Parameters
    ----------
    scene : as for `record`
    folder : of the shards; also an address (``s3://bucket/lens``). Workers that do not see it send
        their shards back
    rays, seconds, seed, append, force, raw, portion_rays, progress, cancel : as for
        `record`
    shard_rays : rays per shard (emissions, where rays split); by default about four shards for
        each worker

    Raises
    ------
    SceneError, MapExists, MapLocked, SceneMismatch
    RayMapError
        The executor lost its workers; the shards that are complete are served.
    """
    trace = trace_of(scene)
    place = place_of(folder)
    if place.suffix == SUFFIX:
        raise SceneError(
            f"{str(place)!r}: an executor of many machines writes a folder of maps; name a folder, "
            f"without {SUFFIX}"
        )
    with owned_folder(place):
        first, known_seed = begin_folder(place, trace, append=append, force=force)
        chosen = known_seed if seed is None else seed
        spread = _SpreadTrace(
            trace, place, executor, first_ray=first, seed=chosen, rays=rays, seconds=seconds,
            raw=raw, portion_rays=portion_rays, shard_rays=shard_rays,
        )  # fmt: skip
        return spread.run(progress, cancel)


class _SpreadTrace:
    """Hands out ranges of rays, takes lost ones up again, adds results together."""

    def __init__(
        self,
        trace: Trace,
        place: Path | Address,
        executor: Executor,
        *,
        first_ray: int,
        seed: int,
        rays: int | None,
        seconds: float | None,
        raw: bool,
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
            scene=pack(trace),
            name="",
            first_ray=first_ray,
            rays=0,
            seed=seed,
            seconds=seconds,
            portion_rays=portion_rays,
            raw=raw,
            folder=place,
            probe=None,
            meshes=False,
        )
        self.done: dict[int, Shard] = {}
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
        pending: dict[Future[Shard], tuple[ShardTask, int]] = {}
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

    def _drop_queued(self, pending: dict[Future[Shard], tuple[ShardTask, int]]) -> None:
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
        self, task: ShardTask, tries: int, pending: dict[Future[Shard], tuple[ShardTask, int]]
    ) -> None:
        try:
            pending[self.executor.submit(trace_shard, task)] = task, tries
        except (BrokenExecutor, RuntimeError, OSError) as error:
            raise self._lost(task, error) from None

    def _take(
        self,
        future: Future[Shard],
        task: ShardTask,
        tries: int,
        pending: dict[Future[Shard], tuple[ShardTask, int]],
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

    def _put(self, shard: Shard) -> None:
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
    rays = sum(result.rays for result in results)
    counts = add_counts([result.counts for result in results])
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
        fluxes=counts.fluxes(),
        warnings=list(dict.fromkeys(note for result in results for note in result.warnings)),
        interrupted=interrupted,
        counts=counts,
    )


def _summed(tables: list[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    total: dict[str, dict[str, float]] = {}
    for table in tables:
        for name, row in table.items():
            own = total.setdefault(name, {})
            for key, value in row.items():
                own[key] = own.get(key, 0) + value
    return total
