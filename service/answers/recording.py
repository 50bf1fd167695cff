"""Record for a client: progress while it runs, an end when the client goes, bounded in any case."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from raymap.file.shards import SUFFIX
from raymap.model.errors import RayMapError
from service.answers.requests import BadRequest, Request
from service.answers.results import check_done, check_progress
from service.answers.scenes import SceneRequest
from service.files.confine import ServedFolder
from service.files.disk import Disk
from service.limits import Gate
from service.processes.workers import Bounds, Workers

__all__ = ["Recorder"]


class Recorder:
    """Records into the served folder, each time in a process of its own."""

    def __init__(
        self, folder: ServedFolder, gate: Gate, workers: Workers, disk: Disk, threads: int | None
    ) -> None:
        self.folder, self.gate, self.workers, self.disk = folder, gate, workers, disk
        self.threads = threads or os.cpu_count() or 1

    def events(self, request: Request, gone: Callable[[], bool]) -> Iterator[dict[str, Any]]:
        """``{"progress": …}`` again and again, at the end ``{"done": …}``.

        The trace ends with a valid map when the client goes, when its time is over, or when the
        quota of the disk is used up.
        """
        limits = request.limits
        scene = SceneRequest(request, self.folder)
        name = request.text("map")
        options: dict[str, Any] = {
            "rays": request.whole("rays", 1, limits.record_rays, None),
            "seconds": request.number("seconds", 0.0, limits.record_seconds, None),
            "seed": request.whole("seed", 0, 2**63 - 1, None),
            "append": request.flag("append"),
            "force": request.flag("force"),
        }
        request.finish()
        target = self._target(name)
        with self.gate.turn():
            self.disk.check("record", 2**20)
            job = {**scene.job(), "map": str(target), "options": options, "threads": self.threads}
            before = target.stat().st_size if options["append"] and target.exists() else 0
            bounds = Bounds(
                seconds=limits.record_seconds,
                end_seconds=limits.end_seconds,
                memory_bytes=limits.memory_bytes,
                file_bytes=before + self.disk.room(),
                threads=self.threads,
                option="--record-seconds",
            )
            stop = _Stop(gone, self.disk)
            with self.disk.writing(target, target, keeps=options["append"]):
                for message in self.workers.run("record", job, bounds, stop):
                    yield _checked(message)

    def _target(self, name: str) -> Path:
        target = self.folder.path(name)
        if target.suffix != SUFFIX:
            raise BadRequest(f"record: the map {name!r} must end in {SUFFIX}")
        if not target.parent.is_dir():
            raise BadRequest(f"record: there is no folder for {name!r}; upload or make one first")
        if target.is_dir():
            raise BadRequest(f"record: {name!r} is a folder of maps; name a file")
        return target


class _Stop:
    """Whether a recording is to end: nobody waits for it, or there is no room."""

    def __init__(self, gone: Callable[[], bool], disk: Disk) -> None:
        self.gone, self.disk = gone, disk

    def __call__(self) -> bool:
        return self.gone() or self.disk.room() <= 0


def _checked(message: dict[str, Any]) -> dict[str, Any]:
    told = message.get("event", message.get("answer"))
    if isinstance(told, dict) and "progress" in told and "event" in message:
        return {"progress": check_progress(told["progress"])}
    if isinstance(told, dict) and "done" in told:
        return {"done": check_done(told["done"])}
    raise RayMapError("record: the process that recorded answered nonsense")
