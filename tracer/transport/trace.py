"""Trace given rays through a scene and hand back what they met, in float64."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.model.portion import Portion
from tracer.description.channels import Spectrum
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene
from tracer.scene.model import Scene
from tracer.transport.wavefront import Wavefront

__all__ = ["TracedRays", "trace_rays"]


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedRays:
    """Given rays and the points that they reached.

    Attributes
    ----------
    points : (n_records, 3) float64 [scene units], ray after ray, the first one its origin
    offsets : (n_rays + 1,) int64; points of ray i are rows offsets[i]:offsets[i + 1]
    object, event : (n_records,) as in `raymap.Portion`
    object_names : by index
    portion : all other columns
    """

    points: NDArray[np.float64]
    offsets: NDArray[np.int64]
    object: NDArray[np.int16]
    event: NDArray[np.int32]
    object_names: tuple[str, ...]
    portion: Portion


def trace_rays(
    scene: str | Path | Scene,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    wavelength_nm: float,
    follow: Literal["transmitted", "random"] = "transmitted",
    seed: int = 1,
) -> TracedRays:
    """Trace rays of one wavelength that start in the world medium.

    Parameters
    ----------
    origins, directions : (n, 3) [scene units]; directions are normalised
    wavelength_nm : vacuum wavelength [nm]
    follow : "transmitted" takes the refracted ray at every smooth interface that lets light
        through; "random" chooses as a recorded trace does

    Raises
    ------
    SceneError
        for arrays of another shape, or a direction of length zero
    """
    start = np.ascontiguousarray(np.atleast_2d(origins), np.float64)
    along = np.ascontiguousarray(np.atleast_2d(directions), np.float64)
    if start.shape != along.shape or start.ndim != 2 or start.shape[1] != 3:
        raise SceneError(
            f"origins and directions must both be (n, 3), not {start.shape} and {along.shape}"
        )
    length = np.linalg.norm(along, axis=1, keepdims=True)
    if not np.all(length > 0.0):
        raise SceneError("a direction has length zero; give every ray a direction")
    loaded = scene if isinstance(scene, Scene) else load_scene(scene)
    spectrum = Spectrum(kind="spectral", wavelengths_nm=(wavelength_nm,))
    compilation = compile_scene(loaded.model_copy(update={"spectrum": spectrum}))
    engine = Wavefront(compilation.arrays, seed, meshes=compilation.solids, exact=True)
    portion = engine.trace_given(start, along / length, follow=1 if follow == "transmitted" else 0)
    return TracedRays(
        points=np.asarray(portion.extra["exact"], np.float64),
        offsets=np.concatenate(([0], np.cumsum(portion.records_per_ray, dtype=np.int64))),
        object=portion.object,
        event=portion.event,
        object_names=tuple(item.name for item in compilation.directory.objects),
        portion=portion,
    )
