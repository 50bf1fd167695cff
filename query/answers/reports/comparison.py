"""Two maps path by path: what changed, and whether the difference is more than noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from query.answers.paths.tables import PathRow, PathTable, path_table
from query.answers.reports.emissions import Relation, emissions_of, relation
from query.answers.reports.paired import PairedErrors, Side, paired_errors
from query.engine.scan import Cancel
from query.engine.second_try import asked_again
from query.engine.tally import estimate, source_factors
from raymap.file.resume import scene_difference
from raymap.model.doubt import marked, with_doubts
from raymap.model.errors import RayMapError, SceneMismatch

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["ComparedPath", "Comparison", "compare"]


@dataclass(frozen=True)
class ComparedPath:
    """One path, or all light, in both maps.

    Attributes
    ----------
    path, criterion : as in path tables
    flux_a, flux_b, se_a, se_b : [flux unit]; a map without the path has flux 0
    difference : flux_b - flux_a; se : its standard error
    z : difference in standard errors; infinite where a difference has no error
    significant : with 95 % confidence over all paths compared together (Bonferroni)
    """

    path: str
    criterion: str | None
    rays_a: int
    rays_b: int
    flux_a: float
    flux_b: float
    se_a: float
    se_b: float
    difference: float
    se: float
    z: float
    significant: bool

    def to_json(self) -> dict[str, Any]:
        """JSON has no infinity: such a z is null."""
        pairs = {"flux_a": self.se_a, "flux_b": self.se_b, "difference": self.se}
        doubts = with_doubts(self.__dict__ | {f"{name}_se": se for name, se in pairs.items()})
        z = self.z if math.isfinite(self.z) else None
        return self.__dict__ | {"z": z, "doubtful": doubts["doubtful"]}


@dataclass(frozen=True)
class Comparison:
    """Paths of two maps side by side, the most significant difference first.

    Attributes
    ----------
    maps : the paths of both files; flux_unit : of both
    total : all light of the selection
    ratio, ratio_se : total of the second map by that of the first; None without light in the first
    relation : how the emissions of the maps stand to each other, on which all errors depend
    scene_difference : where the scenes differ first, None if they are one
    bound_95 : where the scenes differ, but no emission does, the difference of the totals is below
        this with 95 % confidence [flux unit]; else None
    threshold : of z for significance
    """

    maps: tuple[str, str]
    flux_unit: str
    paths: tuple[ComparedPath, ...]
    total: ComparedPath
    ratio: float | None
    ratio_se: float | None
    relation: Relation
    scene_difference: str | None
    bound_95: float | None
    threshold: float

    @property
    def significant(self) -> list[ComparedPath]:
        return [path for path in self.paths if path.significant]

    def to_json(self, top: int | None = None) -> dict[str, Any]:
        ratio = {"ratio": self.ratio, "ratio_se": self.ratio_se, "bound_95": self.bound_95}
        return {
            "maps": list(self.maps),
            "flux_unit": self.flux_unit,
            "scene_difference": self.scene_difference,
            "relation": self.relation.kind,
            "errors": self.relation.sentence,
            "total": self.total.to_json() | ratio,
            "threshold": self.threshold,
            "n_paths": len(self.paths),
            "significant": len(self.significant),
            "paths": [path.to_json() for path in self.paths[:top]],
        }

    def head(self) -> str:
        """What is said before the paths: scenes, totals, ratio, and where errors come from."""
        total, unit = self.total, self.flux_unit
        width = max(len(name) for name in self.maps)
        lines = []
        if self.scene_difference:
            lines.append(f"the scenes differ: {self.scene_difference}")
        sides = zip(self.maps, (total.flux_a, total.flux_b), (total.se_a, total.se_b), strict=True)
        for name, flux, se in sides:
            said = marked(f"{flux:.6g} ± {se:.2g} {unit}", flux, se)
            lines.append(f"{name:<{width}}  {said}")
        ratio = ""
        if self.ratio is not None and self.ratio_se is not None:
            ratio = f"ratio {self.ratio:.6g} ± {self.ratio_se:.2g}"
            ratio = f"{marked(ratio, self.ratio, self.ratio_se)}, "
        difference = f"difference {total.difference:.6g} ± {total.se:.2g} {unit}"
        lines.append(f"{ratio}{marked(difference, total.difference, total.se)}")
        if self.bound_95 is not None:
            lines.append(
                "no emission differs: the totals differ by less than "
                f"{self.bound_95:.3g} {unit} with 95 % confidence"
            )
        lines.append(self.relation.sentence)
        return "\n".join(lines)


def compare(
    first: Any,
    second: Any,
    criterion: object = None,
    *,
    by: str = "face",
    different_scenes: bool = False,
    threads: int | None = None,
    cancel: Cancel = None,
) -> Comparison:
    """Compare the flux of every path in two maps, matched by name.

    Maps of the same emissions (seed, ray numbers, rays of each source) are differenced emission by
    emission; independent ones have errors that add in quadrature. Of other maps errors are added: a
    difference cannot be less sure than that. There a path that one map has never seen gets the
    standard error of a single ray, so that one ray alone is never significant.

    Parameters
    ----------
    criterion : must fit both maps
    different_scenes : compare maps of different scenes, too

    Raises
    ------
    CriterionError, UnknownName, NoRays
    SceneMismatch
        of different flux units; of different scenes, unless ``different_scenes``.
    """
    scenes = _difference_of_scenes(first, second, different_scenes)
    tables = [
        path_table(map, criterion, by=by, threads=threads, cancel=cancel) for map in (first, second)
    ]
    sides = [table.rows()[:-1] for table in tables]
    names = list(dict.fromkeys(row.path for rows in sides for row in rows))
    related = _relation(tables)
    paired = None
    if related.kind == "paired":
        paired = _paired(tables, sides, names, criterion, by, threads, cancel)
        if paired is None:
            raise RayMapError("the comparison was cancelled")
    threshold = NormalDist().inv_cdf(1 - 0.025 / max(len(names), 1))
    single = [_single_ray(table) for table in tables]
    found = [{row.path: row for row in rows} for rows in sides]
    paths = []
    for number, name in enumerate(names):
        rows = [side.get(name) for side in found]
        [known, *_] = [row for row in rows if row is not None]
        a, b = (
            (row.rays, row.flux, row.flux_se) if row else (0, 0.0, single[side])
            for side, row in enumerate(rows)
        )
        se = _joint(related, a[2], b[2]) if paired is None else float(paired.rows[number])
        paths.append(_compared(name, known.criterion, a, b, se, threshold))
    paths.sort(key=lambda path: -abs(path.z))
    a, b = ((int(t._by_source.rays.sum()), t.total, _total_se(t)) for t in tables)
    se = _joint(related, a[2], b[2]) if paired is None else paired.total
    bound = None
    if paired is not None and scenes is not None and not paired.differing:
        bound = 3.0 * max(single)
    return Comparison(
        maps=(str(first.path), str(second.path)),
        flux_unit=first.directory.flux_unit,
        paths=tuple(paths),
        total=_compared("total", None, a, b, se, NormalDist().inv_cdf(0.975)),
        ratio=b[1] / a[1] if a[1] else None,
        ratio_se=_ratio_se(related, a, b, se) if a[1] else None,
        relation=related,
        scene_difference=scenes,
        bound_95=bound,
        threshold=threshold,
    )


Numbers = tuple[int, float, float]
"""Rays, flux and standard error of one path in one map."""


def _difference_of_scenes(first: RayMap, second: RayMap, allowed: bool) -> str | None:
    own, other = first.directory, second.directory
    if own.flux_unit != other.flux_unit:
        raise SceneMismatch(
            f"{first.path} counts flux in {own.flux_unit}, {second.path} in {other.flux_unit}: "
            "record both in one unit to compare them"
        )
    # In words of the second map: what is new or different there
    difference = scene_difference(other, own)
    if difference and not allowed:
        raise SceneMismatch(
            f"{second.path} was recorded from another scene than {first.path}: {difference}; "
            "--different-scenes (different_scenes=True) compares them all the same, paths by name"
        )
    return difference or None


def _relation(tables: list[PathTable]) -> Relation:
    """As the maps say; emissions that were lost to damage are no longer the same ones."""
    emissions = [emissions_of(table.map) for table in tables]
    related = relation(*emissions)
    served = [tuple(int(n) for n in table._emitted) for table in tables]
    if related.kind == "paired" and served != [side.emitted for side in emissions]:
        return Relation(
            "overlapping",
            "both maps hold the same emissions, but some are damaged: errors are added, which is "
            "the most that they can be",
        )
    return related


def _paired(
    tables: list[PathTable],
    sides: list[list[PathRow]],
    names: list[str],
    criterion: object,
    by: str,
    threads: int | None,
    cancel: Cancel,
) -> PairedErrors | None:
    number = {name: index for index, name in enumerate(names)}
    sources = np.zeros(len(names), np.int64)
    pair = []
    for table, rows in zip(tables, sides, strict=True):
        keys = table._part.keys.take(table._order)
        row = np.array([number[row.path] for row in rows], np.int64)
        sources[row] = keys.source
        pair.append(Side(table.map, keys, row))

    # Either map may turn out to have a false footer
    @asked_again
    def of_second(_: RayMap) -> PairedErrors | None:
        return paired_errors(pair, criterion, by, sources, threads=threads, cancel=cancel)

    @asked_again
    def of_first(_: RayMap) -> PairedErrors | None:
        return of_second(tables[1].map)

    return of_first(tables[0].map)


def _joint(related: Relation, a: float, b: float) -> float:
    """Error of a difference of what has the errors a and b."""
    return math.hypot(a, b) if related.kind == "independent" else a + b


def _ratio_se(related: Relation, a: Numbers, b: Numbers, se: float) -> float:
    """Error of b / a to first order; ``se`` is that of b - a."""
    ratio = b[1] / a[1]
    if related.kind == "paired":
        # Var(b - r a) with the covariance that Var(b - a) tells
        variance = ratio * se**2 + (1.0 - ratio) * (b[2] ** 2 - ratio * a[2] ** 2)
        return math.sqrt(max(variance, 0.0)) / a[1]
    return _joint(related, ratio * a[2], b[2]) / a[1]


def _compared(
    path: str, criterion: str | None, a: Numbers, b: Numbers, se: float, threshold: float
) -> ComparedPath:
    difference = b[1] - a[1]
    z = difference / se if se > 0 else math.copysign(math.inf, difference) if difference else 0.0
    return ComparedPath(
        path=path,
        criterion=criterion,
        rays_a=a[0],
        rays_b=b[0],
        flux_a=a[1],
        flux_b=b[1],
        se_a=a[2],
        se_b=b[2],
        difference=difference,
        se=se,
        z=z,
        significant=abs(z) > threshold,
    )


def _single_ray(table: PathTable) -> float:
    """Flux of one ray of weight 1, the largest of all sources."""
    return float(source_factors(table.map.directory, table._emitted).max(initial=0.0))


def _total_se(table: PathTable) -> float:
    return estimate(table._by_source, table.map.directory, table._emitted).se
