"""The brightest cell of each path's picture on a detector."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.path_keys import Keys, path_keys
from query.engine.bound import BoundNode
from query.engine.light import light_at, records_at
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import sums

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["find_peaks", "registrations"]

Ints = NDArray[np.integer]
Floats = NDArray[np.float64]


def registrations(found: Found, number: int, detector: int) -> tuple[Ints, NDArray[np.int64]]:
    """Registrations of matching rays on a detector.

    Returns
    -------
    rays : index in the portion of the ray of each registration
    descriptors : row of each registration among the portion's descriptors
    """
    rays = np.flatnonzero(found.masks[number])
    context = found.context(None if len(rays) == found.portion.n_rays else rays)
    hits = np.flatnonzero((context.detector == detector) & context.registered)
    owner = np.searchsorted(context.ray_crossing_offsets, hits, side="right") - 1
    rows = context.descriptor_rows
    descriptors: NDArray[np.int64] = hits if rows is None else rows[hits].astype(np.int64)
    return rays[owner], descriptors


@asked_again
def find_peaks(
    map: RayMap,
    node: BoundNode,
    keys: Keys,
    by: str,
    detector: int,
    emitted: Ints,
    threads: int | None,
    cancel: Cancel,
) -> dict[str, NDArray[Any]]:
    """Brightest cell (n, 2) and its flux (n,) for each row of ``keys``; cell -1 where none."""
    order = np.lexsort((keys.high, keys.low))
    low = keys.low[order]
    width, height = map.directory.detectors[detector].cells

    def rows_of(mine: Keys) -> Ints:
        # Rows are few, so equal low halves of different paths would be a 2^-64 accident per pair.
        at = np.minimum(np.searchsorted(low, mine.low), max(len(low) - 1, 0))
        return order[at]

    def visit(found: Found) -> tuple[NDArray[np.int64], Floats]:
        rays, descriptors = registrations(found, 0, detector)
        if not len(rays):
            return np.zeros(0, np.int64), np.zeros(0)
        paths = found.paths.of_ray[rays]
        mine = path_keys(found.paths.base, by).take(paths)
        cells = found.portion.column("cell")[descriptors].astype(np.int64)
        portion = found.portion
        light = map.photometry(portion.channel_set)
        watt = light.radiant_factors(emitted)[found.paths.base.source[paths]]
        amounts = light_at(portion, light, rays, records_at(portion, descriptors))
        flux = light.flux_by_channel(amounts).sum(axis=1)
        code = (rows_of(mine).astype(np.int64) * height + cells[:, 1]) * width + cells[:, 0]
        return _summed(code, watt * flux)

    pending: list[tuple[NDArray[np.int64], Floats]] = []

    def take(index: int, product: tuple[NDArray[np.int64], Floats]) -> None:
        pending.append(product)
        if len(pending) > 16:
            pending[:] = [_merged(pending)]

    Scan(map, [node], visit=visit, take=take, threads=threads, cancel=cancel).run()
    code, flux = _merged(pending) if pending else (np.zeros(0, np.int64), np.zeros(0))
    # The brightest cell of a row is the last of its run when sorted by flux.
    by_flux = np.lexsort((-code, flux, code // (width * height)))
    rows = (code // (width * height))[by_flux]
    is_last = np.append(rows[1:] != rows[:-1], True) if len(rows) else np.zeros(0, np.bool_)
    best = by_flux[is_last]
    cell = np.full((len(keys.low), 2), -1, np.int64)
    peak = np.zeros(len(keys.low))
    inside = code[best] % (width * height)
    cell[rows[is_last], 0], cell[rows[is_last], 1] = inside % width, inside // width
    peak[rows[is_last]] = flux[best]
    return {"cell": cell, "flux": peak}


def _summed(code: NDArray[np.int64], flux: Floats) -> tuple[NDArray[np.int64], Floats]:
    different, inverse = np.unique(code, return_inverse=True)
    return different, sums(inverse, flux, len(different))


def _merged(
    parts: list[tuple[NDArray[np.int64], Floats]],
) -> tuple[NDArray[np.int64], Floats]:
    return _summed(
        np.concatenate([code for code, _ in parts]), np.concatenate([flux for _, flux in parts])
    )
