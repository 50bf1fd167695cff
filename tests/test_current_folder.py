"""Modules that a stranger left in the current folder are not executed, or named, never obeyed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from raymap.rooms import ROOMS, trusted_path
from tests.raymap.maps import write_small

_ROOT = Path(__file__).resolve().parents[1]
_NAMES = (
    "numba", "numpy", "json", "query", "tracer", "service", "viewer", "typer", "pickle", "enum",
    "pydantic", "dataclasses", "colorsys", "zstandard",
)  # fmt: skip


@pytest.fixture
def left(tmp_path):
    """A folder with a map, and modules that leave a mark where they are executed."""
    write_small(tmp_path / "a.raymap", n_portions=1, n_rays=5)
    for name in _NAMES:
        text = f"open({str(tmp_path / 'EXECUTED')!r}, 'a').write({name!r})\n"
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    return tmp_path


def _run(folder, *command, **variables):
    # As installed: our packages are found behind all others, not by a variable of this test
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        command,
        cwd=folder,
        env={**environment, **variables},
        capture_output=True,
        text=True,
        check=False,
    )


_ENTRY = "import sys; sys.path[0] = {root!r}; from raymap.cli import main; main()"


@pytest.mark.parametrize("words", [("info", "a.raymap"), ("query", "a.raymap", "length > 10")])
def test_the_command_takes_nothing_from_the_current_folder(left, words):
    # What the script of the entry point does: its own folder comes first, not the current one
    script = left / "bin" / "raymap-script.py"
    script.parent.mkdir()
    script.write_text(_ENTRY.format(root=str(_ROOT)), encoding="utf-8")
    done = _run(left, sys.executable, str(script), *words)
    assert done.returncode == 0, done.stderr
    assert not (left / "EXECUTED").exists(), (left / "EXECUTED").read_text()


@pytest.mark.parametrize("words", [("info", "a.raymap"), ("query", "a.raymap", "length > 10")])
def test_python_m_leaves_the_current_folder(left, words):
    done = _run(left, sys.executable, "-m", "raymap", *words, PYTHONPATH=str(_ROOT))
    assert done.returncode == 0, done.stderr
    assert not (left / "EXECUTED").exists(), (left / "EXECUTED").read_text()


@pytest.mark.parametrize("name", [name for name in ROOMS if name != "raymap"])
def test_a_module_that_hides_one_of_ours_is_named_and_not_executed(tmp_path, name):
    mark = tmp_path / "EXECUTED"
    (tmp_path / f"{name}.py").write_text(f"open({str(mark)!r}, 'w')", encoding="utf-8")
    path = os.pathsep.join((str(tmp_path), str(_ROOT)))
    done = _run(tmp_path, sys.executable, "-m", "raymap", "info", "x", PYTHONPATH=path)
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert f"{name}.py hides the package '{name}' of Raymap: rename it" in line
    assert not mark.exists()


def test_processes_that_we_start_get_no_relative_folder(monkeypatch):
    monkeypatch.setattr(sys, "path", ["", ".", *sys.path])
    assert trusted_path()[0] == str(_ROOT)
    assert all(os.path.isabs(place) for place in trusted_path())


def test_every_process_that_we_start_is_isolated():
    """Python's ``-I``: neither the current folder nor ``PYTHONPATH`` adds to where it imports."""
    started = 0
    for room in ROOMS:
        for path in (_ROOT / room).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            assert "multiprocessing" not in text, path
            started += text.count("[sys.executable")
            assert text.count("[sys.executable") == text.count('[sys.executable, "-I"'), path
    assert started >= 2


def test_the_process_that_helps_to_compile_takes_nothing_from_the_current_folder(left):
    """The first compilation, with nothing in the cache: another process does half of it."""
    code = (
        f"import sys; sys.path.insert(0, {str(_ROOT)!r})\n"
        "import os; os.cpu_count = lambda: 2\n"
        "import numpy as np\n"
        "from raymap.bytes import planes\nfrom raymap.jit import compiling\n"
        "from raymap.encoding.detector_crossings import _cells_fit\n"
        "one = compiling.task(_cells_fit, np.zeros(1, 'i2'), np.zeros((1, 2), 'u2'),"
        " np.zeros((1, 2), 'i8'))\n"
        "two = compiling.task(planes._split2, np.zeros(1, 'u2'), np.zeros((2, 1), 'u1'))\n"
        "compiling.compile_ahead([one, two], processes=2)\n"
    )
    cache = left / "cache"
    cache.mkdir(mode=0o700)
    done = _run(left, sys.executable, "-P", "-c", code, NUMBA_CACHE_DIR=str(cache))
    assert done.returncode == 0, done.stderr
    assert not (left / "EXECUTED").exists(), (left / "EXECUTED").read_text()
    assert list(cache.rglob("*.nbi"))
