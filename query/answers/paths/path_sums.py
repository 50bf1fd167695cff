"""Sums over the paths of a selection, wherever they are kept: merged, or portion by portion."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from query.answers.selections.selector import bind_all
from query.engine.context import PathContext
from query.engine.scan import Cancel, Progress, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import Tally
from raymap.model.rows import rows_of_rays
from raymap.optics.photometry import ray_weights

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["LabelSums", "PathLabels", "sum_over_paths"]

Ints = NDArray[np.int64]


class PathLabels(NamedTuple):
    """Under which labels some paths are counted.

    Attributes
    ----------
    path, label : (n,) pairs, in any order; a path may have several labels, or none
    size : labels are 0 … size - 1
    about : what they stand for
    """

    path: Ints
    label: Ints
    size: int
    about: Any = None


class LabelSums(NamedTuple):
    """Sums by label of some paths, and what the labels stand for."""

    tally: Tally
    about: Any


@asked_again
def sum_over_paths(
    map: RayMap,
    criterion: object,
    labels: Callable[[PathContext, Ints], PathLabels],
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
) -> tuple[list[LabelSums], Scan]:
    """Add up the rays of a selection by labels of their paths.

    Where one emission becomes several rays, what they bring to a label is added up before it is
    squared, whichever paths they take.

    Parameters
    ----------
    labels : called with paths and how many rays took each; in worker threads

    Returns
    -------
    sums : of the merged paths and of each portion that stands alone
    scan : what was served
    """
    [node] = bind_all(map, [criterion])
    products: list[LabelSums] = []

    def visit(found: Found) -> LabelSums:
        base, portion = found.paths.base, found.portion
        rays = np.flatnonzero(found.masks[0])
        weight = ray_weights(portion, rays)
        path = found.paths.of_ray[rays]
        if portion.grouped:
            known = labels(base, np.bincount(path, minlength=base.n_rays))
            return _by_ray(known, base.n_rays, path, weight, portion.column("emission")[rays])
        return _by_path(labels, base, Tally.of_rays(path, weight, None, base.n_rays))

    # Squares of the merged paths do not tell what one emission brings by several paths
    use_merged = not any(portion.grouped for portion in map.portions)
    merged = map.merged if use_merged else None
    scan = Scan(
        map,
        [node],
        visit=visit,
        take=lambda _, product: products.append(product),
        plain_only=True,
        labels=None if merged is None else np.arange(merged.paths.n_paths),
        threads=threads,
        progress=progress,
        cancel=cancel,
        use_merged=use_merged,
    )
    [totals] = scan.run()
    if scan.verdicts.base is not None:
        products.append(_by_path(labels, scan.verdicts.base, totals.by_label))
    return products, scan


def _by_path(
    labels: Callable[[PathContext, Ints], PathLabels], base: PathContext, tally: Tally
) -> LabelSums:
    path, label, size, about = labels(base, tally.rays)
    own = tally.rays[path], tally.sum_w[path], tally.sum_w2[path]
    return LabelSums(Tally.of_paths(label, *own, size), about)


def _by_ray(
    labels: PathLabels,
    n_paths: int,
    path_of_ray: NDArray[np.integer],
    weight: NDArray[np.float64] | None,
    emission: NDArray[np.integer],
) -> LabelSums:
    """Each ray once for every label of its path."""
    counts = np.bincount(labels.path, minlength=n_paths)
    offsets = np.concatenate(([0], np.cumsum(counts)))
    pairs = np.argsort(labels.path, kind="stable")[
        rows_of_rays(offsets, path_of_ray.astype(np.int64))
    ]
    ray = np.repeat(np.arange(len(path_of_ray)), counts[path_of_ray])
    own = None if weight is None else weight[ray]
    tally = Tally.of_rays(labels.label[pairs], own, emission[ray], labels.size)
    return LabelSums(tally, labels.about)
