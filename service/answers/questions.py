"""Requests that are answered with one JSON object."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from raymap.file.shards import SUFFIX
from service.answers.requests import BadRequest, Request
from service.answers.results import check_scene
from service.answers.scenes import SceneRequest
from service.files.confine import ServedFolder
from service.files.library import Library
from service.files.naming import names_of
from service.limits import Deadline, Gate
from service.processes.workers import Bounds, Workers

__all__ = ["Questions"]

Gone = Callable[[], bool]
_MOST_FILES = 10_000


class Questions:
    """What is in the folder, what is in a map, how many rays, one ray."""

    def __init__(
        self,
        folder: ServedFolder,
        library: Library,
        gate: Gate,
        workers: Workers,
        threads: int | None,
    ) -> None:
        self.folder, self.library, self.gate, self.threads = folder, library, gate, threads
        self.workers = workers

    def files(self, request: Request, gone: Gone) -> dict[str, Any]:
        """Maps, folders and scenes of a folder."""
        name = request.text("folder", None)
        request.finish()
        folder = self.folder.root if name in (None, ".", "") else self.folder.path(name)
        if not folder.is_dir():
            raise BadRequest(f"files: there is no folder {name!r}")
        rows = []
        with self.folder.holding(folder) as held:
            names = held.names()
        for path in (folder / name for name in names[:_MOST_FILES]):
            if not self.folder.serves(path):
                continue
            kinds = {SUFFIX: "map", ".toml": "scene"}
            kind = "folder" if path.is_dir() else kinds.get(path.suffix, "file")
            size = 0 if kind == "folder" else path.stat().st_size
            rows.append({"name": self.folder.shown(path), "kind": kind, "bytes": size})
        return {"files": rows}

    def scene(self, request: Request, gone: Gone) -> dict[str, Any]:
        """Read and check a scene; its names."""
        scene = SceneRequest(request, self.folder)
        request.finish()
        limits = request.limits
        bounds = Bounds(
            seconds=limits.scene_seconds,
            memory_bytes=limits.memory_bytes,
            file_bytes=limits.scene_files_bytes,
            threads=os.cpu_count() or 1,
            option="--scene-seconds",
        )
        with self.gate.turn():
            return check_scene(self.workers.ask("scene", scene.job(), bounds, gone))

    def describe(self, request: Request, gone: Gone) -> dict[str, Any]:
        """What a map holds: counts, and names of sources, objects, faces, detectors."""
        name = request.text("map")
        request.finish()
        with self.library.map(name) as ray_map:
            return {"map": name, **ray_map.describe(), **names_of(ray_map.directory)}

    def criterion(self, request: Request, gone: Gone) -> dict[str, Any]:
        """Read a criterion without asking it: its text and its JSON; with a map, its names too."""
        criterion, name = request.criterion(), request.text("map", None)
        request.finish()
        if criterion is None:
            raise BadRequest("criterion: the criterion is empty")
        if name is not None:
            from query.answers.selections.selector import bind_all

            with self.library.map(name) as ray_map:
                bind_all(ray_map, [criterion])
        return {"criterion": str(criterion), "json": criterion.to_json()}

    def count(self, request: Request, gone: Gone) -> dict[str, Any]:
        """How many rays satisfy a criterion, and their flux."""
        from query.answers.selections.selector import select

        name, criterion = request.text("map"), request.criterion()
        limit = request.whole("limit", 1, 2**62, None)
        request.finish()
        with self.gate.turn(), self.library.map(name) as ray_map:
            over = Deadline(request.limits.search_seconds, gone)
            found = select(
                ray_map, criterion, limit=limit, rays=False, cancel=over, threads=self.threads
            )
            if not found.complete:
                over.check()
            return found.summary()

    def report(self, request: Request, gone: Gone) -> dict[str, Any]:
        """Everything that is recorded of one ray."""
        from query.answers.reports.ray_report import report

        name, ray = request.text("map"), request.whole("ray_id", 0, 2**62)
        request.finish()
        with self.gate.turn(), self.library.map(name) as ray_map:
            return dict(report(ray_map, ray))
