"""Compiled code that is called by its address, and what two processes compile."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from raymap.jit.compiling import Task, address_of, call_at, compile_ahead, task
from raymap.jit.kernels import inner_kernel, lean_kernel, stage_kernel


@inner_kernel
def _double(value: float) -> float:
    return 2.0 * value


@lean_kernel
def _add(column: NDArray[np.float64], value: float) -> None:
    for k in range(len(column)):
        column[k] += _double(value)


@lean_kernel
def _call(address: int, column: NDArray[np.float64], value: float) -> None:
    call_at(address, (column, value))


def test_a_function_is_called_by_its_address() -> None:
    column = np.arange(5.0)
    _call(address_of(task(_add, column, 0.0)), column, 1.5)
    np.testing.assert_array_equal(column, np.arange(5.0) + 3.0)


@stage_kernel
def _triple(column: NDArray[np.float64], value: float) -> None:
    for k in range(len(column)):
        column[k] = 3.0 * value


def test_a_stage_is_called_by_its_address_only() -> None:
    column = np.arange(5.0)
    _call(address_of(task(_triple, column, 0.0)), column, 1.5)
    np.testing.assert_array_equal(column, 4.5)
    with pytest.raises(TypeError, match="by its address"):
        _triple(column, 1.5)


def test_garbage_is_looked_for_again_after_compiling() -> None:
    compile_ahead([task(_add, np.arange(5.0), 0.0)], processes=1)
    assert gc.isenabled()
    with pytest.raises(AttributeError):
        compile_ahead([task(_add, np.arange(5.0), 0.0), Task(__name__, "absent", ())], processes=1)
    assert gc.isenabled()


SCRIPT = """
import sys
from numba.core import event
import raymap.jit.compiling as compiling

class Watch(event.Listener):
    def on_start(self, event):
        compiled.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

compiled = []
event.register("numba:compile", Watch())
from tracer import record
record(sys.argv[1], sys.argv[2], rays=2000, threads=2, force=True)
# Kept code needs nothing of what the compiler imports
assert bool(compiled) == ("numba.np.arraymath" in sys.modules)
print(" ".join(compiled))
"""

SCENE = """
length_unit = "mm"
flux_unit = "W"
[sources.lamp]
kind = "lambertian"
size = [1, 1]
position = [0, 0, 0]
axis = [0, 0, 1]
flux = 1
[bodies.wall]
kind = "rectangle"
size = [10, 10]
position = [0, 0, 5]
surface = "white"
[surfaces.white]
kind = "lambertian"
reflectance = 0.5
"""


def test_two_processes_share_the_work_and_a_second_start_compiles_nothing(tmp_path: Path) -> None:
    scene, folder = tmp_path / "scene.toml", tmp_path / "compiled"
    scene.write_text(SCENE)

    def run() -> list[str]:
        command = [sys.executable, "-c", SCRIPT, str(scene), str(tmp_path / "a.raymap")]
        environment = {"NUMBA_CACHE_DIR": str(folder), "PATH": ""}
        done = subprocess.run(
            command, env=environment, check=True, capture_output=True, text=True, timeout=600
        )
        return done.stdout.split()

    first, second = run(), run()
    names = {"nearest_hits", "interact", "emit_block", "store_block", "run_steps"}
    mine = names & set(first)
    assert mine
    assert mine < names, "the other process compiled nothing"
    assert second == []
    assert len(list(folder.rglob("*.done"))) >= len(names)
