"""Record a scene: portions traced by many threads, written in number order."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from raymap.encoding.encoder import PortionEncoder
from raymap.file.reader import NO_RAYS
from raymap.file.writer import RayMapWriter
from raymap.model.errors import MapExists, SceneError
from raymap.model.replacing import check_place
from raymap.remote.cluster import shares_memory
from tracer.run.counted_map import write_counts
from tracer.run.results import OtherChannels, Progress, RecordResult, StoppedLight
from tracer.run.running import Run, run_statistics
from tracer.run.sharding import record_shards
from tracer.run.trace import Trace
from tracer.run.traces import trace_of
from tracer.scene.compile import Compilation
from tracer.scene.model import Scene

__all__ = ["OtherChannels", "StoppedLight", "check_target", "record", "refuse_scene_file"]

DEFAULT_RAYS = 1_000_000


def record(
    scene: str | Path | Scene | Compilation | Trace,
    path: str | Path | None = None,
    *,
    rays: int | None = None,
    seconds: float | None = None,
    threads: int | None = None,
    seed: int | None = None,
    append: bool = False,
    force: bool = False,
    raw: bool = False,
    no_rays: bool = False,
    portion_rays: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    executor: Executor | None = None,
    cancel: Callable[[], bool] | None = None,
) -> RecordResult:
    """Trace a scene and record every light path in a ray map.

    Parameters
    ----------
    scene : a scene file, a `Scene`, the result of `compile_scene`, or a trace of any light
    path : of the map; it may be None with ``no_rays``
    rays, seconds : when to stop; a million rays where neither is given
    threads : worker threads, all processors by default
    seed : of the random numbers; by default that of the map when it is continued, else 1
    append : continue a map of the same scene; ``force``: write over an existing one
    raw : store streams uncompressed, for debugging
    no_rays : trace for the detectors' results only; a map that is written has no rays
    portion_rays : rays per portion; the map's content does not depend on it
    progress : called after every portion, in the calling thread
    executor : runs the trace instead of a thread pool. One whose tasks run in other processes or on
        other machines (Dask's ``client.get_executor()``, a process pool) writes a folder of maps:
        ``path`` names the folder or an address of object storage, and `raymap.open` opens it as one
        map of the same rays
    cancel : asked after every portion; once it is true the trace ends, and the map is valid

    Raises
    ------
    SceneError, MapExists, MapLocked, SceneMismatch
    """
    if path is None and not no_rays:
        raise SceneError("name the map to write (or ask for detector results only with no_rays)")
    if no_rays and append:
        raise SceneError("a map cannot be continued without rays: leave out --append, or --no-rays")
    if rays is not None and rays < 1:
        raise SceneError(f"rays must be at least 1, not {rays}")
    if seed is not None and not 0 <= seed < 2**63:
        raise SceneError(f"seed must be from 0 to 2**63 - 1, not {seed}")
    if rays is None and seconds is None:
        rays = DEFAULT_RAYS
    here = executor is None or shares_memory(executor)
    if path is not None and here and not append:
        check_target(Path(path), force=force)
    trace = trace_of(scene)
    count = threads or os.cpu_count() or 1
    encoder = None if no_rays else PortionEncoder(trace.directory, raw=raw)
    trace = trace.prepared(encoder, count)
    if executor is not None and not here:
        if no_rays or path is None:
            raise SceneError("detector results only (no_rays) need an executor of this process")
        return record_shards(
            trace, path, executor, rays=rays, seconds=seconds, seed=seed, append=append,
            force=force, raw=raw, portion_rays=portion_rays, progress=progress,
            cancel=cancel,
        )  # fmt: skip
    if path is None:
        run = Run(trace, None, rays, seconds, seed, count, portion_rays, progress)
        run.cancel = cancel
        return run.go(executor)
    with _writer(Path(path), trace, append=append, force=force, raw=raw) as writer:
        if no_rays:
            run = Run(trace, None, rays, seconds, seed, count, portion_rays, progress)
            run.cancel = cancel
            result = run.go(executor)
            statistics = run_statistics(
                result.rays, result.seconds, result.audit, result.interrupted
            )
            write_counts(
                writer, trace.channel_set, result.counts, seed=run.seed, statistics=statistics
            )
            return replace(result, bytes=writer.bytes_written)
        run = Run(trace, writer, rays, seconds, seed, count, portion_rays, progress)
        run.cancel = cancel
        return run.go(executor)


def refuse_scene_file(scene: Path, output: Path) -> None:
    """Refuse to write a map over the scene that it is recorded from.

    Raises
    ------
    SceneError
    """
    if os.path.exists(output) and os.path.exists(scene) and os.path.samefile(output, scene):
        raise SceneError(f"{output} is the scene file: name another file for the map")


def check_target(path: Path, *, force: bool) -> None:
    """Refuse a map that cannot be created before anything is compiled for it.

    Raises
    ------
    MapExists, NotWritten
    """
    check_place(path)
    if path.exists() and not force:
        raise MapExists(
            f"{str(path)!r} exists and stays as it is; continue it with --append, write over it "
            "with --force, or choose another name"
        )


def _writer(
    path: Path,
    trace: Trace,
    *,
    append: bool,
    force: bool,
    raw: bool,
) -> RayMapWriter:
    if append and path.exists():
        writer = RayMapWriter.append_to(path, trace.directory, raw=raw, trusted=True)
        if any((run.get("parameters") or {}).get(NO_RAYS) for run in writer.runs):
            writer.close()
            raise SceneError(
                f"{path} was recorded with --no-rays and cannot be continued; record another map"
            )
        return writer
    return RayMapWriter.create(
        path,
        trace.directory,
        meshes=trace.meshes,
        force=force,
        raw=raw,
        trusted=True,
    )
