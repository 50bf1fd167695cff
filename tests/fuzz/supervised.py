"""Run cases in a process of their own, so that the end of that process is seen, too.

The worker writes the number of the case that it is at into a file before it begins it. Where it
ends by a signal (segmentation fault, abort, more processor time than a case may take), the
supervisor says which case that was and starts another one behind it.
"""

from __future__ import annotations

import argparse
import json
import mmap
import os
import random
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Case", "Counts", "Progress", "Seeds", "command_line", "supervise"]

CASE_SECONDS = 60.0
"""Processor time that one case may take, compiling included."""

CRASHES = 50
"""After so many ends by a signal the run is given up."""

Counts = dict[str, int]
Seeds = Callable[[Path], Sequence[Any]]
"""Makes in a folder what cases begin with."""

Case = Callable[[Any, random.Random, Path], int]
"""Changes one of these and looks what becomes of it at a path; returns the number of changes."""


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


def command_line(script: Path, seeds: Seeds, one_case: Case) -> int:
    """The command line of a script of cases: 1 where something failed."""
    parser = argparse.ArgumentParser(description="Fuzz maps with valid checksums.")
    parser.add_argument("seconds", type=float, nargs="?", default=3600.0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, help="stop after so many, in this process")
    parser.add_argument("--progress", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if os.environ.get("NUMBA_BOUNDSCHECK") != "1":
        print("without NUMBA_BOUNDSCHECK=1 loops that leave their arrays go unseen", flush=True)

    def worker(first: int, seconds: float, progress: Path) -> list[str]:
        words = [str(seconds), "--first", str(first), "--progress", str(progress)]
        return [sys.executable, str(script.resolve()), *words]

    with tempfile.TemporaryDirectory(prefix="raymap-values-", dir=_in_memory()) as name:
        folder = Path(name)
        if given.cases is not None or given.progress is not None:
            progress = None if given.progress is None else Progress(given.progress)
            drawn = _Drawn(seeds(folder), one_case, folder / "changed.raymap")
            counts = drawn.run(given.seconds, given.first, given.cases, progress)
        else:
            counts = supervise(worker, given.first, given.seconds, folder)
    print(counts, flush=True)
    return int(counts["failures"] > 0 or counts.get("crashes", 0) > 0)


@dataclass(frozen=True)
class _Drawn:
    """Cases, each drawn from its number alone."""

    seeds: Sequence[Any]
    one_case: Case
    path: Path

    def run(
        self, seconds: float, first: int, cases: int | None, progress: Progress | None
    ) -> Counts:
        """Cases for some time; prints what fails with the number that repeats it."""
        # A warning of NumPy on somebody's terminal is no clear line
        warnings.simplefilter("error", RuntimeWarning)
        begin, number = time.monotonic(), first
        counts = {"cases": 0, "changes": 0, "failures": 0}
        while time.monotonic() - begin < seconds and counts["cases"] != cases:
            if progress is not None:
                progress.begin(number, counts)
            dice = random.Random(number)
            try:
                counts["changes"] += self.one_case(dice.choice(self.seeds), dice, self.path)
            except Exception:
                counts["failures"] += 1
                print(f"case {number}:\n{traceback.format_exc()}", flush=True)
                if counts["failures"] > 1000:
                    break
            counts["cases"] += 1
            number += 1
        if progress is not None:
            progress.begin(number, counts)
        return counts


def _in_memory() -> str | None:
    """A folder whose files lie in memory, where the system has one."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
