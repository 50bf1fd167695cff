"""Record for a client: progress while it runs, an end when the client goes, bounded in any case."""

from __future__ import annotations

import queue
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

from raymap.errors import RayMapError
from raymap.shards import SUFFIX
from service.confine import ServedFolder
from service.limits import Gate
from service.requests import BadRequest, Request
from service.scenes import SceneRequest

__all__ = ["record_events"]

BEAT_SECONDS = 0.5
"""How often it is looked whether the client is still there."""


def record_events(
    request: Request,
    folder: ServedFolder,
    gate: Gate,
    threads: int | None,
    gone: Callable[[], bool],
) -> Iterator[dict[str, Any]]:
    """``{"progress": …}`` again and again, at the end ``{"done": …}``.

    The trace ends with a valid map when the client goes, or when its time is over.
    """
    limits = request.limits
    scene = SceneRequest(request, folder)
    name = request.text("map")
    options: dict[str, Any] = {
        "rays": request.whole("rays", 1, limits.record_rays, None),
        "seconds": request.number("seconds", 0.0, limits.record_seconds, None),
        "seed": request.whole("seed", 0, 2**63 - 1, None),
        "append": request.flag("append"),
        "force": request.flag("force"),
    }
    request.finish()
    target = folder.path(name)
    if target.suffix != SUFFIX:
        raise BadRequest(f"record: the map {name!r} must end in {SUFFIX}")
    if not target.parent.is_dir():
        raise BadRequest(f"record: there is no folder for {name!r}; upload or make one first")
    if target.is_dir():
        raise BadRequest(f"record: {name!r} is a folder of maps; name a file")
    with gate.turn():
        compilation = scene.compile()
        yield from _run(compilation, target, options, threads, gone, limits.record_seconds)


def _run(
    compilation: Any,
    target: Any,
    options: dict[str, Any],
    threads: int | None,
    gone: Callable[[], bool],
    most_seconds: float,
) -> Iterator[dict[str, Any]]:
    """The trace in a thread of its own, its news handed over one by one."""
    from tracer.recording import record

    news: queue.Queue[dict[str, Any] | BaseException] = queue.Queue()
    stop = threading.Event()
    end = time.monotonic() + most_seconds

    def trace() -> None:
        try:
            with warnings.catch_warnings():
                # What there is to warn of stands in the result
                warnings.simplefilter("ignore")
                result = record(
                    compilation,
                    target,
                    threads=threads,
                    progress=lambda progress: news.put({"progress": asdict(progress)}),
                    cancel=stop.is_set,
                    **options,
                )
            news.put({"done": result.to_json()})
        except BaseException as error:
            news.put(error)

    thread = threading.Thread(target=trace, name="record", daemon=True)
    thread.start()
    try:
        while True:
            try:
                event = news.get(timeout=BEAT_SECONDS)
            except queue.Empty:
                if gone() or time.monotonic() > end:
                    stop.set()
                continue
            if gone() or time.monotonic() > end:
                stop.set()
            if isinstance(event, BaseException):
                if isinstance(event, RayMapError):
                    raise event
                raise RayMapError(f"the recording failed: {event}") from event
            yield event
            if "done" in event:
                return
    finally:
        stop.set()
        thread.join()
