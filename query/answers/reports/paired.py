"""Errors of differences between two maps that hold the same emissions.

With d(e) what emission e carries in the second map less what it carries in the first, the squared
error of the difference is the sum over sources of Σ d² - (Σ d)² / N_s. Where both scenes send most
rays the same way d is zero for most of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.path_keys import Keys, path_keys
from query.answers.reports.emissions import seeds_by_portion
from query.answers.selections.selector import bind_all
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.tally import source_factors, sums
from raymap.optics.fluxes import spread
from raymap.optics.photometry import ray_weights

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["PairedErrors", "Side", "paired_errors"]

Ints = NDArray[np.integer]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two maps, with the rows that its paths belong to.

    Attributes
    ----------
    keys : of the paths of the selection
    row : (n_paths,) row that each of them counts for
    """

    map: RayMap
    keys: Keys
    row: Ints


@dataclass(frozen=True, eq=False)
class PairedErrors:
    """Standard errors of differences [flux unit], and how many emissions differ at all."""

    total: float
    rows: Floats
    differing: int


@dataclass(frozen=True, eq=False)
class _Block:
    """Matching rays of one portion."""

    seed: int | None
    first_ray: int
    end: int
    emission: NDArray[np.int64]
    row: NDArray[np.int64]
    source: NDArray[np.int64]
    flux: Floats

    def parts(self, horizon: int) -> tuple[_Block | None, _Block | None]:
        """Rays of emissions up to the horizon, and the others."""
        inside = self.emission <= horizon
        return self._some(inside), self._some(~inside)

    def _some(self, mask: NDArray[np.bool_]) -> _Block | None:
        if mask.all():
            return self
        if not mask.any():
            return None
        return replace(
            self,
            emission=self.emission[mask],
            row=self.row[mask],
            source=self.source[mask],
            flux=self.flux[mask],
        )


def paired_errors(
    sides: Sequence[Side],
    criterion: object,
    by: str,
    row_sources: Ints,
    *,
    threads: int | None = None,
    cancel: Cancel = None,
) -> PairedErrors | None:
    """Errors of what the second map has more than the first, in all and by row.

    Parameters
    ----------
    sides : two maps of the same emissions (`query.answers.reports.emissions.relation`)
    row_sources : (n_rows,) source of each row

    Returns
    -------
    None if the search was cancelled
    """
    emitted = sides[0].map.emitted
    pairing = _Pairing(len(row_sources), len(emitted))
    streams = [_Stream(side, criterion, by, threads, cancel) for side in sides]
    while any(stream.open for stream in streams):
        # The map that lags behind goes on, so that little has to wait
        k = min((0, 1), key=lambda n: streams[n].reached if streams[n].open else np.inf)
        block = streams[k].take()
        pairing.add(k, block, [stream.ended for stream in streams])
    pairing.close()
    if not all(stream.scan.complete for stream in streams):
        return None
    own = spread(emitted[row_sources], pairing.row_sum, pairing.row_square)
    whole = spread(emitted, pairing.source_sum, pairing.source_square)
    return PairedErrors(
        total=float(np.sqrt(whole.sum())),
        rows=np.sqrt(own),
        differing=pairing.differing,
    )


class _Stream:
    """The matching rays of a map, portion by portion, in order of their numbers."""

    def __init__(
        self, side: Side, criterion: object, by: str, threads: int | None, cancel: Cancel
    ) -> None:
        map, keys = side.map, side.keys
        [node] = bind_all(map, [criterion])
        order = np.lexsort((keys.high, keys.low))
        low = keys.low[order]
        factors = source_factors(map.directory, map.emitted)
        seeds = seeds_by_portion(map)

        def visit(found: Found) -> _Block:
            portion = found.portion
            rays = np.flatnonzero(found.masks[0])
            paths = found.paths.of_ray[rays]
            # Of equal low halves of different paths there is one in 2^64 pairs
            mine = path_keys(found.paths.base, by).low[paths]
            index = np.minimum(np.searchsorted(low, mine), max(len(low) - 1, 0))
            source = found.paths.base.source[paths].astype(np.int64)
            weight = ray_weights(portion, rays)
            flux = factors[source] if weight is None else factors[source] * weight
            numbers = portion.column("emission") if portion.grouped else portion.ray_ids()
            return _Block(
                seed=seeds[found.index],
                first_ray=int(portion.first_ray),
                end=int(numbers[-1]),
                emission=numbers[rays],
                row=side.row[order[index]].astype(np.int64),
                source=source,
                flux=flux,
            )

        self.scan = Scan(map, [node], visit=visit, threads=threads, cancel=cancel)
        self._blocks: Iterator[Any] = self.scan.visits(everything=False)
        self.open, self.reached, self.ended = True, -1, False

    def take(self) -> _Block | None:
        """The next portion with matching rays; None when there is none."""
        for visit in self._blocks:
            block: _Block | None = visit.product
            if block is not None:
                self.reached = block.first_ray
                return block
        self.open, self.ended = False, True
        return None


@dataclass(eq=False)
class _Waiting:
    """Rays of one seed whose emissions the other map has not come to yet."""

    blocks: tuple[list[_Block], list[_Block]] = field(default_factory=lambda: ([], []))
    reached: list[int] = field(default_factory=lambda: [-1, -1])


class _Pairing:
    """Sums over emissions of the differences, and of their squares."""

    def __init__(self, n_rows: int, n_sources: int) -> None:
        self.row_sum, self.row_square = np.zeros(n_rows), np.zeros(n_rows)
        self.source_sum, self.source_square = np.zeros(n_sources), np.zeros(n_sources)
        self.differing = 0
        self._seeds: dict[int | None, _Waiting] = {}

    def add(self, side: int, block: _Block | None, ended: list[bool]) -> None:
        """Take in a portion, and add up the emissions that both maps are past."""
        if block is None:
            return
        waiting = self._seeds.setdefault(block.seed, _Waiting())
        waiting.blocks[side].append(block)
        waiting.reached[side] = block.end
        other = waiting.reached[1 - side]
        self._sum(waiting, block.end if ended[1 - side] else min(block.end, other))

    def close(self) -> None:
        """Add up what is left."""
        for waiting in self._seeds.values():
            self._sum(waiting, max(waiting.reached))

    def _sum(self, waiting: _Waiting, horizon: int) -> None:
        ready: list[list[_Block]] = [[], []]
        for side, blocks in enumerate(waiting.blocks):
            parts = [block.parts(horizon) for block in blocks]
            ready[side] = [now for now, _ in parts if now is not None]
            blocks[:] = [later for _, later in parts if later is not None]
        both = [*ready[0], *ready[1]]
        if not both:
            return
        emission, row, source, flux = (
            np.concatenate([getattr(block, name) for block in both])
            for name in ("emission", "row", "source", "flux")
        )
        n_first = sum(len(block.flux) for block in ready[0])
        # Differences of each emission in each row
        order = np.lexsort((row, emission))
        same = (emission[order][1:] == emission[order][:-1]) & (row[order][1:] == row[order][:-1])
        numbers, firsts = _numbered(order, same)
        by_row = _difference(numbers, flux, n_first, len(firsts))
        self.row_sum += sums(row[firsts], by_row, len(self.row_sum))
        self.row_square += sums(row[firsts], by_row**2, len(self.row_sum))
        # Differences of each emission
        same = emission[order][1:] == emission[order][:-1]
        numbers, firsts = _numbered(order, same)
        whole = _difference(numbers, flux, n_first, len(firsts))
        self.source_sum += sums(source[firsts], whole, len(self.source_sum))
        self.source_square += sums(source[firsts], whole**2, len(self.source_sum))
        self.differing += int(np.count_nonzero(by_row))


def _numbered(order: Ints, same: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Group of each ray, and a ray of each group; ``same``: as the one before, in order."""
    fresh = np.concatenate(([True], ~same))
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(fresh) - 1
    return numbers, order[fresh]


def _difference(numbers: Ints, flux: Floats, n_first: int, size: int) -> Floats:
    """Second map less first, by group; sums of equal rays are equal to the last bit."""
    first = sums(numbers[:n_first], flux[:n_first], size)
    return sums(numbers[n_first:], flux[n_first:], size) - first
