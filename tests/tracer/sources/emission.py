"""Scenes of one source, and where and how its rays start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.model.portion import Portion
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene
from tracer.scene.model import Scene
from tracer.sources.model import SourceModel
from tracer.transport.wavefront import Wavefront


def with_source(model: SourceModel, text: str = "", **spectrum: object) -> Scene:
    """A scene of one source made in Python."""
    scene = parse_scene('length_unit = "mm"\n' + text)
    return scene.model_copy(update={"sources": {"lamp": model}, **spectrum})


def emitted(scene: Scene, n: int, *, first: int = 0) -> Portion:
    compilation = compile_scene(scene)
    return Wavefront(compilation.arrays, 1, meshes=compilation.solids).trace(first, n)


def starts(portion: Portion) -> NDArray[np.int64]:
    return np.concatenate(([0], np.cumsum(portion.records_per_ray, dtype=np.int64)))[:-1]


def directions(portion: Portion) -> NDArray[np.float64]:
    """Of rays that meet nothing: their last record keeps the direction."""
    last = np.cumsum(portion.records_per_ray, dtype=np.int64) - 1
    out = portion.normal[last] / 32767.0
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))
