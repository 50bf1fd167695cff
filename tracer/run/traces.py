"""Which way of following light a scene asks for.

Ways beside natural light register under the entry-point group ``tracer.traces``, by the name that
`tracer.scene.model.Scene.light` gives: a function from a scene, compiled or not, to a `Trace`.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import SceneError
from raymap.model.parts import is_there
from tracer.run.natural import NaturalTrace
from tracer.run.trace import Trace
from tracer.scene.compilations import compilation_of
from tracer.scene.compile import Compilation
from tracer.scene.load import load_scene
from tracer.scene.model import Scene

__all__ = ["described", "trace_of"]

NATURAL = "natural"


def described(scene: str | Path) -> tuple[Directory, ChannelSet]:
    """Directory and channel set that a map of a scene file would have.

    Raises
    ------
    SceneError
    """
    trace = trace_of(scene)
    return trace.directory, trace.channel_set


def trace_of(scene: str | Path | Scene | Compilation | Trace) -> Trace:
    """The trace that a scene asks for, compiled as far as that is left to do.

    Raises
    ------
    SceneError
        as of `load_scene` and the compilers; also where what follows such light is not installed
    """
    if isinstance(scene, str | Path):
        scene = load_scene(scene)
    if not isinstance(scene, Scene | Compilation):
        return scene
    described = scene.scene if isinstance(scene, Compilation) else scene
    if described.light == NATURAL:
        return NaturalTrace(compilation_of(scene))
    known = {point.name: point for point in entry_points(group="tracer.traces") if is_there(point)}
    if described.light not in known:
        raise SceneError(
            f"{described.origin}: nothing is installed that follows the light of this scene "
            f"({described.light})"
        )
    make: Any = known[described.light].load()
    trace: Trace = make(scene)
    return trace
