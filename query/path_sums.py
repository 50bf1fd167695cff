"""Sums over the paths of a selection, wherever they are kept: merged, or portion by portion."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from query.context import PathContext
from query.scan import Cancel, Progress, Scan, Totals
from query.search import Found
from query.second_try import asked_again
from query.selector import bind_all
from query.tally import Tally
from raymap.photometry import ray_weights

if TYPE_CHECKING:
    from raymap.reader import RayMap

__all__ = ["sum_over_paths"]

T = TypeVar("T")


@asked_again
def sum_over_paths(
    map: RayMap,
    criterion: object,
    reduce: Callable[[PathContext, Tally], T],
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
) -> tuple[list[T], Totals, Scan]:
    """Reduce the paths of a selection and how many rays took each.

    Parameters
    ----------
    reduce : called with paths and a tally with one entry per path; in worker threads

    Returns
    -------
    products : of the merged paths and of each portion that stands alone
    totals : of the selection
    scan : what was served
    """
    [node] = bind_all(map, [criterion])
    products: list[T] = []

    def visit(found: Found) -> T:
        base, portion = found.paths.base, found.portion
        rays = np.flatnonzero(found.masks[0])
        weight = ray_weights(portion, rays)
        emission = portion.column("emission")[rays] if portion.grouped else None
        tally = Tally.of_rays(found.paths.of_ray[rays], weight, emission, base.n_rays)
        return reduce(base, tally)

    merged = map.merged
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
    )
    [totals] = scan.run()
    if scan.verdicts.base is not None:
        products.append(reduce(scan.verdicts.base, totals.by_label))
    return products, totals, scan
