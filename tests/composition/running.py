"""Rows of the second table: ways of running a trace, against one run of the same rays.

A way *works* if the detector sees what one run of the same rays makes it see, to the last bits of
sums, or, where the number of rays is left to the clock, within the errors of both.
"""

from __future__ import annotations

import math
import tempfile
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import query
import raymap
from tests.composition.features import plate, scene
from tests.composition.table import MODES, Cell, apart
from tracer import record
from tracer.run.shard_tasks import pack, unpack

__all__ = ["RUNNING", "ran"]

_RAYS = 2000
_AGREE = 4.5


@dataclass(frozen=True)
class _Trial:
    """A scene file, and a folder for what comes of it."""

    scene: Path
    folder: Path

    @property
    def map(self) -> Path:
        return self.folder / "a.raymap"

    def once(self, rays: int = _RAYS) -> tuple[float, float]:
        """Flux with its error of one run that keeps no rays."""
        found = record(self.scene, None, no_rays=True, rays=rays, seed=3, threads=1)
        return _flux(found)


def _flux(result: Any) -> tuple[float, float]:
    row = result.fluxes["detectors"]["ahead"]
    return row["flux"], row["flux_se"]


def _of_map(path: Path) -> float:
    """What a map's rays make of the detector."""
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        return float(query.select(ray_map, 'detected("ahead")').flux)


def _same(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=1e-6)


class _Elsewhere(Executor):
    """Runs every task at once as another process would: what goes there and back is packed."""

    _max_workers = 2

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            there = unpack(pack((function, arguments, options)))
            future.set_result(unpack(pack(there[0](*there[1], **there[2]))))
        except Exception as error:
            future.set_exception(error)
        return future


def _appended(trial: _Trial) -> bool:
    record(trial.scene, trial.map, rays=_RAYS // 2, seed=3, threads=1)
    record(trial.scene, trial.map, rays=_RAYS - _RAYS // 2, append=True, threads=1)
    return _same(_of_map(trial.map), trial.once()[0])


def _sharded(trial: _Trial) -> bool:
    folder = trial.folder / "shards"
    record(trial.scene, folder, rays=_RAYS, seed=3, executor=_Elsewhere())
    return _same(_of_map(folder), trial.once()[0])


def _timed(trial: _Trial) -> bool:
    found = record(trial.scene, trial.map, seconds=0.05, seed=4, threads=1, portion_rays=500)
    return not found.interrupted and apart(_flux(found), trial.once()) < _AGREE


def _stopped(trial: _Trial) -> bool:
    asked = iter([False, False, True])
    found = record(
        trial.scene, trial.map, rays=10**9, seed=3, threads=1, portion_rays=500,
        cancel=lambda: next(asked, True),
    )  # fmt: skip
    flux = trial.once(int(found.audit["lamp"]["emitted"]))[0]
    return found.interrupted and _same(_flux(found)[0], flux) and _same(_of_map(trial.map), flux)


def _without_rays(trial: _Trial) -> bool:
    found = record(trial.scene, trial.map, rays=_RAYS, seed=3, threads=1)
    return _same(_flux(found)[0], trial.once()[0]) and _same(_of_map(trial.map), _flux(found)[0])


def _served(trial: _Trial) -> bool:
    from service import Limits, RaymapService

    token = "a-token-for-the-tests"
    service = RaymapService(
        trial.folder, token, limits=Limits(spare_workers=0), threads=1, browser=False
    )
    thread = threading.Thread(target=service.serve, daemon=True)
    thread.start()
    try:
        with raymap.connect(service.address, token=token) as client:
            found = client.record(trial.scene.name, "a.raymap", rays=_RAYS, seed=3)
    finally:
        service.shutdown()
        thread.join(20)
        service.close()
    return _same(found.fluxes["detectors"]["ahead"]["flux"], trial.once()[0])


RUNNING: dict[str, Callable[[_Trial], bool]] = {
    "continued map": _appended,
    "folder of maps": _sharded,
    "time limit": _timed,
    "stopped by Ctrl-C": _stopped,
    "without rays": _without_rays,
    "service": _served,
}
"""Rows, in the order of the page."""


def ran(name: str, mode: str) -> Cell:
    """Try a way of running with a way of following light."""
    trace, more = MODES[mode]
    text = scene(plate()) + more + (f"[trace]\n{trace}" if trace else "")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / "scene.toml"
        path.write_text(text, encoding="utf-8")
        works = RUNNING[name](_Trial(path, Path(folder)))
    return Cell("works") if works else Cell("differs", f"{name}, {mode}")
