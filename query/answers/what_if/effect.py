"""What changes do to the light of a criterion: before, after, and the difference with its error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.tables import path_table
from query.answers.selections.selector import bind_all
from query.answers.what_if.changes import changes_of
from query.answers.what_if.scenes import changes_of_scene
from query.answers.what_if.stops import parse_stops
from query.engine.scan import Cancel, Scan
from query.engine.search import Found, search_portion
from query.engine.second_try import asked_again
from query.engine.tally import Estimate, Tally, estimate, source_factors
from raymap.file.views import MapView
from raymap.model.doubt import with_doubts
from raymap.model.errors import RayMapError
from raymap.model.rows import squares_by_emission
from raymap.optics.photometry import path_sums, ray_weights
from raymap.passes.branches import BRANCHES
from raymap.passes.placed import PlacedMap
from raymap.passes.revised import RevisedMap, RevisedPortion
from raymap.passes.stopped import StoppedMap

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["FEWEST", "Effect", "Opened", "changed_paths", "effect", "what_if"]

Floats = NDArray[np.float64]

_MOST = 1000
"""Strongest paths of either map that are compared."""
FEWEST = 100
"""Effective rays below which an answer is marked as weak."""


def what_if(
    map: RayMap,
    changes: Mapping[str, Any] | None = None,
    *,
    scene: str | Path | None = None,
    stops: Sequence[str] = (),
) -> MapView:
    """A view of a map as it would be under changes, which every question takes in its place.

    Parameters
    ----------
    map : an open map of rays; it stays open and unchanged, and must stay open
    changes : values by keys as ``"L5.back.reflectance"``: of faces, objects and surfaces
        ``reflectance``, ``transmittance``, ``coating``, ``metal``, ``black``, ``lambertian``,
        ``scatter``; of media ``absorption``, ``scattering`` [1 / length unit]; of sources ``flux``
        [flux unit], ``on``, ``spectrum`` (shares by channel, the flux is kept)
    scene : a scene file of the same geometry from which the changes are taken, instead
    stops : ideal absorbers that end light: ``"ring(z=30, inner=12, outer=32)"`` with ``x``, ``y``
        or ``z``, or ``center`` and ``axis``; ``"rectangle(z=30, size=[20, 10])"``;
        ``"mesh(file='baffle.stl', scale=1, position=[0, 0, 0])"``; ``name`` is how criteria call it

    Raises
    ------
    UnknownName, RayMapError
        There is no such name; changes that bend light elsewhere; a map that does not say its laws.
    """
    map.need_rays()
    if stops:
        map = _with_stops(map, stops)
        if not changes and scene is None:
            assert isinstance(map, MapView)
            return map
    return _revised(map, changes, scene)


def _with_stops(map: RayMap, stops: Sequence[str]) -> MapView:
    """A view whose rays end at stops; what other views make of rays, they make of what is left."""
    if isinstance(map, RevisedMap | PlacedMap):
        return map.over(_with_stops(map.base, stops))
    return StoppedMap(map, parse_stops(stops, map.directory))


def _revised(map: RayMap, changes: Mapping[str, Any] | None, scene: str | Path | None) -> MapView:
    if isinstance(map, PlacedMap):
        return map.over(_revised(map.base, changes, scene))
    names = {name for portion in map.portions[:1] for name in portion.column_names}
    if (changes is None) == (scene is None):
        raise RayMapError("say what is changed: changes, or a scene that has them")
    resolved = changes_of_scene(map, scene) if scene is not None else changes_of(map, changes or {})
    if "stokes" in names and (resolved.faces or resolved.media):
        raise RayMapError(
            f"{map.path} is of polarised light, whose states would change with its surfaces: that "
            "is not built; sources can be changed"
        )
    for number, source in resolved.sources.items():
        if source.flux > 0.0 and not map.emitted[number]:
            raise RayMapError(
                f"source {source.name!r} emitted no rays when the map was recorded, so that none "
                "shows where its light would go: record it with all sources on"
            )
    if len(map.shards) != 1:
        raise RayMapError(
            "a folder of maps cannot be changed as one yet: join it first (raymap query -o)"
        )
    if isinstance(map, RevisedMap):
        recorded = map.base
        return map.with_further(
            lambda number, known: resolved.laws(recorded, number, known), resolved.sources
        )
    return RevisedMap(map, lambda number: resolved.laws(map, number), resolved.sources)


@dataclass(frozen=True)
class Opened:
    """A way that light never took when it was recorded, and a bound of what would take it."""

    face: str
    branch: str
    flux: float


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Light of a criterion before and after changes.

    Attributes
    ----------
    before, after : flux [flux unit of the map]
    difference, difference_se : after - before; its error is smaller than theirs, as both are of
        the same rays
    ratio : after / before, None where nothing was there
    rays : that satisfy the criterion, before or after, whichever are more
    effective : rays of equal weight that would say as much: (Σ w)² / Σ w²
    opened : what the changes open that was never drawn, so that it is missing in ``after``
    impossible : events that the recorded laws do not allow, which rounding put there
    vague : scatterings into a lobe so narrow that the stored direction does not tell its density;
        they count as before
    """

    before: Estimate
    after: Estimate
    difference: float
    difference_se: float
    ratio: float | None
    rays: int
    effective: float
    opened: tuple[Opened, ...]
    impossible: int
    vague: int = 0

    @property
    def weak(self) -> bool:
        """Whether so few rays carry the answer that its error cannot be trusted."""
        return bool(self.after.flux > 0.0 and self.effective < FEWEST)

    def to_json(self) -> dict[str, Any]:
        """Plain values, doubtful ones marked."""
        told = {
            "flux_before": self.before.flux,
            "flux_before_se": self.before.se,
            "flux": self.after.flux,
            "flux_se": self.after.se,
            "difference": self.difference,
            "difference_se": self.difference_se,
            "ratio": self.ratio,
            "rays": self.rays,
            "effective_rays": self.effective,
            "weak": self.weak,
            "opened": [dict(entry.__dict__) for entry in self.opened],
            "impossible_events": self.impossible,
            "vague_events": self.vague,
        }
        return with_doubts(told)


@asked_again
def effect(
    map: RayMap,
    view: MapView,
    criterion: object = None,
    *,
    threads: int | None = None,
    cancel: Cancel = None,
) -> Effect:
    """Compare the light that satisfies a criterion in a map and in a view of it (`what_if`).

    Raises
    ------
    UnknownName, CriterionError, RayMapError
    """
    view.threads = threads or 0
    before = _as_it_was(map, view)
    scan = Scan(before, bind_all(before, [criterion]), threads=threads, cancel=cancel)
    if before is map:
        known = _of_paths(scan, view)
        if known is not None:
            return _effect(map, view, known, map.emitted)
    n_sources = len(map.directory.sources)
    sums = np.zeros((7, n_sources))

    def visit(found: Found) -> Floats:
        if before is map:
            portions = found.portion, view.portions[found.index]
            return _sums_of(portions, (found.masks[0], found.masks[0]), n_sources)
        own = search_portion(
            found.index, before.portions[found.index], scan.verdicts, scan.local(found.index),
            before.channel_sets, found.check,
        )  # fmt: skip
        masks = own.masks[0], found.masks[0]
        return _sums_of((own.portion, found.portion), masks, n_sources)

    def take(_: int, product: Floats) -> None:
        nonlocal sums
        sums = sums + product

    # Where rays end elsewhere those that now do what is asked may not have done so, and vice versa
    asked, wanted = (map, [criterion]) if before is map else (view, [criterion, None])
    after = Scan(
        asked, bind_all(asked, wanted), visit=visit, take=take, threads=threads, cancel=cancel
    )
    after.run()
    emitted = after.emitted if after.complete else map.emitted
    return _effect(map, view, sums, emitted)


def _as_it_was(map: RayMap, view: MapView) -> RayMap:
    """The map, knowing the names of what a view adds to it, where rays of the view end there."""
    looked: Any = view
    while isinstance(looked, MapView) and looked is not map:
        if isinstance(looked, StoppedMap):
            return looked.unstopped()
        looked = looked.base
    return map


_FEW = 0.5
"""Share of the rays of a portion below which they are weighed without all others."""


def _sums_of(portions: tuple[Any, Any], masks: tuple[Any, Any], n_sources: int) -> Floats:
    """Of a portion, by source: rays before and after, Σ w and Σ w² of both, Σ w w'.

    Parameters
    ----------
    portions, masks : before and after; the masks are (n_rays,) of the rays that do what is asked
    """
    rays = np.flatnonzero(masks[0] | masks[1])
    portion = portions[1]
    weights = []
    for each, mask in zip(portions, masks, strict=True):
        if isinstance(each, RevisedPortion) and len(rays) < _FEW * each.n_rays:
            weight: Any = each.worth_of(rays)
        else:
            weight = ray_weights(each, rays)
        weights.append(np.where(mask[rays], 1.0 if weight is None else weight, 0.0))
    if hasattr(portion, "forget"):
        portion.forget()
    source = portion.column("source")[rays].astype(np.int64)
    emission = portion.column("emission")[rays] if portion.grouped else None
    own, new = weights
    squares = [
        squares_by_emission(source, each, emission, n_sources) for each in (own, new, own + new)
    ]
    counts = [np.bincount(source[mask[rays]], minlength=n_sources) for mask in masks]
    return np.stack(
        [
            counts[0].astype(np.float64),
            np.bincount(source, own, n_sources),
            squares[0],
            counts[1].astype(np.float64),
            np.bincount(source, new, n_sources),
            squares[1],
            0.5 * (squares[2] - squares[0] - squares[1]),
        ]
    )


def _of_paths(scan: Scan, view: MapView) -> Floats | None:
    """The sums of `effect` from the dictionary alone; None where rays must be looked at.

    That needs a criterion that paths decide, and rays that change as their paths do.
    """
    base = scan.verdicts.base
    if base is None or scan.grouped or not scan.verdicts.pairs[0].exact or scan.map.damage:
        return None
    if any(scan.local(index) is None and p.n_rays for index, p in enumerate(scan.map.portions)):
        return None
    factors = view.path_factors()
    own, squares = path_sums(base.paths, scan.map.lights)
    if factors is None or squares is None:
        return None
    chosen = np.flatnonzero(scan.verdicts.pairs[0].certain)
    source, n = base.paths.source[chosen], scan.n_sources
    f, w, w2 = factors[chosen], own[chosen], squares[chosen]
    rays = base.paths.rays[chosen]
    columns = (rays, w, w2, rays, f * w, f**2 * w2, f * w2)
    return np.stack([np.bincount(source, column, n) for column in columns])


def _effect(map: RayMap, view: MapView, sums: Floats, emitted: NDArray[np.int64]) -> Effect:
    counts = sums[[0, 3]].astype(np.int64)
    before = estimate(Tally(counts[0], sums[1], sums[2]), map.directory, emitted)
    after = estimate(Tally(counts[1], sums[4], sums[5]), view.directory, emitted)
    own, new = (source_factors(each.directory, emitted) for each in (map, view))
    # Light of the same emission before and after: x = new - own, variance Σ x² - (Σ x)² / N
    x = new * sums[4] - own * sums[1]
    x2 = new**2 * sums[5] - 2.0 * new * own * sums[6] + own**2 * sums[2]
    sent = np.maximum(np.asarray(emitted, np.float64), 1.0)
    variance = float(np.maximum(0.0, x2 - x**2 / sent).sum())
    lit = float((new * sums[4]).sum())
    spread = float((new**2 * sums[5]).sum())
    opened = tuple(
        Opened(
            map.directory.faces.names[entry.face],
            BRANCHES[entry.branch],
            float((entry.by_source * new).sum()),
        )
        for entry in view.unseen()
    )
    return Effect(
        before=before,
        after=after,
        difference=after.flux - before.flux,
        difference_se=variance**0.5,
        ratio=after.flux / before.flux if before.flux > 0.0 else None,
        rays=int(counts.max(axis=0).sum()),
        effective=lit**2 / spread if spread > 0.0 else 0.0,
        opened=opened,
        impossible=view.impossible,
        vague=view.vague,
    )


def changed_paths(
    map: RayMap,
    view: MapView,
    criterion: object = None,
    top: int = 10,
    *,
    threads: int | None = None,
) -> list[dict[str, Any]]:
    """The paths whose flux changed most: JSON rows, largest difference first.

    Raises
    ------
    UnknownName, CriterionError, RayMapError
    """
    before = _as_it_was(map, view)
    found = [path_table(each, criterion, threads=threads) for each in (before, view)]
    tables = [{row.path: row for row in table.rows(_MOST)} for table in found]
    whole = [table.n_paths <= _MOST for table in found]
    rows = []
    for path in dict.fromkeys((*tables[0], *tables[1])):
        pair = [table.get(path) for table in tables]
        # A path that is in one table only is not known to be missing in the other, if that is long
        if path == "remainder" or any(
            row is None and not all_told for row, all_told in zip(pair, whole, strict=True)
        ):
            continue
        flux, se = ([0.0 if row is None else getattr(row, name) for row in pair] for name in (
            "flux", "flux_se"
        ))  # fmt: skip
        some = [row for row in pair if row is not None]
        rows.append(
            with_doubts(
                {
                    "path": path,
                    "criterion": some[-1].criterion,
                    "rays": some[-1].rays,
                    "flux_before": flux[0],
                    "flux_before_se": se[0],
                    "flux": flux[1],
                    "flux_se": se[1],
                    "difference": flux[1] - flux[0],
                }
            )
        )
    rows.sort(key=lambda row: -abs(row["difference"]))
    return rows[:top]
