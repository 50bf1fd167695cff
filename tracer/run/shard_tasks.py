"""One shard of a trace: what a worker is told, what it does, what it answers."""

from __future__ import annotations

import hashlib
import os
import pickle
import secrets
import tempfile
import threading
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import zstandard

from raymap.bytes.address import Address
from raymap.file.writer import RayMapWriter
from tracer.run.results import RecordResult
from tracer.run.running import run_into
from tracer.run.trace import Trace

__all__ = ["Shard", "ShardTask", "pack", "trace_shard", "unpack"]


@dataclass(frozen=True, kw_only=True)
class ShardTask:
    """One shard to trace; all that a worker needs to know.

    Attributes
    ----------
    scene : the packed trace
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
    folder: Path | Address
    probe: str | None
    meshes: bool


@dataclass(frozen=True, kw_only=True)
class Shard:
    """What a worker answers: counts, and the file where it could not put it into the folder."""

    name: str
    result: RecordResult
    size: int
    data: bytes | None


_traces: dict[str, Trace] = {}
_unpacking = threading.Lock()


def pack(trace: Trace) -> bytes:
    """A trace as bytes, for workers of the same version."""
    return zstandard.compress(pickle.dumps(trace, protocol=5), 3)


def unpack(scene: bytes) -> Trace:
    """The trace of `pack`."""
    found: Trace = pickle.loads(zstandard.decompress(scene))
    return found


def _scene_of(task: ShardTask) -> Trace:
    """The scene of a task; the last one is kept, as most tasks have the same."""
    key = hashlib.sha256(task.scene).hexdigest()
    with _unpacking:
        if key not in _traces:
            _traces.clear()
            _traces[key] = unpack(task.scene)
        return _traces[key]


def trace_shard(task: ShardTask) -> Shard:
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
        return Shard(name=task.name, result=result, size=size, data=None)
    with tempfile.TemporaryDirectory(prefix="raymap-") as own:
        part = Path(own) / task.name
        result = _trace_into(task, part)
        data = part.read_bytes()
    if isinstance(task.folder, Address):
        from raymap.bytes.remotebytes import upload

        upload(data, task.folder / task.name)
        return Shard(name=task.name, result=result, size=len(data), data=None)
    return Shard(name=task.name, result=result, size=len(data), data=data)


def _trace_into(task: ShardTask, path: Path) -> RecordResult:
    trace = _scene_of(task)
    with (
        warnings.catch_warnings(),
        RayMapWriter.create(
            path,
            trace.directory,
            meshes=trace.meshes if task.meshes else {},
            raw=task.raw,
            trusted=True,
            first_ray=task.first_ray * trace.max_branches,
        ) as writer,
    ):
        # What there is to warn of stands in the result
        warnings.simplefilter("ignore")
        return run_into(
            trace,
            writer,
            rays=task.rays,
            seconds=task.seconds,
            seed=task.seed,
            portion_rays=task.portion_rays,
        )
