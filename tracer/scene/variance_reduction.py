"""The table ``[trace]`` of a scene: how light is followed; targets of the weighted mode."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from raymap.model.errors import SceneError
from raymap.model.names import nearest_names
from raymap.model.wildcards import Wildcard
from raymap.optics.frames import transverse_axes
from tracer.compiled import (
    TARGET_RECTANGLE,
    TARGET_RING,
    TARGET_ROW,
    TARGET_SPHERE,
    VarianceReduction,
)
from tracer.description.fields import Node
from tracer.geometry.shapes import Annulus, Rectangle, Shape

__all__ = ["TraceModel", "compile_variance_reduction"]

Array = NDArray[np.float64]

_WEIGHTED = (
    "min_reflection", "split_depth", "aim", "aim_share", "roulette_weight", "rays_per_emission",
)  # fmt: skip
_POLARISED = ("states", "phases")


class TraceModel(Node):
    """How light is followed.

    analog : every ray carries the same flux
    weighted : rays carry weights, fluxes stay the same. ``min_reflection`` is the least probability
        of a reflection at a smooth interface, of a scatter and of light that a surface sends on;
        ``split_depth``: light is split at smooth interfaces until so many reflections have split
        it off; ``aim``: names of faces, bodies or detectors that scattered light is aimed at, with
        the probability ``aim_share``; rays of a weight below ``roulette_weight`` meet Russian
        roulette; ``rays_per_emission`` is the most that one emission may become

    ``light`` is natural or polarised. Of polarised light ``states`` says what unpolarised sources
    send: "linear" draws one linear wave per ray, "natural" carries both halves of natural light
    along; ``phases`` stores phases and exact optical paths. ``lens_trees`` traces lenses as
    primitives, all branches of a tree of that many levels kept until they fall below ``min_flux``,
    a share of their emission.
    """

    light: Literal["natural", "polarised"] = "natural"
    states: Literal["linear", "natural"] = "linear"
    phases: bool = False
    lens_trees: Annotated[int, Field(ge=1, le=1000)] | None = None
    min_flux: Annotated[float, Field(ge=0, lt=1)] = 1e-6
    mode: Literal["analog", "weighted"] = "analog"
    min_reflection: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    split_depth: Annotated[int, Field(ge=0, le=16)] = 0
    aim: tuple[str, ...] = ()
    aim_share: Annotated[float, Field(gt=0, le=0.9)] = 0.5
    roulette_weight: Annotated[float, Field(ge=0, lt=1)] = 0.0
    rays_per_emission: Annotated[int, Field(ge=2, le=65536)] = 256

    @model_validator(mode="before")
    @classmethod
    def _say_what_is_gone(cls, given: Any) -> Any:
        if isinstance(given, dict) and "polarisers" in given:
            raise ValueError(
                "polarisers are surfaces now: give the face a surface of kind = 'polariser' that "
                "absorbs = [x, y, z]"
            )
        return given

    def model_post_init(self, context: Any) -> None:
        for keys, goes, needs in (
            (_WEIGHTED, self.mode == "weighted", "mode = 'weighted'"),
            (_POLARISED, self.light == "polarised", "light = 'polarised'"),
            (("min_flux",), self.lens_trees is not None, "lens_trees"),
        ):
            given = sorted(self.model_fields_set & set(keys))
            if given and not goes:
                raise ValueError(f"{', '.join(given)} goes with {needs}")
        if self.lens_trees is not None and self.light == "polarised":
            raise ValueError(
                "lens_trees start from natural light and keep its polarisation on the way: leave "
                "light = 'polarised' out"
            )
        if self.mode == "weighted" and not (self.min_reflection or self.split_depth or self.aim):
            raise ValueError(
                "the weighted mode needs something to do: min_reflection, split_depth or aim"
            )
        for key, needed in (("aim_share", "aim"), ("rays_per_emission", "split_depth")):
            if key in self.model_fields_set and not getattr(self, needed):
                raise ValueError(f"{key} goes with {needed}, without which it has no effect")


def compile_variance_reduction(
    model: TraceModel,
    faces: Mapping[str, Sequence[Shape]],
    detectors: Mapping[str, tuple[Rectangle, bool]],
    origin: str,
) -> VarianceReduction:
    """Settings and targets of the weighted mode for the engine.

    Parameters
    ----------
    faces : shapes of every face by its full name ``body.face``
    detectors : plane of every detector that can be aimed at, and whether both its sides register
    origin : names the scene in messages

    Raises
    ------
    SceneError
        a name that nothing carries
    """
    targets: list[Array] = []
    for pattern in model.aim:
        wanted = Wildcard(pattern, escapes=False)
        rows = [
            _rectangle(plane, both_sides=both)
            for name, (plane, both) in detectors.items()
            if wanted.matches(name)
        ]
        owners = dict.fromkeys(name.rpartition(".")[0] for name in faces)
        for owner in owners:
            if wanted.matches(owner) and owner not in detectors:
                whole = [s for n in faces if n.rpartition(".")[0] == owner for s in faces[n]]
                rows.append(_target(whole))
        for name, shapes in faces.items():
            if wanted.matches(name) and name.rpartition(".")[0] not in detectors:
                rows.append(_target(shapes))
        if not rows:
            known = dict.fromkeys([*detectors, *owners, *faces], 0)
            raise SceneError(
                f"{origin}: trace.aim: nothing that can be aimed at is called "
                f"{pattern!r}{nearest_names(pattern, known)}"
            )
        targets += rows
    settings = np.array(
        [
            model.min_reflection,
            model.split_depth,
            model.roulette_weight,
            model.aim_share if targets else 0.0,
            model.rays_per_emission,
        ]
    )
    return VarianceReduction(settings, np.array(targets).reshape(-1, TARGET_ROW))


def _target(shapes: Iterable[Shape]) -> Array:
    """One shape as it is where that can be sampled, else the sphere about all of them."""
    known = list(shapes)
    if len(known) == 1 and isinstance(known[0], Rectangle):
        return _rectangle(known[0], both_sides=True)
    if len(known) == 1 and isinstance(known[0], Annulus):
        ring = known[0]
        s = np.zeros(TARGET_ROW)
        x, u = transverse_axes(ring.normal)
        s[0], s[1:4], s[4:7] = TARGET_RING, ring.origin, ring.normal
        s[7:10], s[10:13] = u, -x
        s[13:16] = ring.inner, ring.outer, ring.outer
        return s
    boxes = [shape.bounds() for shape in known]
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    s = np.zeros(TARGET_ROW)
    s[0], s[1:4] = TARGET_SPHERE, (low + high) / 2.0
    s[15] = np.linalg.norm(high - low) / 2.0
    return s


def _rectangle(plane: Rectangle, *, both_sides: bool) -> Array:
    s = np.zeros(TARGET_ROW)
    s[0], s[1:4], s[4:7] = TARGET_RECTANGLE, plane.origin, plane.normal
    s[7:10], s[10:13] = plane.u, plane.v
    s[13], s[14] = plane.size[0] / 2.0, plane.size[1] / 2.0
    s[15] = np.hypot(s[13], s[14])
    s[16] = 0.0 if both_sides else 1.0
    return s
