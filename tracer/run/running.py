"""One run of a trace: portions handed out to threads, committed in number order."""

from __future__ import annotations

import time
import warnings
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

import raymap
from raymap.encoding.encoder import EncodedPortion
from raymap.file.writer import RayMapWriter
from raymap.model.directory import ChannelSet
from raymap.model.portion import Portion
from raymap.model.schema import PORTION_RECORDS
from raymap.optics.cells import is_pinhole
from tracer.run.pieces import copied, split_portion
from tracer.run.results import (
    OtherChannels,
    Progress,
    RecordResult,
    StoppedLight,
    UnevenWeights,
    stopped_notes,
    uneven_notes,
)
from tracer.run.trace import TRANSPORT_LAW, Trace
from tracer.transport.counts import Counts, DetectorCount
from tracer.transport.tally import Tally

__all__ = ["DEFAULT_SEED", "Run", "run_into", "run_statistics"]

DEFAULT_SEED = 1
_PILOT_RAYS = 1024


def run_into(
    trace: Trace,
    writer: RayMapWriter,
    *,
    rays: int,
    seconds: float | None,
    seed: int,
    portion_rays: int | None,
) -> RecordResult:
    """Trace the rays from the writer's next one on, on one thread (a shard of a larger trace)."""
    return Run(trace, writer, rays, seconds, seed, 1, portion_rays, None).go(None)


def _other_channels(writer: RayMapWriter, channels: ChannelSet) -> list[str]:
    """What to say where the light of a map so far has other channels."""
    mine = channels.kind, channels.wavelengths_nm
    before = [own for own in writer.channel_sets if (own.kind, own.wavelengths_nm) != mine]
    if not before:
        return []
    return [
        f"the map's light so far has the channels {before[0].said}, that of this trace "
        f"{channels.said}: rays are counted together, but pictures of detectors are refused; "
        "record a map of its own for them"
    ]


class Run:
    """One trace: hands out portions, collects them in order."""

    cancel: Callable[[], bool] | None = None

    def __init__(
        self,
        trace: Trace,
        writer: RayMapWriter | None,
        rays: int | None,
        seconds: float | None,
        seed: int | None,
        threads: int,
        portion_rays: int | None,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self.trace = trace
        self.writer = writer
        self.rays, self.seconds = rays, seconds
        self.threads = threads
        self.progress = progress
        self.seed = self._seed(seed)
        self.engine = trace.engine(self.seed)
        self.tally = Tally(trace.directory, trace.channel_set)
        self.pinholes = trace.pinholes()
        self.other_channels = _other_channels(writer, trace.channel_set) if writer else []
        self.channel_set = writer.add_channel_set(trace.channel_set) if writer else 0
        fitting = self._fitting_rays()
        self.portion_rays = portion_rays or fitting
        # Where rays split, emission e has the ray numbers from e times max_branches on
        self.first_ray = -(-writer.next_ray // trace.max_branches) if writer else 0

    def _seed(self, seed: int | None) -> int:
        if seed is not None:
            return seed
        runs = self.writer.runs if self.writer else []
        known = [run["seed"] for run in runs if run.get("seed") is not None]
        return int(known[-1]) if known else DEFAULT_SEED

    def _fitting_rays(self) -> int:
        """Rays whose records surely fit a portion, judged by a few rays traced for it."""
        splits = self.trace.max_branches > 1
        rays = max(64, _PILOT_RAYS // self.trace.max_branches)
        pilot = self.engine.trace(0, rays, reuse=True)
        if self.writer:
            self.writer.encode(self._traced(0, rays), 0)
        fitting = 0.8 * PORTION_RECORDS * rays / pilot.n_records
        most = min(self.trace.most_rays, 1 << int(np.log2(fitting)))
        return max(1 if splits else 64, most)

    def go(self, executor: Executor | None) -> RecordResult:
        if self.writer:
            self.writer.start_run(
                seed=self.seed,
                parameters={
                    "threads": self.threads,
                    "portion_rays": self.portion_rays,
                    "raymap": raymap.__version__,
                    "transport_law": TRANSPORT_LAW,
                    **self.trace.parameters,
                },
            )
        began = time.perf_counter()
        interrupted = False
        pool = executor or ThreadPoolExecutor(self.threads, thread_name_prefix="tracer")
        try:
            interrupted = self._trace(pool, began)
        finally:
            if executor is None:
                pool.shutdown(wait=True, cancel_futures=True)
        notes = self._notes()
        counts = self._counts()
        if self.writer:
            for k in range(len(self.trace.directory.detectors)):
                sums, sums2 = counts.stored_sums(k)
                self.writer.add_detector_result(
                    k, sums, sums2, channel_set=self.channel_set, owned=True
                )
        elapsed = time.perf_counter() - began
        if self.writer:
            self.writer.finish(
                run_statistics(self.tally.rays, elapsed, self.tally.audit(), interrupted)
            )
            elapsed = time.perf_counter() - began
        for note in notes:
            warnings.warn(note, StoppedLight, stacklevel=3)
        for note in self.other_channels:
            warnings.warn(note, OtherChannels, stacklevel=3)
        uneven = self._uneven(counts.detectors)
        for note in uneven:
            warnings.warn(note, UnevenWeights, stacklevel=3)
        return RecordResult(
            rays=self.tally.rays,
            records=self.tally.records,
            seconds=elapsed,
            rays_per_second=self.tally.rays / elapsed if elapsed > 0.0 else 0.0,
            bytes=self.writer.bytes_written if self.writer else 0,
            threads=self.threads,
            seed=self.seed,
            audit=self.tally.audit(),
            absorbed_by=self.tally.absorbed_by(),
            fluxes=counts.fluxes(),
            warnings=[*notes, *self.other_channels, *uneven],
            interrupted=interrupted,
            counts=counts,
        )

    def _uneven(self, counted: dict[str, DetectorCount]) -> list[str]:
        """What is said of detectors whose light few polarised rays carry.

        Connections of pinholes weigh by their places besides: nothing can be said of them.
        """
        if not self.trace.parameters.get("polarised"):
            return []
        pinholes = {item.name for item in self.trace.directory.detectors if is_pinhole(item)}
        return uneven_notes({name: counted[name] for name in counted if name not in pinholes})

    def _counts(self) -> Counts:
        """What was counted in this run, with the pictures of pinholes."""
        counts = self.tally.counts()
        if self.pinholes:
            counts.detectors.update(self.pinholes.counts(self.tally.emitted))
        return counts

    def _trace(self, pool: Executor, began: float) -> bool:
        """Keep every thread busy; commit in order. True if Ctrl-C stopped it."""
        pending: deque[tuple[int, int, Future[EncodedPortion | list[Portion] | None]]] = deque()
        planned = 0
        number = self.writer.next_portion if self.writer else 0
        interrupted = False
        while True:
            try:
                if not interrupted and self.cancel is not None and self.cancel():
                    raise KeyboardInterrupt
                while not interrupted and len(pending) < 2 * self.threads + 2:
                    n = self._next_size(planned, began)
                    if n == 0:
                        break
                    first = self.first_ray + planned
                    pending.append((first, n, pool.submit(self._portion, first, n, number)))
                    planned += n
                    number += 1
                if not pending:
                    return interrupted
                first, n, future = pending[0]
                result = future.result()
                pending.popleft()
                shifted = self._commit(result, first, n)
                if shifted:
                    number += shifted
                if self.progress:
                    self._report(began)
            except KeyboardInterrupt:
                interrupted = True
                # What is under way is finished and kept, what is only queued is dropped
                while pending and pending[-1][2].cancel():
                    pending.pop()

    def _next_size(self, planned: int, began: float) -> int:
        if self.seconds is not None and time.perf_counter() - began >= self.seconds:
            return 0
        if self.rays is None:
            return self.portion_rays
        return min(self.portion_rays, self.rays - planned)

    def _portion(self, first: int, n: int, number: int) -> EncodedPortion | list[Portion] | None:
        """Trace and encode one portion (worker thread)."""
        if self.writer is None and not self.pinholes:
            self.tally.add(*self.engine.trace_counted(first, n))
            return None
        portion = self._traced(first, n)
        self.tally.add(portion)
        if self.pinholes:
            self.pinholes.see(first, portion)
        if self.writer is None:
            return None
        if portion.n_records > PORTION_RECORDS and portion.n_rays > 1:
            pieces = split_portion(portion)
            return [copied(piece) for piece in pieces]
        return self.writer.encode(portion, number)

    def _traced(self, first: int, n: int) -> Portion:
        return replace(self.engine.trace(first, n, reuse=True), channel_set=self.channel_set)

    def _commit(self, result: EncodedPortion | list[Portion] | None, first: int, n: int) -> int:
        """Write what a worker made; by how many later numbers shift."""
        if self.pinholes:
            self.pinholes.take(first)
        if result is None or self.writer is None:
            return 0
        if isinstance(result, list):
            for piece in result:
                self.writer.commit(self.writer.encode(piece, self.writer.next_portion))
            return len(result) - 1
        if result.number != self.writer.next_portion:
            # An earlier portion was split after this one was numbered
            portion = self._traced(first, n)
            result = self.writer.encode(portion, self.writer.next_portion)
        self.writer.commit(result)
        return 0

    def _report(self, began: float) -> None:
        if self.progress:
            self.progress(
                Progress(
                    rays=self.tally.rays,
                    records=self.tally.records,
                    seconds=time.perf_counter() - began,
                    bytes=self.writer.bytes_written if self.writer else 0,
                    total_rays=self.rays,
                    total_seconds=self.seconds,
                )
            )

    def _notes(self) -> list[str]:
        return stopped_notes(
            self.tally.share("stopped"),
            self.tally.share("errors"),
            *self.trace.limit,
        )


def run_statistics(
    rays: int, seconds: float, audit: dict[str, dict[str, float]], interrupted: bool
) -> dict[str, Any]:
    """What a map tells of a run that ended."""
    return {"rays": rays, "seconds": seconds, "audit": audit, "interrupted": interrupted}
