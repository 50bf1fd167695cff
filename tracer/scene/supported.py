"""What only some engines can do: scenes that ask another one for it are refused."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from raymap.model.errors import SceneError
from tracer.compiled import (
    COLLIMATED,
    FROM_POINT,
    L_AREA,
    L_DIRECTIONS,
    LAMBERTIAN_CONE,
    UNIFORM_CONE,
)

if TYPE_CHECKING:
    from tracer.scene.compile import Compilation
    from tracer.scene.model import Scene

__all__ = [
    "NaturalLight",
    "refuse_weighting",
    "require_plain_scene",
    "warn_of_polarised_light",
]

_PLAIN = (COLLIMATED, LAMBERTIAN_CONE, UNIFORM_CONE)


def require_plain_scene(compilation: Compilation, engine: str) -> None:
    """Refuse measured light, and detectors other than planes.

    Raises
    ------
    SceneError
        naming the source or detector
    """
    where = compilation.scene.origin
    for detector in compilation.directory.detectors:
        if detector.kind != "plane":
            raise SceneError(
                f"{where}: detectors.{detector.name}: {engine} knows planes only; record the scene "
                "with the general engine"
            )
    rows = compilation.arrays.source_i
    measured = ~np.isin(rows[:, L_DIRECTIONS], _PLAIN) | (rows[:, L_AREA] > FROM_POINT)
    for k, (name, model) in enumerate(compilation.scene.sources.items()):
        if model.on and measured[k]:
            raise SceneError(
                f"{where}: sources.{name}: {engine} does not know light of kind {model.kind!r}; "
                "record the scene with the general engine"
            )


def refuse_weighting(scene: Scene, engine: str) -> None:
    """Refuse a scene that asks for the weighted mode, of an engine that draws all light evenly.

    Parameters
    ----------
    engine : names what cannot obey, as the subject of a sentence

    Raises
    ------
    SceneError
        naming the keys of ``[trace]`` that would have no effect
    """
    if scene.trace.mode == "analog":
        return
    keys = ", ".join(sorted(scene.trace.model_fields_set - {"mode"}))
    raise SceneError(
        f"{scene.origin}: trace.mode: {engine} knows the analog mode only, mode = 'weighted' "
        f"({keys}) would have no effect; leave [trace] out"
    )


class NaturalLight(UserWarning):
    """Light that the scene says is polarised is traced as natural light."""


def warn_of_polarised_light(compilation: Compilation) -> None:
    """Say what of a scene has no effect on natural light: vibrations of sources, polarising sheets.

    Warns
    -----
    NaturalLight
    """
    scene = compilation.scene
    if scene.trace.light != "natural" or scene.crystalline:
        return
    for name, source in scene.sources.items():
        if source.on and source.polarisation is not None:
            warnings.warn(
                f"{scene.origin}: sources.{name}.polarisation has no effect on natural light; "
                "polarised light heeds it: [trace] light = 'polarised'",
                NaturalLight,
                stacklevel=3,
            )
    for name, surface in scene.surfaces.items():
        if surface.needs_polarised_light():
            warnings.warn(
                f"{scene.origin}: surfaces.{name}: a {surface.kind} does to natural light what it "
                "does to light that no other has met; behind one another, or in polarised light, "
                "they need [trace] light = 'polarised'",
                NaturalLight,
                stacklevel=3,
            )
