"""Do sources stand where the scene says: outside all solids, or inside the one they name?

A few rays of each source tell: one that leaves a solid it was never in, or enters the one it is
said to be in, meets its first face in a wrong order.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raymap.jit.compiling import compile_ahead
from raymap.model.errors import SceneError
from raymap.model.events import Event
from raymap.model.portion import Portion
from tracer.transport.wavefront import Wavefront

if TYPE_CHECKING:
    from tracer.scene.compile import Compilation
    from tracer.sources.source import Source

__all__ = ["MisplacedLight", "check_sources"]

_RAYS = 512
_ERROR = int(Event.GEOMETRY_ERROR)


class MisplacedLight(UserWarning):
    """Part of a source's light starts in a solid that the source does not name."""


def check_sources(
    compilation: Compilation, *, seed: int = 1, engine: Wavefront | None = None
) -> None:
    """Trace a few rays and see whether they start where the scene says.

    Parameters
    ----------
    engine : traces them; by default one of this scene with the seed

    Raises
    ------
    SceneError
        where most of a source's rays start in a solid it does not name, or outside the one it does

    Warns
    -----
    MisplacedLight
        where some of its rays do, with their share and a place
    """
    solids = [name for name, body in compilation.scene.bodies.items() if body.medium is not None]
    if not solids:
        return
    if engine is None:
        engine = Wavefront(compilation.arrays, seed, meshes=compilation.solids, weighted=True)
        compile_ahead(engine.tasks(), processes=2)
    portion = engine.trace(0, max(16, _RAYS // engine.max_branches))
    wrong, leaving = _wrong_starts(portion)
    for k, (name, model) in enumerate(compilation.scene.sources.items()):
        mine = portion.source == k
        # A solid must be left, or be said to hold the source: all else is rounding at its edge
        bad = np.flatnonzero(mine & wrong & (leaving | bool(model.inside)))
        where = f"{compilation.scene.origin}: sources.{name}"
        if not len(bad):
            _warn_of_stacks(compilation, portion, k, where)
            continue
        first = _firsts(portion)[bad[0]]
        x, y, z = portion.position[first].tolist()
        solid = compilation.directory.objects[int(portion.object[first + 1])].name
        share = len(bad) / int(mine.sum())
        if leaving[bad[0]]:
            what = f"starts inside the solid {solid!r}, for example at ({x:.6g}, {y:.6g}, {z:.6g})"
            remedy = f"move it out, or say inside = {_inside(model, solid)}"
        else:
            said = " and ".join(repr(item) for item in model.inside)
            what = f"is said to be inside {said} but starts outside {solid!r}, for "
            what += f"example at ({x:.6g}, {y:.6g}, {z:.6g})"
            remedy = "move it in, or drop inside"
        if share > 0.5:
            raise SceneError(f"{where}: {what}; {remedy}")
        warnings.warn(
            f"{where}: {share:.1%} of its light {what} and ends as a geometry error; {remedy}",
            MisplacedLight,
            stacklevel=3,
        )


def _inside(model: Source, solid: str) -> str:
    """What the scene file should say of a source that stands in one more solid."""
    names = [f'"{item}"' for item in (solid, *model.inside)]
    return names[0] if len(names) == 1 else f"[{', '.join(names)}]"


def _warn_of_stacks(compilation: Compilation, portion: Portion, k: int, where: str) -> None:
    """Warn where light leaves, later on, a solid that holds the source and that it never entered.

    So does light from a pocket: it leaves the solid in which its source stands, and then the one
    around that.
    """
    firsts = _firsts(portion)
    ends = firsts + portion.records_per_ray - 1
    mine = portion.source == k
    for ray in np.flatnonzero(mine & (portion.event[ends] & _ERROR != 0)):
        first, end = int(firsts[ray]), int(ends[ray])
        solid = int(portion.object[end])
        way = portion.position[end].astype(np.float64) - portion.position[end - 1]
        if way @ portion.normal[end] <= 0.0 or solid in portion.object[first:end]:
            continue
        mesh = compilation.meshes.get(solid)
        start = portion.position[first]
        if mesh is None or np.any(start < mesh.vertices.min(axis=0)) or np.any(start > mesh.vertices.max(axis=0)):  # fmt: skip # noqa: E501
            continue
        x, y, z = start.tolist()
        name = compilation.directory.objects[solid].name
        model = list(compilation.scene.sources.values())[k]
        warnings.warn(
            f"{where}: leaves the solid {name!r} without having entered it, as light that starts "
            f"at ({x:.6g}, {y:.6g}, {z:.6g}), and ends there as a geometry error; if {name!r} "
            f"holds the source, say inside = {_inside(model, name)}",
            MisplacedLight,
            stacklevel=4,
        )
        return


def _firsts(portion: Portion) -> NDArray[np.int64]:
    """First record of each ray."""
    ends = np.cumsum(portion.records_per_ray, dtype=np.int64)
    return np.asarray(ends - portion.records_per_ray, np.int64)


def _wrong_starts(portion: Portion) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Rays whose first face is met in a wrong order, and whether they were leaving a solid."""
    first = _firsts(portion)
    second = np.minimum(first + 1, portion.n_records - 1)
    wrong = (portion.records_per_ray > 1) & (portion.event[second] & _ERROR != 0)
    way = portion.position[second].astype(np.float64) - portion.position[first]
    leaving = np.einsum("ij,ij->i", way, portion.normal[second].astype(np.float64)) > 0.0
    return wrong, leaving
