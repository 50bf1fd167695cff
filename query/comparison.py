"""Two maps path by path: what changed, and whether the difference is more than noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from query.scan import Cancel
from query.tables import PathTable, path_table

__all__ = ["Comparison", "ComparedPath", "compare"]


@dataclass(frozen=True)
class ComparedPath:
    """One path in both maps.

    Attributes
    ----------
    path, criterion : as in path tables
    flux_a, flux_b, se_a, se_b : [flux unit]; a map without the path has flux 0
    difference : flux_b - flux_a; se : its standard error
    z : difference in standard errors
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
        return dict(self.__dict__)


@dataclass(frozen=True)
class Comparison:
    """Paths of two maps side by side, the most significant difference first."""

    paths: tuple[ComparedPath, ...]
    total: ComparedPath
    threshold: float

    @property
    def significant(self) -> list[ComparedPath]:
        return [path for path in self.paths if path.significant]

    def to_json(self, top: int | None = None) -> dict[str, Any]:
        return {
            "total": self.total.to_json(),
            "threshold": self.threshold,
            "n_paths": len(self.paths),
            "significant": len(self.significant),
            "paths": [path.to_json() for path in self.paths[:top]],
        }


def compare(
    first: Any,
    second: Any,
    criterion: object = None,
    *,
    by: str = "face",
    threads: int | None = None,
    cancel: Cancel = None,
) -> Comparison:
    """Compare the flux of every path in two maps; scenes may differ, paths are matched by name.

    The criterion must fit both maps. A path that one map has never seen gets the standard error of
    a single ray there, so that one ray alone is never significant.

    Raises
    ------
    CriterionError, UnknownName
    """
    tables = [
        path_table(map, criterion, by=by, threads=threads, cancel=cancel) for map in (first, second)
    ]
    rows = [{row.path: row for row in table.rows()[:-1]} for table in tables]
    names = list(dict.fromkeys([*rows[0], *rows[1]]))
    threshold = _normal_quantile(1 - 0.025 / max(len(names), 1))
    single = [_single_ray(table) for table in tables]
    paths = []
    for name in names:
        found = [side.get(name) for side in rows]
        known = found[0] or found[1]
        assert known is not None
        numbers = [
            (row.rays, row.flux, row.flux_se) if row else (0, 0.0, single[side])
            for side, row in enumerate(found)
        ]
        paths.append(_compared(name, known.criterion, numbers[0], numbers[1], threshold))
    paths.sort(key=lambda path: -abs(path.z))
    totals = [(int(t._by_source.rays.sum()), t.total, _total_se(t)) for t in tables]
    total = _compared("total", None, totals[0], totals[1], _normal_quantile(0.975))
    return Comparison(tuple(paths), total, threshold)


def _compared(
    path: str,
    criterion: str | None,
    a: tuple[int, float, float],
    b: tuple[int, float, float],
    threshold: float,
) -> ComparedPath:
    difference, se = b[1] - a[1], math.hypot(a[2], b[2])
    z = difference / se if se > 0 else 0.0
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
    from query.tally import source_factors

    return float(source_factors(table.map.directory, table._emitted).max(initial=0.0))


def _total_se(table: PathTable) -> float:
    from query.tally import estimate

    return estimate(table._by_source, table.map.directory, table._emitted).se


def _normal_quantile(p: float) -> float:
    from statistics import NormalDist

    return NormalDist().inv_cdf(p)
