"""A scene as tracers take it: a file, a `Scene`, or what is compiled already."""

from __future__ import annotations

from pathlib import Path

from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.load import load_scene
from tracer.scene.model import Scene

__all__ = ["compilation_of"]


def compilation_of(scene: str | Path | Scene | Compilation) -> Compilation:
    """Read and compile a scene, as far as that is left to do.

    Raises
    ------
    SceneError
        as of `load_scene` and `compile_scene`
    """
    if isinstance(scene, Compilation):
        return scene
    return compile_scene(scene if isinstance(scene, Scene) else load_scene(scene))
