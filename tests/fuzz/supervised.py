"""Run cases in a process of their own, so that the end of that process is seen, too.

The worker writes the number of the case that it is at into a file before it begins it. Where it
ends by a signal (segmentation fault, abort, more processor time than a case may take), the
supervisor says which case that was and starts another one behind it.
"""

from __future__ import annotations

import json
import mmap
import os
import resource
import signal
import struct
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["Counts", "Progress", "supervise"]

CASE_SECONDS = 60.0
"""Processor time that one case may take, compiling included."""

CRASHES = 50
"""After so many ends by a signal the run is given up."""

Counts = dict[str, int]


class Progress:
    """The case that the worker is at, and what it has counted, in shared memory."""

    _FORM = struct.Struct("<qqqqq")
    _NAMES = ("cases", "changes", "failures", "peak_mb")

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(self._FORM.size))
        with path.open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), self._FORM.size)

    def begin(self, number: int, counts: Counts) -> None:
        """A case begins; it is ended by a signal where it takes too long."""
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        values = [counts.get(name, 0) for name in self._NAMES[:3]]
        self._memory[:] = self._FORM.pack(number, *values, peak)
        signal.setitimer(signal.ITIMER_PROF, CASE_SECONDS)

    def read(self) -> tuple[int, Counts]:
        """Number of the case and the counts of this worker so far."""
        number, *values = self._FORM.unpack(self._memory[:])
        return number, dict(zip(self._NAMES, values, strict=True))


def supervise(
    command: Callable[[int, float, Path], list[str]],
    first: int,
    seconds: float,
    folder: Path,
    *,
    say: Callable[[str], None] = print,
) -> Counts:
    """Keep a worker running for some time; the sum of what all workers counted.

    Parameters
    ----------
    command : (first case, seconds, file of the progress) -> command line of a worker
    """
    total: Counts = {"cases": 0, "changes": 0, "failures": 0, "crashes": 0, "peak_mb": 0}
    begin = time.monotonic()
    while total["crashes"] < CRASHES:
        place = folder / f"progress{total['crashes']}"
        progress = Progress(place)
        progress.begin(first, {})
        signal.setitimer(signal.ITIMER_PROF, 0)
        left = seconds - (time.monotonic() - begin)
        code = _watched(command(first, left, place), progress, total, say)
        number, counts = progress.read()
        _add(total, counts)
        if code >= 0:
            return total
        total["crashes"] += 1
        say(f"case {number}: the process was ended by {signal.Signals(-code).name}")
        first = number + 1
    return total


def _watched(
    command: list[str], progress: Progress, before: Counts, say: Callable[[str], None]
) -> int:
    """Wait for a worker, saying once a minute how far it is; its exit code."""
    environment = {**os.environ, "PYTHONFAULTHANDLER": "1"}
    with subprocess.Popen(command, env=environment) as worker:
        try:
            while True:
                try:
                    return worker.wait(60.0)
                except subprocess.TimeoutExpired:
                    shown: dict[str, Any] = dict(before)
                    _add(shown, progress.read()[1])
                    say(json.dumps({"at": time.strftime("%H:%M:%S"), **shown}))
        except BaseException:
            worker.kill()
            raise


def _add(total: Counts, more: Counts) -> None:
    for name, value in more.items():
        total[name] = max(total[name], value) if name == "peak_mb" else total[name] + value
