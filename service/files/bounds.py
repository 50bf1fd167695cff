"""Bounds that a worker process sets to itself; the system keeps them, whatever code runs.

Where the system has no such limits (Windows has none of them, macOS no watch over memory), the
service's time limits remain.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from service.files.confine import OutsideFolder

__all__ = ["limit_process", "permitted", "read_only_from"]

_ADDRESSES = 4
"""Times the memory that may be used: compilers and sparse arrays reserve more than they touch."""

_SYSTEM = ("/usr", "/lib", "/lib64", "/opt", "/dev", "/proc", "/sys", "/etc/localtime")
_asking = threading.local()


def limit_process(*, cpu_seconds: float, memory_bytes: int, file_bytes: int) -> None:
    """Limit processor time, addresses and sizes of files of this process and its children.

    Parameters
    ----------
    cpu_seconds : of all threads together, from now on
    memory_bytes : that the service lets it use; four times as much may be reserved
    file_bytes : of the largest file that it may write
    """
    try:
        import resource
    except ImportError:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime + cpu_seconds) + 2
    wanted = {
        resource.RLIMIT_CPU: seconds,
        resource.RLIMIT_FSIZE: file_bytes,
        resource.RLIMIT_CORE: 0,
    }
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        reserved = pages * resource.getpagesize()
        wanted[resource.RLIMIT_AS] = reserved + _ADDRESSES * memory_bytes
    for kind, value in wanted.items():
        hard = resource.getrlimit(kind)[1]
        most = value if hard == resource.RLIM_INFINITY else min(value, hard)
        with suppress(OSError, ValueError):
            resource.setrlimit(kind, (most, most))


def read_only_from(root: Path, places: Sequence[Path]) -> None:
    """From now on Python opens nothing of the served folder, or elsewhere, that was not asked for.

    The door of the scene's files is the only way to them (`service.files.mirror`); this holds for a
    reader that forgot to ask it. It cannot be undone in this process.

    Parameters
    ----------
    root : the served folder
    places : files and folders that may be opened all the same; code and system files always may
    """
    code = [path for path in (*sys.path, sys.prefix, sys.base_prefix) if os.path.isabs(path)]
    own = [*code, *_SYSTEM, *map(str, places)]
    free = {os.path.realpath(path) for path in own} - {os.sep}
    served = str(root)

    def look(event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or isinstance(arguments[0], int) or getattr(_asking, "open", False):
            return
        place = os.path.realpath(os.fsdecode(arguments[0]))
        while place not in free:
            above = os.path.dirname(place)
            if place == served or above == place:
                raise OutsideFolder(
                    f"{os.path.basename(os.fsdecode(arguments[0]))!r} is not one of the files that "
                    "this service reads for a scene"
                )
            place = above

    sys.addaudithook(look)


@contextmanager
def permitted() -> Iterator[None]:
    """Open what was looked at already."""
    _asking.open = True
    try:
        yield
    finally:
        _asking.open = False
