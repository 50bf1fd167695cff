"""The path table: which paths carry how much of a selection's flux."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.path_keys import Keys, Part, group, path_keys
from query.answers.paths.peaks import find_peaks
from query.answers.selections.selector import bind_all
from query.answers.selections.sharded import (
    ShardPaths,
    ShardTask,
    opened_shard,
    paths_of_shards,
    worth_spreading,
)
from query.engine.context import PathContext
from query.engine.path_text import PathNames, exact_criterion, path_text
from query.engine.scan import Cancel, Progress, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import Tally, source_factors
from raymap.file.agreement import FalseFooter
from raymap.model.doubt import FOOTNOTE, is_doubtful, marked, with_doubts
from raymap.model.errors import RayMapError
from raymap.optics.fluxes import variances
from raymap.optics.photometry import ray_weights

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["PathRow", "PathTable", "path_table"]

Ints = NDArray[np.integer]
Floats = NDArray[np.float64]

SORTS = ("flux", "rays", "peak")
_COMPACT_ROWS = 2_000_000
_SHOWN = 20


@dataclass(frozen=True)
class PathRow:
    """One path of a selection.

    Attributes
    ----------
    path : its itinerary
    criterion : selects exactly the rays that take it; None for the remainder
    flux, flux_se : [flux unit of the map]
    share : of the selection's flux
    reflections : points with a reflection of any kind
    first_object, last_object : names, None without
    peak : (u, v) of the brightest cell of the detector picture of this path, where asked for
    peak_flux : flux in that cell
    """

    path: str
    criterion: str | None
    rays: int
    flux: float
    flux_se: float
    share: float
    source: str | None = None
    reflections: int | None = None
    first_object: str | None = None
    last_object: str | None = None
    peak: tuple[int, int] | None = None
    peak_flux: float | None = None

    def to_json(self) -> dict[str, Any]:
        out = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if self.peak_flux is None:
            del out["peak"], out["peak_flux"]
        return with_doubts(out)


class PathTable:
    """Paths of a selection, strongest first; text is made when rows are asked for.

    Attributes
    ----------
    n_paths : different paths of the selection
    rays, flux, flux_se : (n_paths,)
    total : flux of the selection [flux unit of the map]
    by : "face" or "object"
    complete : False if the search was cancelled
    """

    def __init__(
        self,
        map: RayMap,
        part: Part,
        order: Ints,
        emitted: Ints,
        by_source: Tally,
        by: str,
        complete: bool,
        peaks: dict[str, NDArray[Any]] | None,
    ) -> None:
        self.map, self.by, self.complete = map, by, complete
        self._part, self._order, self._peaks = part, order, peaks
        self._by_source, self._emitted = by_source, emitted
        factors = source_factors(map.directory, emitted)
        own = factors[part.keys.source]
        sent = emitted[part.keys.source].astype(np.float64)
        tally = part.tally
        self._flux = own * tally.sum_w
        self._se = np.sqrt(variances(own, sent, tally.sum_w, tally.sum_w2))
        self.total = float(factors @ by_source.sum_w)
        self._bases: dict[int, PathContext] = {}
        self._names = PathNames(map.directory)

    @property
    def n_paths(self) -> int:
        return len(self._order)

    def __len__(self) -> int:
        return self.n_paths

    @property
    def rays(self) -> NDArray[np.int64]:
        return self._part.tally.rays[self._order]

    @property
    def flux(self) -> Floats:
        return self._flux[self._order]

    @property
    def flux_se(self) -> Floats:
        return self._se[self._order]

    def rows(self, top: int | None = None) -> list[PathRow]:
        """The first ``top`` paths, and a remainder row, so that shares sum to 1."""
        chosen = self._order[:top]
        return [self._row(int(row)) for row in chosen] + [self._remainder(chosen)]

    def to_json(self, top: int | None = None) -> list[dict[str, Any]]:
        """What ``raymap paths --json`` prints."""
        return [row.to_json() for row in self.rows(top)]

    def filter(
        self,
        *,
        reflections: int | None = None,
        first: str | None = None,
        last: str | None = None,
        source: str | None = None,
        min_rays: int = 1,
        min_share: float = 0.0,
    ) -> PathTable:
        """The rows that fit; the others go to the remainder."""
        keys, directory = self._part.keys, self.map.directory
        keep = self._part.tally.rays[self._order] >= min_rays
        if min_share > 0 and self.total:
            keep &= self._flux[self._order] / self.total >= min_share
        if reflections is not None:
            keep &= keys.reflections[self._order] == reflections
        objects = [item.name for item in directory.objects]
        for name, column in ((first, keys.first), (last, keys.last)):
            if name is not None:
                keep &= column[self._order] == _index(name, objects, "object")
        if source is not None:
            sources = [item.name for item in directory.sources]
            keep &= keys.source[self._order] == _index(source, sources, "source")
        return PathTable(
            self.map,
            self._part,
            self._order[keep],
            self._emitted,
            self._by_source,
            self.by,
            self.complete,
            self._peaks,
        )

    def _base(self, index: int) -> PathContext:
        """Paths of a merged dictionary or of a portion."""
        if index not in self._bases:
            if len(self._bases) > 8:
                self._bases.clear()
            if index >= 0:
                paths = self.map.portions[index].paths()
            else:
                merged = (self.map if index == -1 else self.map.shards[-2 - index]).merged
                if merged is None:
                    raise FalseFooter(
                        f"{self.map.path}: the footer turned out to be false since this table was "
                        "made; ask for the paths again"
                    )
                paths = merged.paths
            self._bases[index] = PathContext(paths)
        return self._bases[index]

    def _row(self, row: int) -> PathRow:
        keys, tally = self._part.keys, self._part.tally
        place, where = (int(number) for number in self._part.places[row])
        text = path_text(self._base(place), where, self._names, self.by)
        directory = self.map.directory
        flux = float(self._flux[row])
        names = [item.name for item in directory.objects]
        first, last = int(keys.first[row]), int(keys.last[row])
        result = PathRow(
            path=text,
            criterion=exact_criterion(text),
            rays=int(tally.rays[row]),
            flux=flux,
            flux_se=float(self._se[row]),
            share=flux / self.total if self.total else 0.0,
            source=directory.sources[int(keys.source[row])].name,
            reflections=int(keys.reflections[row]),
            first_object=names[first] if first >= 0 else None,
            last_object=names[last] if last >= 0 else None,
        )
        if self._peaks is None:
            return result
        u, v = (int(number) for number in self._peaks["cell"][row])
        return replace(
            result,
            peak=(u, v) if u >= 0 else None,
            peak_flux=float(self._peaks["flux"][row]),
        )

    def _remainder(self, chosen: Ints) -> PathRow:
        """What the rows shown leave out."""
        sources = self._part.keys.source[chosen]
        shown, whole = self._part.tally, self._by_source
        n = len(whole.rays)
        rest = whole - Tally.of_paths(
            sources, shown.rays[chosen], shown.sum_w[chosen], shown.sum_w2[chosen], n
        )
        rays = int(rest.rays.sum())
        factors = source_factors(self.map.directory, self._emitted)
        # Differences of float sums: nothing left means exactly zero.
        flux = float(factors @ rest.sum_w) if rays else 0.0
        variance = variances(factors, self._emitted, rest.sum_w, rest.sum_w2).sum()
        return PathRow(
            path="remainder",
            criterion=None,
            rays=rays,
            flux=flux,
            flux_se=float(np.sqrt(variance)) if rays else 0.0,
            share=flux / self.total if self.total else 0.0,
        )

    def __repr__(self) -> str:
        unit = self.map.directory.flux_unit
        return f"<PathTable {self.n_paths} paths by {self.by}, {self.total:.6g} {unit}>"

    def __str__(self) -> str:
        """The strongest paths as a table of plain text."""
        unit = self.map.directory.flux_unit
        lines = [f"{'rays':>12} {f'flux [{unit}]':>12} {'±':>9} {'share':>9}  path by {self.by}"]
        rows = self.rows(_SHOWN)
        for row in rows:
            lines.append(
                f"{row.rays:>12,} {row.flux:>12.4g} {_marked_se(row):>9} {row.share:>9.3%}  "
                f"{row.path}"
            )
        return "\n".join([*lines, *_footnote(rows)])

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{name}</th>" for name in ("path", "rays", "flux", "±", "share"))
        rows = self.rows(_SHOWN)
        body = "".join(
            f"<tr><td>{escape(row.path)}</td><td>{row.rays:,}</td><td>{row.flux:.4g}</td>"
            f"<td>{_marked_se(row)}</td><td>{row.share:.3%}</td></tr>"
            for row in rows
        )
        note = "".join(f"<p>{escape(text)}</p>" for text in _footnote(rows))
        return f"<table><tr>{head}</tr>{body}</table>{note}"


def _marked_se(row: PathRow) -> str:
    return marked(f"{row.flux_se:.2g}", row.flux, row.flux_se)


def _footnote(rows: list[PathRow]) -> list[str]:
    return [FOOTNOTE] if any(is_doubtful(row.flux, row.flux_se) for row in rows) else []


def _index(name: str, names: list[str], kind: str) -> int:
    from query.expression.names import unknown

    if name not in names:
        raise unknown(kind, name, names)
    return names.index(name)


def path_table(
    map: RayMap,
    criterion: object = None,
    *,
    by: str = "face",
    sort: str = "flux",
    peak: str | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
    use_merged: bool = True,
    executor: Executor | None = None,
) -> PathTable:
    """Paths of a selection with rays, flux, standard error and share.

    A finished map answers path-level criteria from its merged dictionary alone.

    Parameters
    ----------
    criterion : text, tree or JSON; None: all rays
    by : "face" tells faces apart, "object" only objects
    sort : "flux", "rays" or "peak" (brightest cell of the path's picture on the detector ``peak``)
    peak : detector whose brightest cell each row tells; reads the descriptors of all rays
    executor : groups the paths of shards on its workers, as for `select`; peaks are found here

    Raises
    ------
    CriterionError, UnknownName, RayMapError
    """
    if by not in ("face", "object"):
        raise RayMapError(f'path tables are by "face" or "object", not {by!r}')
    if sort not in SORTS:
        raise RayMapError(f"path tables are sorted by {', '.join(SORTS)}, not {sort!r}")
    detector = _peak_detector(map, peak, sort)
    [node] = bind_all(map, [criterion])
    if executor is not None and worth_spreading(map, executor):
        parts, by_source, emitted, complete = paths_of_shards(
            map, criterion, by, executor, progress=progress, cancel=cancel, group=_group
        )
        part = _joined(parts) if parts else _empty()
    else:
        part, by_source, emitted, complete, _ = collect_paths(
            map, criterion, by, threads=threads, progress=progress, cancel=cancel,
            use_merged=use_merged,
        )  # fmt: skip
    peaks = None
    if detector is not None:
        peaks = find_peaks(map, node, part.keys, by, detector, emitted, threads, cancel)
    order = _ordered(map, part, emitted, sort, peaks)
    return PathTable(map, part, order, emitted, by_source, by, complete, peaks)


@asked_again
def collect_paths(
    map: RayMap,
    criterion: object,
    by: str,
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
    use_merged: bool = True,
) -> tuple[Part, Tally, NDArray[np.int64], bool, list[int]]:
    """Grouped paths of a selection, sums by source, rays emitted; whether it is all; damage.

    The last are the indices of damaged portions.
    """
    [node] = bind_all(map, [criterion])
    merged = map.merged if use_merged else None
    parts: list[Part] = []
    keys, representatives, labels = None, None, None
    if merged is not None:
        keys = path_keys(PathContext(merged.paths), by)
        representatives, labels = group(keys)

    def take(index: int, product: Part) -> None:
        parts.append(product)
        if sum(len(part.places) for part in parts) > _COMPACT_ROWS:
            parts[:] = [_joined(parts)]

    scan = Scan(
        map,
        [node],
        visit=lambda found: _grouped(found, by),
        take=take,
        plain_only=True,
        labels=labels,
        threads=threads,
        progress=progress,
        cancel=cancel,
        use_merged=use_merged,
    )
    [totals] = scan.run()
    if keys is not None and representatives is not None:
        places = np.stack([np.full(len(representatives), -1), representatives], axis=1)
        parts.append(Part(keys.take(representatives), totals.by_label, places))
    part = _joined(parts) if parts else _empty()
    return part, totals.by_source, scan.emitted, scan.complete, list(scan.damaged)


def _group(task: ShardTask) -> ShardPaths:
    """The grouped paths of one shard, on a worker."""
    with opened_shard(task) as shard:
        part, by_source, emitted, _, damaged = collect_paths(
            shard, task.criterion, task.by, threads=1
        )
        return ShardPaths(part, by_source, emitted, damaged, list(shard.damage))


def _peak_detector(map: RayMap, peak: str | None, sort: str) -> int | None:
    detectors = [detector.name for detector in map.directory.detectors]
    if peak is None and sort == "peak":
        if len(detectors) != 1:
            raise RayMapError(f"sorting by peak needs a detector; the map has: {detectors}")
        peak = detectors[0]
    return None if peak is None else _index(peak, detectors, "detector")


def _empty() -> Part:
    none = np.zeros(0, np.int64)
    keys = Keys(none.astype(np.uint64), none.astype(np.uint64), none, none, none, none)  # type: ignore[arg-type]
    return Part(keys, Tally.zeros(0), np.zeros((0, 2), np.int64))


def _grouped(found: Found, by: str) -> Part:
    """Paths of one portion that stands alone; runs in a worker thread."""
    keys = path_keys(found.paths.base, by)
    representatives, groups = group(keys)
    rays = np.flatnonzero(found.masks[0])
    labels = groups[found.paths.of_ray[rays]]
    portion = found.portion
    weight = ray_weights(portion, rays)
    emission = portion.column("emission")[rays] if portion.grouped else None
    tally = Tally.of_rays(labels, weight, emission, len(representatives))
    some = np.flatnonzero(tally.rays)
    places = np.stack([np.full(len(some), found.index), representatives[some]], axis=1)
    kept = Tally(tally.rays[some], tally.sum_w[some], tally.sum_w2[some])
    return Part(keys.take(representatives[some]), kept, places)


def _joined(parts: list[Part]) -> Part:
    """Parts with equal paths added up."""
    keys = Keys.join([part.keys for part in parts])
    tallies = [part.tally for part in parts]
    representatives, groups = group(keys)
    tally = Tally.of_paths(
        groups,
        np.concatenate([tally.rays for tally in tallies]),
        np.concatenate([tally.sum_w for tally in tallies]),
        np.concatenate([tally.sum_w2 for tally in tallies]),
        len(representatives),
    )
    places = np.concatenate([part.places for part in parts])[representatives]
    return Part(keys.take(representatives), tally, places)


def _ordered(
    map: RayMap, part: Part, emitted: Ints, sort: str, peaks: dict[str, NDArray[Any]] | None
) -> Ints:
    """Rows with rays, strongest first; ties are broken by the key, so that order is stable."""
    tally, keys = part.tally, part.keys
    flux = source_factors(map.directory, emitted)[keys.source] * tally.sum_w
    first: NDArray[Any] = flux if sort == "flux" else tally.rays
    if sort == "peak" and peaks is not None:
        first = peaks["flux"]
    order = np.lexsort((keys.high, keys.low, -tally.rays, -flux, -first))
    return order[tally.rays[order] > 0]
