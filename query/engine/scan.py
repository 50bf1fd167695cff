"""One pass of several criteria over a map: paths first, then the portions that stay open.

`Scan` evaluates the criteria on the merged dictionary, visits only the portions that the answer
still depends on (on a thread pool, results taken in order), and adds up rays and weights per source
and per label of their path. Results do not depend on the number of threads.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import MapFacts
from query.engine.bound import BoundNode, evaluate
from query.engine.context import Cancelled, PathContext
from query.engine.search import Found, PathVerdicts, search_portion
from query.engine.tally import Tally
from raymap.model.errors import DamagedPortion
from raymap.optics.photometry import path_sums, ray_weights

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Cancel", "Progress", "Scan", "Totals", "default_threads", "map_facts"]

Ints = NDArray[np.integer]
Floats = NDArray[np.float64]

Cancel = Callable[[], bool] | threading.Event | None


@dataclass(frozen=True)
class Progress:
    """How far a search has come."""

    portions_done: int
    portions: int
    matched: int
    bytes_read: int

    @property
    def fraction(self) -> float:
        return self.portions_done / self.portions if self.portions else 1.0


def default_threads() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0)) or 1
    return os.cpu_count() or 1


def map_facts(map: RayMap) -> MapFacts:
    """What binding needs to know of an open map."""
    return MapFacts(
        directory=map.directory,
        channel_sets=map.channel_sets,
        emitted=map.emitted,
        weighted=any(portion.has_weights for portion in map.portions),
        worth_by_color=any(
            map.photometry(number).changes for number in range(len(map.channel_sets))
        ),
        has_column=lambda name: any(_has_column(portion, name) for portion in map.portions),
    )


def _has_column(portion: Any, name: str) -> bool:
    try:
        return name in portion.column_names
    except DamagedPortion:
        # The scan itself says what is lost.
        return False


@dataclass(eq=False)
class Totals:
    """What one criterion found.

    Attributes
    ----------
    by_source : tally per source, of all rays
    by_label : tally per label of the merged paths, of the rays that take one
    """

    by_source: Tally
    by_label: Tally


@dataclass(frozen=True, eq=False)
class _Fresh:
    """What one portion adds to the totals of one criterion; None: no label gets more."""

    by_source: Tally
    by_label: Tally | None


@dataclass(frozen=True, eq=False)
class _Visit:
    """What a worker hands back for one portion."""

    index: int
    totals: Sequence[_Fresh]
    masks: Sequence[NDArray[np.uint8]] = ()
    product: Any = None
    damaged: bool = False


class Scan:
    """Evaluate criteria on a map in one pass.

    Parameters
    ----------
    map : an open ray map
    nodes : bound criteria
    rays : find the rays themselves and keep them as `masks`
    visit : called in worker threads for each portion that has matching rays (with ``plain_only``:
        that has no dictionary, too); what it returns goes to ``take`` in portion order
    labels : (n_merged_paths,) label of each merged path; without them only sources are told apart
    use_merged : False evaluates every portion by itself (the same answer, more slowly)
    """

    def __init__(
        self,
        map: RayMap,
        nodes: Sequence[BoundNode],
        *,
        rays: bool = False,
        visit: Callable[[Found], Any] | None = None,
        take: Callable[[int, Any], None] | None = None,
        plain_only: bool = False,
        labels: Ints | None = None,
        threads: int | None = None,
        progress: Callable[[Progress], None] | None = None,
        cancel: Cancel = None,
        use_merged: bool = True,
    ) -> None:
        map.need_rays()
        self.map, self.nodes = map, tuple(nodes)
        self.keep_masks = rays
        self.visitor, self.take, self.plain_only = visit, take, plain_only
        self.want_rays = rays or (visit is not None and not plain_only)
        self.progress = progress
        self.threads = threads or default_threads()
        self.is_cancelled = _cancel_function(cancel)
        self._bytes_before = map.bytes_read
        self.merged = map.merged if use_merged else None
        self.n_sources = len(map.directory.sources)
        self.labels = labels
        self.complete = True
        self.damaged: list[int] = []
        self.served: list[int] = []
        self.masks: dict[int, Sequence[NDArray[np.uint8]]] = {}

    # -- what the paths say --------------------------------------------------------------------

    @cached_property
    def verdicts(self) -> PathVerdicts:
        """Every criterion on the merged dictionary."""
        if self.merged is None:
            return PathVerdicts(self.nodes, None, ())
        base = PathContext(self.merged.paths)
        pairs = [evaluate(base, node) for node in self.nodes]
        # Columns that every worker needs are made once, here.
        if self.want_rays or not all(pair.exact for pair in pairs):
            _ = base.lengths, base.left, base.crossings_of_path
        return PathVerdicts(self.nodes, base, pairs)

    @cached_property
    def n_labels(self) -> int:
        return 0 if self.labels is None or not len(self.labels) else int(self.labels.max()) + 1

    @cached_property
    def grouped(self) -> bool:
        """Whether rays are summed one by one.

        Several may stem from one emission, or the squares of what they are worth are not stored.
        """
        if any(portion.grouped for portion in self.map.portions):
            return True
        return self.merged is not None and self._merged_sums[1] is None

    @cached_property
    def _merged_sums(self) -> tuple[Floats, Floats | None]:
        """Sums of the merged paths, whose flux they are with a source's flux per ray."""
        assert self.merged is not None
        return path_sums(self.merged.paths, self.map.lights)

    @cached_property
    def open_portions(self) -> list[int]:
        """Portions that the answer still depends on, in order of ray numbers."""
        pairs = self.verdicts.pairs
        whole = self.want_rays or self.grouped
        asked = np.zeros(0, np.bool_)
        if pairs:
            asked = np.logical_or.reduce(
                [p.possible if whole else p.possible & ~p.certain for p in pairs]
            )
        chosen = []
        some = bool(asked.any())
        for index, portion in enumerate(self.map.portions):
            local = self.local(index)
            if portion.n_rays and (local is None or (some and asked[local].any())):
                chosen.append(index)
        return sorted(chosen, key=lambda index: self.map.portions[index].first_ray)

    def local(self, index: int) -> Ints | None:
        """Row of each of a portion's paths among the merged ones; None if it stands alone."""
        if self.merged is None:
            return None
        rows: Ints | None = self.merged.local_to_global[index]
        return rows

    # -- the pass ------------------------------------------------------------------------------

    def run(self) -> list[Totals]:
        """Decide on paths, visit the portions that stay open, add everything up."""
        totals = [self._certain(number) for number in range(len(self.nodes))]
        for visit in self.visits(everything=self.grouped):
            for total, more in zip(totals, visit.totals, strict=True):
                total.by_source = total.by_source + more.by_source
                if more.by_label is not None:
                    total.by_label = total.by_label + more.by_label
            self.report(int(totals[0].by_source.rays.sum()))
        if (self.damaged or not self.complete) and self.verdicts.base and not self.grouped:
            self._recount(totals)
        return totals

    def visits(self, *, everything: bool) -> Iterator[_Visit]:
        """Sound results of the open portions in order, computed ahead by the threads.

        ``everything``: totals count all matching rays, not only those that paths leave open.
        """
        for visit in self._ordered(everything):
            if visit.damaged:
                self.damaged.append(visit.index)
                continue
            self.served.append(visit.index)
            if self.keep_masks:
                self.masks[visit.index] = visit.masks
            if self.take is not None and visit.product is not None:
                self.take(visit.index, visit.product)
            yield visit

    def _ordered(self, everything: bool) -> Iterator[_Visit]:
        wanted = self.open_portions
        if not wanted:
            return
        if self.threads == 1 or len(wanted) == 1:
            for index in wanted:
                try:
                    visit = self._visit(index, everything)
                except Cancelled:
                    self.complete = False
                    return
                yield visit
            return
        with ThreadPoolExecutor(self.threads, thread_name_prefix="query") as pool:
            waiting: deque[Future[_Visit]] = deque()
            try:
                for index in wanted:
                    waiting.append(pool.submit(self._visit, index, everything))
                    if len(waiting) >= 2 * self.threads:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            except Cancelled:
                self.complete = False
            finally:
                for future in waiting:
                    future.cancel()

    def check(self) -> None:
        """Raise `Cancelled` once the search is cancelled."""
        if self.is_cancelled():
            raise Cancelled

    def _visit(self, index: int, everything: bool) -> _Visit:
        """Search one portion; runs in a worker thread."""
        portion = self.map.portions[index]
        local = self.local(index)
        try:
            found = search_portion(
                index, portion, self.verdicts, local, self.map.channel_sets, self.check
            )
            totals = [
                self._fresh(found, number, everything or local is None)
                for number in range(len(self.nodes))
            ]
            product = None
            wanted = local is None or not self.plain_only
            if self.visitor is not None and wanted and any(mask.any() for mask in found.masks):
                product = self.visitor(found)
        except DamagedPortion:
            if self.map.on_damage == "raise":
                raise
            return _Visit(index, (), damaged=True)
        packed = [np.packbits(mask) for mask in found.masks] if self.keep_masks else ()
        return _Visit(index, totals, packed, product)

    def _fresh(self, found: Found, number: int, everything: bool) -> _Fresh:
        """Tallies of the rays of one criterion that the merged paths have not counted."""
        mask, certain = found.masks[number], found.certain[number]
        if not everything:
            if mask is certain:
                return _Fresh(Tally.zeros(self.n_sources), None)
            mask = mask & ~certain
        rays = np.flatnonzero(mask)
        if not len(rays):
            return _Fresh(Tally.zeros(self.n_sources), None)
        portion, paths = found.portion, found.paths.of_ray[rays]
        weight = ray_weights(portion, rays)
        emission = portion.column("emission")[rays] if portion.grouped else None
        source = found.paths.base.source[paths]
        by_source = Tally.of_rays(source, weight, emission, self.n_sources)
        if not found.paths.is_merged or self.labels is None:
            return _Fresh(by_source, None)
        by_label = Tally.of_rays(self.labels[paths], weight, emission, self.n_labels)
        return _Fresh(by_source, by_label)

    # -- sums ----------------------------------------------------------------------------------

    def _nothing(self) -> Totals:
        return Totals(Tally.zeros(self.n_sources), Tally.zeros(self.n_labels))

    def _certain(self, number: int) -> Totals:
        """Totals of the merged paths that match for certain."""
        base = self.verdicts.base
        if base is None or self.grouped:
            return self._nothing()
        chosen = np.flatnonzero(self.verdicts.pairs[number].certain)
        return self._of_paths(base, chosen, self.labels)

    def _of_paths(self, base: PathContext, chosen: Ints, labels: Ints | None) -> Totals:
        paths = base.paths
        whole = self.merged is not None and paths is self.merged.paths
        sum_w, sum_w2 = self._merged_sums if whole else path_sums(paths, self.map.lights)
        assert sum_w2 is not None
        sums = paths.rays[chosen], sum_w[chosen], sum_w2[chosen]
        return Totals(
            Tally.of_paths(paths.source[chosen], *sums, self.n_sources),
            Tally.zeros(0)
            if labels is None
            else Tally.of_paths(labels[chosen], *sums, self.n_labels),
        )

    def _recount(self, totals: list[Totals]) -> None:
        """Count certain paths of the served portions only: merged counts hold the lost, too."""
        for number, total in enumerate(totals):
            whole = self._certain(number)
            total.by_source = total.by_source - whole.by_source
            total.by_label = total.by_label - whole.by_label
        for index in self.portions_served:
            local = self.local(index)
            if local is None:
                continue
            try:
                portion = self.map.portions[index]
                own = PathContext(portion.paths())
                known = path_sums(own.paths, self.map.lights)[1] is not None
            except DamagedPortion:
                self.damaged.append(index)
                continue
            if not known:
                raise portion.map.drop_merged(f"squares of lumens that portion {index} lacks")
            for number, total in enumerate(totals):
                chosen = np.flatnonzero(self.verdicts.pairs[number].certain[local])
                labels = None if self.labels is None else self.labels[local]
                more = self._of_paths(own, chosen, labels)
                total.by_source = total.by_source + more.by_source
                total.by_label = total.by_label + more.by_label

    @property
    def portions_served(self) -> list[int]:
        """Portions that the answer speaks for: not damaged, and searched or not in need of it."""
        lost = set(self.damaged)
        if not self.complete:
            lost |= set(self.open_portions) - set(self.served)
        return [index for index in range(len(self.map.portions)) if index not in lost]

    @property
    def emitted(self) -> NDArray[np.int64]:
        """(n_sources,) rays emitted in the portions that the answer speaks for."""
        total = np.zeros(self.n_sources, np.int64)
        for index in self.portions_served:
            total += self.map.portions[index].emitted
        return total

    @property
    def bytes_read(self) -> int:
        return int(self.map.bytes_read - self._bytes_before)

    def rays_of(self, index: int, number: int) -> Ints:
        """Indices of the rays of a portion that satisfy criterion ``number``."""
        n_rays = self.map.portions[index].n_rays
        return np.flatnonzero(np.unpackbits(self.masks[index][number], count=n_rays))

    def report(self, matched: int) -> None:
        """Tell how far the search has come."""
        if self.progress is not None:
            done = len(self.served) + len(self.damaged)
            self.progress(Progress(done, len(self.open_portions), matched, self.bytes_read))


def _cancel_function(cancel: Cancel) -> Callable[[], bool]:
    if cancel is None:
        return lambda: False
    return cancel.is_set if isinstance(cancel, threading.Event) else cancel
