"""What changes do to the light of a criterion: before, after, and the difference with its error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.tables import path_table
from query.answers.selections.selector import bind_all
from query.answers.what_if.changes import changes_of
from query.answers.what_if.scenes import changes_of_scene
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import Estimate, Tally, estimate, source_factors
from raymap.model.doubt import with_doubts
from raymap.model.errors import RayMapError
from raymap.model.rows import squares_by_emission
from raymap.optics.photometry import path_sums, ray_weights
from raymap.passes.branches import BRANCHES
from raymap.passes.revised import RevisedMap, RevisedPortion

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["FEWEST", "Effect", "Opened", "changed_paths", "effect", "what_if"]

Floats = NDArray[np.float64]

_MOST = 1000
"""Strongest paths of either map that are compared."""
FEWEST = 100
"""Effective rays below which an answer is marked as weak."""


def what_if(
    map: RayMap, changes: Mapping[str, Any] | None = None, *, scene: str | Path | None = None
) -> RevisedMap:
    """A view of a map as it would be under changes, which every question takes in its place.

    Parameters
    ----------
    map : an open map of rays; it stays open and unchanged, and must stay open
    changes : values by keys as ``"L5.back.reflectance"``: of faces, objects and surfaces
        ``reflectance``, ``transmittance``, ``coating``, ``metal``, ``black``, ``lambertian``,
        ``scatter``; of media ``absorption``, ``scattering`` [1 / length unit]; of sources ``flux``
        [flux unit], ``on``, ``spectrum`` (shares by channel, the flux is kept)
    scene : a scene file of the same geometry from which the changes are taken, instead

    Raises
    ------
    UnknownName, RayMapError
        There is no such name; changes that bend light elsewhere; a map that does not say its laws.
    """
    map.need_rays()
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
    rays : that satisfy the criterion
    effective : rays of equal weight that would say as much: (Σ w)² / Σ w²
    opened : what the changes open that was never drawn, so that it is missing in ``after``
    impossible : events that the recorded laws do not allow, which rounding put there
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
        }
        return with_doubts(told)


@asked_again
def effect(
    map: RayMap,
    view: RevisedMap,
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
    [node] = bind_all(map, [criterion])
    n_sources = len(map.directory.sources)
    sums = np.zeros((6, n_sources))

    def visit(found: Found) -> Floats:
        portion = view.portions[found.index]
        assert isinstance(portion, RevisedPortion)
        rays = np.flatnonzero(found.masks[0])
        weights = []
        for each in (portion.own, portion):
            weight = ray_weights(each, rays)
            weights.append(np.ones(len(rays)) if weight is None else weight)
        portion.forget()
        source = portion.column("source")[rays].astype(np.int64)
        emission = portion.column("emission")[rays] if portion.grouped else None
        own, new = weights
        squares = [
            squares_by_emission(source, each, emission, n_sources) for each in (own, new, own + new)
        ]
        return np.stack(
            [
                np.bincount(source, minlength=n_sources).astype(np.float64),
                np.bincount(source, own, n_sources),
                squares[0],
                np.bincount(source, new, n_sources),
                squares[1],
                0.5 * (squares[2] - squares[0] - squares[1]),
            ]
        )

    def take(_: int, product: Floats) -> None:
        nonlocal sums
        sums = sums + product

    scan = Scan(map, [node], visit=visit, take=take, threads=threads, cancel=cancel)
    known = _of_paths(scan, view)
    if known is not None:
        return _effect(map, view, known, map.emitted)
    scan.run()
    emitted = scan.emitted if scan.complete else map.emitted
    return _effect(map, view, sums, emitted)


def _of_paths(scan: Scan, view: RevisedMap) -> Floats | None:
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
    columns = (base.paths.rays[chosen], w, w2, f * w, f**2 * w2, f * w2)
    return np.stack([np.bincount(source, column, n) for column in columns])


def _effect(map: RayMap, view: RevisedMap, sums: Floats, emitted: NDArray[np.int64]) -> Effect:
    counts = sums[0].astype(np.int64)
    before = estimate(Tally(counts, sums[1], sums[2]), map.directory, emitted)
    after = estimate(Tally(counts, sums[3], sums[4]), view.directory, emitted)
    own, new = (source_factors(each.directory, emitted) for each in (map, view))
    # Light of the same emission before and after: x = new - own, variance Σ x² - (Σ x)² / N
    x = new * sums[3] - own * sums[1]
    x2 = new**2 * sums[4] - 2.0 * new * own * sums[5] + own**2 * sums[2]
    sent = np.maximum(np.asarray(emitted, np.float64), 1.0)
    variance = float(np.maximum(0.0, x2 - x**2 / sent).sum())
    lit = float((new * sums[3]).sum())
    spread = float((new**2 * sums[4]).sum())
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
        rays=int(counts.sum()),
        effective=lit**2 / spread if spread > 0.0 else 0.0,
        opened=opened,
        impossible=view.impossible,
    )


def changed_paths(
    map: RayMap,
    view: RevisedMap,
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
    tables = [
        {row.path: row for row in path_table(each, criterion, threads=threads).rows(_MOST)}
        for each in (map, view)
    ]
    rows = []
    for path in dict.fromkeys((*tables[0], *tables[1])):
        before, after = (table.get(path) for table in tables)
        if path == "remainder" or before is None or after is None:
            continue
        rows.append(
            with_doubts(
                {
                    "path": path,
                    "criterion": after.criterion,
                    "rays": after.rays,
                    "flux_before": before.flux,
                    "flux_before_se": before.flux_se,
                    "flux": after.flux,
                    "flux_se": after.flux_se,
                    "difference": after.flux - before.flux,
                }
            )
        )
    rows.sort(key=lambda row: -abs(row["difference"]))
    return rows[:top]
