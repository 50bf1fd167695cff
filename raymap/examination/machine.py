"""Compiled code and its folder, cores, memory, disk, browser."""

from __future__ import annotations

import os
import shutil
import time
import webbrowser
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from raymap.examination.finding import Finding
from raymap.jit.compilecache import cache_folder, is_own, user_caches

__all__ = ["browser", "compiled_code", "cores", "memory"]

_MIB, _GIB = 2**20, 2**30
_LITTLE_MEMORY, _LITTLE_DISK = _GIB // 2, 200 * _MIB


def compiled_code(*, compiling: bool) -> Iterator[Finding]:
    """Numba, and the folder in which compiled code is kept."""
    part = "compiled code"
    import numba

    yield Finding(part, f"numba {numba.__version__}, Raymap runs threads of its own")
    if numba.config.DISABLE_JIT:
        yield Finding(
            part,
            "NUMBA_DISABLE_JIT is set",
            "NUMBA_DISABLE_JIT is set: loops run as plain Python, a hundred times slower",
            "unset NUMBA_DISABLE_JIT",
        )
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(chosen) if chosen else cache_folder()
    if folder is None:
        caches = user_caches()
        where = "no folder for caches" if caches is None else f"a folder in {caches / 'raymap'}"
        yield Finding(
            part,
            "nothing is kept",
            "compiled code cannot be kept, so that every start compiles anew (20 s): "
            f"{where} is not there, cannot be written, or others could write to it",
            "set XDG_CACHE_HOME or NUMBA_CACHE_DIR to a folder that is yours alone",
        )
    else:
        yield _folder(part, folder, chosen=bool(chosen))
    if compiling:
        begin = time.perf_counter()
        doubled = numba.njit(lambda x: 2 * x)(21)
        seconds = time.perf_counter() - begin
        problem = "" if doubled == 42 else f"compiled code computes 2 * 21 = {doubled}"
        yield Finding(
            part, f"a small function compiles in {seconds:.2f} s", problem,
            "install numba and llvmlite again" if problem else "",
        )  # fmt: skip


def _folder(part: str, folder: Path, *, chosen: bool) -> Finding:
    files = [path for path in folder.rglob("*") if path.is_file()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in files)
    named = " (NUMBA_CACHE_DIR)" if chosen else ""
    found = f"kept in {folder}{named}: {len(files)} files, {size / _MIB:.0f} MiB"
    if folder.is_dir() and not chosen and not is_own(folder):
        return Finding(
            part,
            found,
            f"{folder} or a file in it is not yours: somebody else could put code there",
            "remove the folder",
        )
    path = folder
    while not path.exists():
        path = path.parent
    if not os.access(path, os.W_OK | os.X_OK):
        return Finding(
            part,
            found,
            f"{path} cannot be written, so that every start compiles anew",
            "make it writable, or set NUMBA_CACHE_DIR to a folder that is yours alone",
        )
    free = shutil.disk_usage(path).free
    if free < _LITTLE_DISK:
        return Finding(
            part,
            found,
            f"{free / _MIB:.0f} MiB are free on the disk of {path}",
            "make room, or set NUMBA_CACHE_DIR to a folder on another disk",
        )
    return Finding(part, found)


def cores() -> Iterator[Finding]:
    """How many threads a trace or a search gets."""
    part = "machine"
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    quota = _cgroup("cpu.max")
    limit = ""
    if quota and quota[0] != "max" and len(quota) == 2:
        limit = f", limited to the time of {int(quota[0]) / int(quota[1]):.3g}"
    yield Finding(part, f"{os.cpu_count()} cores, {allowed} for this process{limit}")


def memory() -> Iterator[Finding]:
    """How much there is, and what limits it."""
    part = "machine"
    limits = {}
    words = _cgroup("memory.max")
    if words and words[0].isdigit():
        limits["control group"] = int(words[0])
    try:
        import resource

        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        if most != resource.RLIM_INFINITY:
            limits["ulimit -v"] = most
    except ImportError:
        pass
    free = _free_memory()
    shown = "".join(f", {name} {value / _GIB:.3g} GiB" for name, value in limits.items())
    least = min([*limits.values(), *([] if free is None else [free])], default=None)
    found = "memory: " + ("unknown" if free is None else f"{free / _GIB:.3g} GiB free") + shown
    if least is None or least >= _LITTLE_MEMORY:
        yield Finding(part, found)
        return
    yield Finding(
        part,
        found,
        f"{least / _MIB:.0f} MiB of memory: a trace needs 500 MiB, more with every thread",
        "close other programs or raise the limit; record with --threads 1",
    )


def _free_memory() -> int | None:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    known = dict(line.split(":", 1) for line in lines if ":" in line)
    words = known.get("MemAvailable", "").split()
    return 1024 * int(words[0]) if words else None


def _cgroup(name: str) -> list[str]:
    """What the control group of this process says."""
    try:
        own = Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines()
        inside = next(line[3:] for line in own if line.startswith("0::"))
        folder = Path("/sys/fs/cgroup") / inside.lstrip("/")
        return (folder / name).read_text(encoding="ascii").split()
    except (OSError, StopIteration, ValueError):
        return []


def browser() -> Iterator[Finding]:
    """What pictures and the application need: no graphics card, and a browser somewhere."""
    part = "pictures"
    yield Finding(part, "painted without OpenGL: no graphics card and no display is needed")
    if find_spec("pyvista") is not None:
        yield Finding(part, "viewer.plotter draws with PyVista and the OpenGL of this machine")
    try:
        name = getattr(webbrowser.get(), "name", "the system's")
        yield Finding(part, f"the application opens in {name}")
    except webbrowser.Error:
        yield Finding(part, "no browser here: raymap view prints an address to open elsewhere")
