"""What only some engines can do: scenes that ask another one for it are refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from raymap.cells import is_pinhole
from raymap.errors import SceneError
from tracer.scene.arrays import (
    COLLIMATED,
    FROM_POINT,
    L_AREA,
    L_DIRECTIONS,
    LAMBERTIAN_CONE,
    UNIFORM_CONE,
)

if TYPE_CHECKING:
    from tracer.scene.compile import Compilation

__all__ = ["refuse_pinholes", "require_plain_scene"]

_PLAIN = (COLLIMATED, LAMBERTIAN_CONE, UNIFORM_CONE)


def refuse_pinholes(compilation: Compilation, engine: str) -> None:
    """Refuse pictures through a point, which need rays of equal weight.

    Raises
    ------
    SceneError
        naming the detector
    """
    place = compilation.scene.origin
    for detector in compilation.directory.detectors:
        if is_pinhole(detector):
            raise SceneError(
                f"{place}: detectors.{detector.name}: a pinhole needs the analog mode, where all "
                f"rays weigh the same, not {engine}; take a camera instead"
            )


def require_plain_scene(compilation: Compilation, engine: str) -> None:
    """Refuse measured light, and detectors other than planes.

    Raises
    ------
    SceneError
        naming the source or detector
    """
    place = compilation.scene.origin
    for detector in compilation.directory.detectors:
        if detector.kind != "plane":
            raise SceneError(
                f"{place}: detectors.{detector.name}: {engine} knows planes only; record the scene "
                "with the general engine"
            )
    rows = compilation.arrays.source_i
    measured = ~np.isin(rows[:, L_DIRECTIONS], _PLAIN) | (rows[:, L_AREA] > FROM_POINT)
    for k, (name, model) in enumerate(compilation.scene.sources.items()):
        if model.on and measured[k]:
            raise SceneError(
                f"{place}: sources.{name}: {engine} does not know light of kind {model.kind!r}; "
                "record the scene with the general engine"
            )
