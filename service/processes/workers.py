"""Worker processes: what may hang, grow or crash does so elsewhere, and is ended as a group.

Each process does one job (`service.processes.worker`). A spare one is kept, so that its start costs
a client little. A watch looks at its time, its memory and its client; on systems without
``/proc`` memory is bounded by the process itself alone, where the system can do that.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from raymap.model import errors
from raymap.model.errors import RayMapError
from raymap.remote.protocol import TOKEN_VARIABLE
from raymap.rooms import trusted_path
from service.files.confine import OutsideFolder
from service.limits import OutOfTime

__all__ = ["Bounds", "Workers"]

_LOOK_SECONDS = 0.1
_LONGEST_LINE = 2**26
_KEPT_STDERR = 2**14
_WAITING_NEWS = 16
_KIND = {"scene": "scene", "record": "scene", "picture": "picture"}
"""Which kind of process does a job."""


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """What one job may cost.

    Attributes
    ----------
    seconds : until it is asked to end
    end_seconds : from then until it is ended
    memory_bytes : of all its processes together
    file_bytes : of the largest file that it may write
    threads : that compute at a time
    option : of `raymap serve`, that raises the seconds
    """

    seconds: float
    end_seconds: float = 0.0
    memory_bytes: int
    file_bytes: int
    threads: int
    option: str


class Workers:
    """The worker processes of a service.

    Parameters
    ----------
    spares : keep one of each kind that was wanted, started before it is wanted again
    """

    def __init__(self, *, spares: bool = True) -> None:
        self.spares = spares
        self._spares: dict[str, _Process] = {}
        self._lock = threading.Lock()
        self._closed = False

    def ask(
        self, job: str, arguments: dict[str, Any], bounds: Bounds, gone: Callable[[], bool]
    ) -> dict[str, Any]:
        """The answer of a job without news on the way."""
        for message in self.run(job, arguments, bounds, gone):
            if "answer" in message:
                return dict(message["answer"])
        raise RayMapError(f"{job}: ended without an answer")

    def run(
        self, job: str, arguments: dict[str, Any], bounds: Bounds, gone: Callable[[], bool]
    ) -> Iterator[dict[str, Any]]:
        """Messages ``{"event": …}`` of a job, at the end ``{"answer": …}``.

        Raises
        ------
        RayMapError
            What the job raised; or it was ended, since its bounds or its client were gone.
        """
        process = self._take(_KIND[job])
        watch = _Watch(process, bounds, gone)
        try:
            process.tell({
                "job": job,
                "arguments": arguments,
                "bounds": {
                    "cpu_seconds": (bounds.seconds + bounds.end_seconds) * bounds.threads,
                    "memory_bytes": bounds.memory_bytes,
                    "file_bytes": bounds.file_bytes,
                },
            })  # fmt: skip
            watch.start()
            yield from self._messages(job, process, watch)
        finally:
            watch.leave()
            process.end()
            self._refill(_KIND[job])

    def close(self) -> None:
        """End the spare processes."""
        with self._lock:
            self._closed = True
            spares = list(self._spares.values())
            self._spares.clear()
        for spare in spares:
            spare.end()

    def _messages(self, job: str, process: _Process, watch: _Watch) -> Iterator[dict[str, Any]]:
        while True:
            message = process.news.get()
            if message is None:
                watch.check(job)
                raise RayMapError(
                    f"{job}: the process that did it ended ({process.how()}); the service goes on"
                )
            if "over" in message:
                raise watch.out_of_memory(job)
            if "fault" in message:
                print(process.said(), file=sys.stderr, flush=True)
                raise RayMapError(f"{job} failed ({message['fault']}); the service goes on")
            if "error" in message:
                raise _error(message["error"])
            yield message
            if "answer" in message:
                return

    def _take(self, kind: str) -> _Process:
        with self._lock:
            spare = self._spares.pop(kind, None)
        if spare is not None and spare.alive():
            return spare
        return _Process(kind)

    def _refill(self, kind: str) -> None:
        with self._lock:
            if self.spares and not self._closed and kind not in self._spares:
                self._spares[kind] = _Process(kind)


class _Process:
    """One process, its group, its private folder, and what it says."""

    def __init__(self, kind: str) -> None:
        self.folder = tempfile.mkdtemp(prefix="raymap-worker-")
        own = {name: value for name, value in os.environ.items() if name != TOKEN_VARIABLE}
        self._process = subprocess.Popen(
            [sys.executable, "-I", str(Path(__file__).with_name("worker.py")), kind,
             json.dumps(trusted_path())],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**own, "TMPDIR": self.folder, "TEMP": self.folder, "TMP": self.folder},
            cwd=self.folder, start_new_session=True,
        )  # fmt: skip
        self.news: queue.Queue[dict[str, Any] | None] = queue.Queue(_WAITING_NEWS)
        self._stderr = b""
        self._ended = False
        for task in (self._hear, self._overhear):
            threading.Thread(target=task, name=f"worker-{kind}", daemon=True).start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def tell(self, message: dict[str, Any]) -> None:
        """Send a line."""
        with suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.write(json.dumps(message).encode() + b"\n")
            self._process.stdin.flush()

    def kill(self) -> None:
        """End the whole group at once."""
        with suppress(OSError):
            if os.name == "posix":
                os.killpg(self.pid, signal.SIGKILL)
            else:
                self._process.kill()

    def end(self) -> None:
        """End it, and remove what it left behind."""
        self._ended = True
        self.kill()
        self._process.wait()
        with suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def how(self) -> str:
        """How it ended."""
        code = self._process.wait()
        if code >= 0:
            return f"exit {code}"
        with suppress(ValueError):
            return signal.Signals(-code).name
        return f"signal {-code}"

    def said(self) -> str:
        """The end of what it wrote to its standard error."""
        return self._stderr.decode(errors="replace")

    def _hear(self) -> None:
        stream = self._process.stdout
        assert stream is not None
        with stream:
            while line := stream.readline(_LONGEST_LINE + 1):
                message = _message(line)
                if message is None:
                    break
                last = "event" not in message
                if last:
                    self._put(message)
                    break
                # Nobody has to hear of every step; a slow client may not hold up the job
                with suppress(queue.Full):
                    self.news.put_nowait(message)
        self._put(None)

    def _put(self, message: dict[str, Any] | None) -> None:
        while not self._ended:
            with suppress(queue.Full):
                self.news.put(message, timeout=1.0)
                return

    def _overhear(self) -> None:
        stream = self._process.stderr
        assert stream is not None
        with stream:
            while part := stream.read1(2**12):  # type: ignore[attr-defined]
                self._stderr = (self._stderr + part)[-_KEPT_STDERR:]


class _Watch:
    """Looks at a process from time to time; asks it to end, then ends it."""

    def __init__(self, process: _Process, bounds: Bounds, gone: Callable[[], bool]) -> None:
        self.process, self.bounds, self.gone = process, bounds, gone
        self.reason = ""
        self._left = threading.Event()

    def start(self) -> None:
        """Begin, in a thread of its own: the client may be slow to take what there is."""
        threading.Thread(target=self._look, name="watch", daemon=True).start()

    def leave(self) -> None:
        """Look no longer."""
        self._left.set()

    def check(self, job: str) -> None:
        """Raise why the process was ended, if the watch did it."""
        if self.reason == "memory":
            raise self.out_of_memory(job)
        if self.reason == "time":
            raise OutOfTime(
                f"{job}: took longer than the {self.bounds.seconds:g} s that this service allows: "
                f"ask for less, or raise {self.bounds.option}"
            )
        if self.reason == "gone":
            raise OutOfTime("the client has gone")

    def out_of_memory(self, job: str) -> RayMapError:
        """The error of a job that wanted too much."""
        return RayMapError(
            f"{job}: needs more than the {self.bounds.memory_bytes >> 20} MiB of memory that this "
            "service allows: ask for less, or raise --memory-bytes"
        )

    def _look(self) -> None:
        end = time.monotonic() + self.bounds.seconds
        while not self._left.wait(_LOOK_SECONDS):
            if _memory_of(self.process.pid) > self.bounds.memory_bytes:
                self._end("memory", 0.0)
            elif self.gone():
                self._end("gone", self.bounds.end_seconds)
            elif time.monotonic() > end:
                self._end("time", self.bounds.end_seconds)
            else:
                continue
            return

    def _end(self, reason: str, seconds: float) -> None:
        """Ask, wait, end."""
        if seconds > 0.0:
            self.process.tell({"stop": True})
            if self._left.wait(seconds):
                return
        self.reason = reason
        self.process.kill()


def _message(line: bytes) -> dict[str, Any] | None:
    """What a line says; None for what no sound worker would say."""
    if len(line) > _LONGEST_LINE:
        return None
    with suppress(ValueError, RecursionError):
        found = json.loads(line)
        if isinstance(found, dict) and len(found) == 1:
            return found
    return None


def _error(told: Any) -> RayMapError:
    """The error that a worker tells of, of a class that is known here."""
    told = told if isinstance(told, dict) else {}
    kind, name, text = (str(told.get(key, ""))[:4000] for key in ("kind", "error", "message"))
    if name == "OutsideFolder":
        return OutsideFolder(text)
    chosen = getattr(errors, kind, RayMapError) if kind in errors.__all__ else RayMapError
    if not issubclass(chosen, RayMapError):
        chosen = RayMapError
    return chosen(text or "failed")


def _memory_of(pid: int) -> int:
    """Bytes in memory of a process and its children; 0 where the system does not tell."""
    total, waiting = 0, [pid]
    while waiting:
        where = f"/proc/{waiting.pop()}"
        try:
            with open(f"{where}/statm", "rb") as file:
                total += int(file.read().split()[1]) * _PAGE
            for task in os.listdir(f"{where}/task"):
                with open(f"{where}/task/{task}/children", "rb") as file:
                    waiting += [int(child) for child in file.read().split()]
        except (OSError, ValueError, IndexError):
            continue
    return total


_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096
