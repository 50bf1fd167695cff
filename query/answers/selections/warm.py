"""Load compiled code before a clock starts: a criterion tried on a single path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from query.answers.selections.selector import bind_all
from query.engine.bound import evaluate
from query.engine.context import PathContext
from raymap.encoding.paths import PathDictionary

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["warm_up"]


def warm_up(map: RayMap, criterion: object) -> None:
    """Read the merged dictionary and load the compiled loops that a criterion needs.

    Commands call it between opening and timing, as part of the imports.
    """
    merged = map.merged
    [node] = bind_all(map, [criterion])
    if merged is not None and merged.paths.n_paths:
        evaluate(PathContext(_first_path(merged.paths)), node)


def _first_path(paths: PathDictionary) -> PathDictionary:
    """A dictionary of the first path alone."""
    n_points = int(paths.offsets[1])
    n_crossings = int(paths.detector_offsets[n_points])
    return PathDictionary(
        source=paths.source[:1],
        offsets=paths.offsets[:2],
        object=paths.object[:n_points],
        face=paths.face[:n_points],
        event=paths.event[:n_points],
        medium=paths.medium[:n_points],
        detector_offsets=paths.detector_offsets[: n_points + 1],
        detector=paths.detector[:n_crossings],
        registered=paths.registered[:n_crossings],
        rays=paths.rays[:1],
        sum_w=paths.sum_w[:1],
        sum_w2=paths.sum_w2[:1],
        sum_wc=tuple(sums[:1] for sums in paths.sum_wc),
        sum_wy2=None if paths.sum_wy2 is None else paths.sum_wy2[:1],
        grouped=paths.grouped,
    )
