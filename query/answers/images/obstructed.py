"""What ended light before it came to a place where a detector was put after the trace."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from query.answers.selections.selector import bind_all
from query.engine.places import is_place, parse_place
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import source_factors
from raymap.optics.photometry import ray_weights
from raymap.passes.crossings import Segments

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["ended_before"]

Floats = NDArray[np.float64]


@asked_again
def ended_before(
    map: RayMap,
    where: str,
    criterion: object = None,
    *,
    threads: int | None = None,
    cancel: Cancel = None,
) -> dict[str, float]:
    """Flux that ended on objects and would have come to a place straight behind them.

    A detector that is put behind a body sees what came past it; this is what the body took.

    Parameters
    ----------
    where : its description (`query.with_detectors`); nothing is told of recorded detectors

    Returns
    -------
    flux [flux unit] by name of the object, largest first
    """
    if not is_place(where):
        return {}
    found_at = parse_place(where, map.directory)
    faces = map.directory.faces
    n_sources, n_objects = len(map.directory.sources), len(faces.object_names)
    sums = np.zeros((n_objects, n_sources))

    def visit(found: Found) -> Floats:
        portion = found.portion
        rays = Segments(portion).ended_before(found_at)
        rays = rays[found.masks[0][rays]]
        owner = portion.column("object")[portion.record_offsets()[1:][rays] - 1].astype(np.int64)
        rays, owner = rays[owner >= 0], owner[owner >= 0]
        weight = ray_weights(portion, rays)
        label = owner * n_sources + portion.column("source")[rays]
        flux = np.bincount(label, weight, n_objects * n_sources)
        return flux.reshape(n_objects, n_sources).astype(np.float64)

    def take(_: int, product: Floats) -> None:
        nonlocal sums
        sums = sums + product

    scan = Scan(
        map, bind_all(map, [criterion]), visit=visit, take=take, threads=threads, cancel=cancel
    )
    scan.run()
    emitted = scan.emitted if scan.complete else map.emitted
    flux = sums @ source_factors(map.directory, emitted)
    order = np.argsort(-flux, kind="stable")
    return {faces.object_names[k]: float(flux[k]) for k in order.tolist() if flux[k] > 0.0}
