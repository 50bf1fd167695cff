"""Compiled code of another Raymap is never served, and a damaged cache never fails."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from raymap.jit.compilecache import fingerprint, is_own, remove_old
from tests.plugins.installing import install, run

_ROOT = Path(__file__).resolve().parents[3]

_PROGRAM = """
import sys
sys.path.insert(0, {folder!r})
import kernels_of_a_user
from raymap.jit import compilecache
kernel = kernels_of_a_user.twice
print(kernel(21), sum(kernel.stats.cache_hits.values()), compilecache.cache_folder())
"""

_KERNELS = """
import numba
from raymap.jit.kernels import kernel

@kernel
def twice(value):
    return 2 * value

@numba.njit(cache=True)
def own(value):
    return value + 1

own(1)
"""


def _run(folder, kernels=_KERNELS, program=_PROGRAM, **environment):
    """What the program prints in a process of its own: value, cache hits, folder."""
    (folder / "kernels_of_a_user.py").write_text(kernels)
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-c", program.format(folder=str(folder))],
        env={**kept, "PYTHONPATH": str(_ROOT), **environment},
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
    )
    assert done.stderr == ""
    value, hits, place = done.stdout.split()
    return int(value), int(hits), place


def _files(folder, ending):
    return sorted(folder.rglob(f"*.twice*{ending}"))


def test_code_is_kept_in_a_folder_of_this_state_of_the_sources(tmp_path):
    caches = tmp_path / "caches"
    assert _run(tmp_path, XDG_CACHE_HOME=str(caches))[:2] == (42, 0)
    value, hits, place = _run(tmp_path, XDG_CACHE_HOME=str(caches))
    assert (value, hits) == (42, 1)
    assert place == str(caches / "raymap" / f"compiled-{fingerprint()}")
    assert _files(caches, ".nbi")
    # Functions of others stay where Numba puts them
    assert not list(caches.rglob("*.own*"))
    assert list((tmp_path / "__pycache__").glob("*.own*.nbi"))


def test_damaged_code_is_compiled_again_once(tmp_path):
    path = tmp_path / "kernels_of_a_user.py"
    path.write_text(_KERNELS.partition("@numba")[0])

    def hits():
        names = runpy.run_path(str(path))
        assert names["twice"](21) == 42
        return sum(names["twice"].stats.cache_hits.values()), Path(names["twice"].stats.cache_path)

    assert hits()[0] == 0
    found, folder = hits()
    assert found == 1
    for ending in (".nbc", ".nbi"):
        for each in _files(folder, ending):
            each.write_bytes(each.read_bytes()[:7])
        assert hits()[0] == 0
        assert hits()[0] == 1
    shutil.rmtree(folder)


def test_the_folder_that_the_user_chose_is_used(tmp_path):
    chosen, caches = tmp_path / "chosen", tmp_path / "caches"
    value, _, place = _run(tmp_path, XDG_CACHE_HOME=str(caches), NUMBA_CACHE_DIR=str(chosen))
    assert (value, place) == (42, "None")
    assert _files(chosen, ".nbi")
    assert not caches.exists()


def test_a_folder_that_cannot_be_written_is_no_failure(tmp_path):
    (tmp_path / "file").write_text("in the way of a folder")
    value, _, place = _run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "file" / "caches"))
    assert (value, place) == (42, "None")
    # Not where Numba would put it, either
    shutil.rmtree(tmp_path / "__pycache__")
    (tmp_path / "__pycache__").write_text("in the way of a folder")
    value, hits, place = _run(
        tmp_path,
        kernels=_KERNELS.replace("cache=True", "cache=False"),
        XDG_CACHE_HOME=str(tmp_path / "file" / "caches"),
        HOME="/dev/null",
    )
    assert (value, hits, place) == (42, 0, "None")


_WORKING = """
import numpy as np
from raymap.jit.kernels import kernel

@kernel
def twice(value):
    if value < 0:
        raise ValueError("negative")
    column = np.empty(int(value))
    for k in range(len(column)):
        column[k] = np.cos(0.0)
    total = 0.0
    for item in column:
        total += 2.0 * item
    return int(total)
"""

_LATER = """
import sys
sys.path.insert(0, {folder!r})
from kernels_of_a_user import twice
value, hits = twice(21), sum(twice.stats.cache_hits.values())
compiler = "numba.np.arraymath" in sys.modules
try:
    twice(-1)
except ValueError:
    # Other code can be compiled after kept code was loaded
    value += twice(21.0)
print(value, hits, compiler)
"""


def test_kept_code_is_loaded_without_what_only_the_compiler_needs(tmp_path):
    caches = str(tmp_path / "caches")
    assert _run(tmp_path, _WORKING, _LATER, XDG_CACHE_HOME=caches) == (84, 0, "True")
    for file in _files(tmp_path, ".nbc")[1:]:
        file.unlink()
    assert _run(tmp_path, _WORKING, _LATER, XDG_CACHE_HOME=caches) == (84, 1, "False")


def _tree(folder):
    for room in ("raymap", "tracer"):
        (folder / room / "inner").mkdir(parents=True)
        for name in ("a.py", "inner/b.py"):
            (folder / room / name).write_text("x = 1\n")
    return folder


@pytest.mark.parametrize("change", ["size", "time", "more", "fewer", "version"])
def test_every_change_of_the_sources_has_another_folder(tmp_path, change):
    folder = _tree(tmp_path)
    before = fingerprint(folder)
    assert fingerprint(folder) == before
    path = folder / "tracer" / "inner" / "b.py"
    if change == "size":
        status = path.stat()
        path.write_text("x = 10\n")
        os.utime(path, (status.st_atime, status.st_mtime))
    elif change == "time":
        os.utime(path, (0, 1))
    elif change == "more":
        (folder / "raymap" / "c.py").write_text("")
    elif change == "fewer":
        path.unlink()
    else:
        (folder / "raymap-9.9.dist-info").mkdir()
    assert fingerprint(folder) != before


def test_a_change_of_a_distribution_that_adds_kinds_has_another_folder(tmp_path: Path) -> None:
    site = install(tmp_path)
    ask = "from raymap.jit.compilecache import fingerprint; print(fingerprint())"

    def found() -> str:
        done = run(site, "-c", ask)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    before = found()
    assert found() == before != fingerprint()
    helper = site / "raymap_example_kinds" / "drum.py"
    helper.write_text(helper.read_text(encoding="utf-8") + "\n# changed\n", encoding="utf-8")
    assert found() != before


def test_other_files_do_not_count(tmp_path):
    folder = _tree(tmp_path)
    before = fingerprint(folder)
    (folder / "raymap" / "__pycache__").mkdir()
    (folder / "raymap" / "__pycache__" / "a.py").write_text("")
    (folder / "raymap" / "table.csv").write_text("1,2\n")
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "a.py").write_text("")
    assert fingerprint(folder) == before


def test_folders_out_of_use_are_removed(tmp_path):
    day = 86_400
    ages = {"new": 1, "week": 7, "fortnight": 14, "month": 29, "old": 31}
    for name, days in ages.items():
        folder = tmp_path / f"compiled-{name}"
        (folder / "inner").mkdir(parents=True)
        (folder / "inner" / "a.nbc").write_bytes(b"code")
        os.utime(folder, (time.time() - days * day,) * 2)
    (tmp_path / "others").mkdir()
    own = tmp_path / "compiled-own"
    own.mkdir()
    remove_old(own)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["compiled-fortnight", "compiled-new", "compiled-own", "compiled-week", "others"]
    for name in ("new", "week", "fortnight"):
        os.utime(tmp_path / f"compiled-{name}", (time.time() - 40 * day,) * 2)
    remove_old(own)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["compiled-own", "others"]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners of files are a matter of POSIX")
def test_code_of_others_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder holds pickles and machine code, so whoever writes to it runs code here."""
    folder = tmp_path / "raymap" / "compiled-1"
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "a.nbi").touch()
    assert is_own(folder)
    # Others lose the right to write
    folder.chmod(0o777)
    folder.parent.chmod(0o775)
    assert is_own(folder)
    assert not (folder.stat().st_mode | folder.parent.stat().st_mode) & 0o022
    # A link is not followed, wherever it leads
    link = tmp_path / "raymap" / "compiled-2"
    link.symlink_to(folder)
    assert not is_own(link)
    (folder / "inner" / "b.nbi").symlink_to(folder / "inner" / "a.nbi")
    assert not is_own(folder)
    (folder / "inner" / "b.nbi").unlink()
    assert is_own(folder)
    # Of somebody else: the files, or all of it
    mine = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: mine + 1)
    assert not is_own(folder)
    assert not is_own(tmp_path / "none" / "compiled-3")
