"""One engine for all tests instead of one for each kind of scene.

The engine is compiled for what a scene needs: members of the compiled scene that are None are left
out, and every combination of them compiles for half a minute. Under test each scene gets all of
them, empty where it needs none, so that one engine traces nearly all. What users run, the engine of
each scene's own needs, is held against it by ``tests/tracer/transport/test_own_engines.py``, and
runs all tests with ``pytest --own-engines``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from tracer.compiled import VIEW_ROW, CoincidentFaces, CompiledScene, Views
from tracer.scene import compile as compiling
from tracer.scene.model import Scene

__all__ = ["own_compile", "whole", "whole_engine"]

_OWN = compiling._Compiler.compile


def own_compile(scene: Scene) -> compiling.Compilation:
    """Compile a scene as users do."""
    return _OWN(compiling._Compiler(scene))


def whole(arrays: CompiledScene) -> CompiledScene:
    """The same scene with nothing left out."""
    n_detectors = len(arrays.detector_i)
    empty = {
        "pool": np.zeros(1),
        "tables": np.zeros(1),
        "coincident": CoincidentFaces(
            first=np.zeros(len(arrays.face_i) + 1, np.int64), face=np.zeros(0, np.int64)
        ),
        "light_pool": np.zeros(1),
        "light_rays": np.zeros((0, 7), np.float32),
        "views": Views(
            kind=np.zeros(n_detectors, np.int64), numbers=np.zeros((n_detectors, VIEW_ROW))
        ),
    }
    left_out = [name for name in empty if getattr(arrays, name) is None]
    return arrays._replace(**{name: empty[name] for name in left_out})


@contextmanager
def whole_engine() -> Iterator[None]:
    """Compile every scene so that the whole engine traces it."""

    def compile_whole(compiler: compiling._Compiler) -> compiling.Compilation:
        compilation = _OWN(compiler)
        return replace(compilation, arrays=whole(compilation.arrays))

    compiling._Compiler.compile = compile_whole  # type: ignore[method-assign]
    try:
        yield
    finally:
        compiling._Compiler.compile = _OWN
