"""Ghosts: flux by the faces at which light was reflected where most of it would have passed."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.path_sums import LabelSums, PathLabels, sum_over_paths
from query.atoms.count import count
from query.atoms.detected import detected
from query.atoms.event import event
from query.atoms.hit import hit, parameter
from query.engine.context import PathContext
from query.engine.places import seen_by
from query.engine.scan import Cancel, Scan
from query.engine.tally import Tally, source_factors, sums
from query.expression.atom import Compare
from query.expression.criterion import And, Criterion
from query.expression.spellings import as_criterion
from raymap.model.doubt import FOOTNOTE, is_doubtful, marked, with_doubts
from raymap.model.errors import CriterionError
from raymap.model.events import Event
from raymap.optics.fluxes import variances

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = [
    "ghost_reflections",
    "GhostMatrix",
    "GhostTable",
    "ghost_matrix",
    "ghost_table",
    "matrix_of",
]

Floats = NDArray[np.float64]

ghost_reflections = count(hit("*", "specular_reflection") & ~hit(parameter("transmits") == 0))
"""Specular reflections where light may pass, too: a mirror, and total reflection, do not count."""


def _ghosts(reflections: int) -> Criterion:
    return And((Compare(ghost_reflections, "==", reflections), ~event("scattered")))


@dataclass(frozen=True, eq=False, kw_only=True)
class GhostTable:
    """Ghosts of a number of reflections by the faces that reflect, strongest first.

    Attributes
    ----------
    reflections : how many ghost reflections each ray has
    faces : (n, reflections) names of the faces (or objects without faces), in the light's order
    labels : the same as they are listed, a cemented face with both its names: "L4.back = L5.front"
    flux, flux_se, rays : (n,) [flux unit]
    total : flux of all these ghosts in the selection
    others : where the table is empty, the rays of the selection that are ghosts of other numbers
        of reflections, by that number
    """

    reflections: int
    faces: tuple[tuple[str, ...], ...]
    labels: tuple[tuple[str, ...], ...]
    flux: Floats
    flux_se: Floats
    rays: NDArray[np.int64]
    total: float
    flux_unit: str
    others: dict[int, int]

    def __len__(self) -> int:
        return len(self.faces)

    def rows(self, top: int | None = None) -> list[dict[str, Any]]:
        """Faces with their ghosts, strongest first."""
        return [
            with_doubts(
                {
                    "faces": list(self.faces[k]),
                    "rays": int(self.rays[k]),
                    "flux": float(self.flux[k]),
                    "flux_se": float(self.flux_se[k]),
                    "share": float(self.flux[k] / self.total),
                    "criterion": self.criterion(k),
                    "labels": list(self.labels[k]),
                }
            )
            for k in range(len(self.faces))[:top]
        ]

    def criterion(self, row: int) -> str:
        """Selects the ghosts of one row."""
        return _sequence(self.faces[row])

    def nothing(self) -> str:
        """The sentence for an empty table: what there is instead."""
        times = {1: "once", 2: "twice"}.get(self.reflections, f"{self.reflections} times")
        said = (
            f"no ghosts: no ray of the selection was reflected exactly {times} at faces that also "
            "let light pass, and scattered nowhere; mirrors and total reflection do not count"
        )
        others = ", ".join(f"{n} (rays: {rays:,})" for n, rays in sorted(self.others.items()))
        return said + (f"; other numbers of reflections: {others}" if others else "")

    def to_json(self) -> dict[str, Any]:
        return {
            "reflections": self.reflections,
            "rows": self.rows(),
            "total": self.total,
            "flux_unit": self.flux_unit,
            "others": {str(n): rays for n, rays in sorted(self.others.items())},
        }


def _sequence(faces: tuple[str, ...]) -> str:
    """The criterion of ghosts that these faces reflect in this order."""
    from query.expression.names import escape as literal
    from query.expression.words import quoted

    def name(face: str) -> str:
        owner, dot, own = face.rpartition(".")
        return quoted(literal(owner) + dot + literal(own) if dot else literal(own))

    order = " -> ".join(f"hit({name(face)}, specular_reflection)" for face in faces)
    return f"{order} & {_ghosts(len(faces))}"


@dataclass(frozen=True, eq=False)
class GhostMatrix:
    """Two-reflection ghosts by the faces that reflect.

    Attributes
    ----------
    faces : names of the faces (or objects without faces) that reflect in some ghost
    labels : the same as they are listed, a cemented face with both its names: "L4.back = L5.front"
    flux, flux_se, rays : (n, n); row: first reflection, column: second [flux unit]
    total : flux of all two-reflection ghosts of the selection
    """

    faces: tuple[str, ...]
    flux: Floats
    flux_se: Floats
    rays: NDArray[np.int64]
    total: float
    flux_unit: str
    labels: tuple[str, ...] = ()

    def pairs(self, top: int | None = None) -> list[dict[str, Any]]:
        """Pairs of faces, strongest first."""
        order = np.argsort(-self.flux, axis=None, kind="stable")[:top]
        found = []
        for index in order.tolist():
            first, second = divmod(index, len(self.faces))
            if self.rays[first, second]:
                pair = {
                    "first": self.faces[first],
                    "second": self.faces[second],
                    "rays": int(self.rays[first, second]),
                    "flux": float(self.flux[first, second]),
                    "flux_se": float(self.flux_se[first, second]),
                    "share": float(self.flux[first, second] / self.total),
                    "criterion": self.criterion(first, second),
                    "labels": [self.labels[first], self.labels[second]],
                }
                found.append(with_doubts(pair))
        return found

    def criterion(self, first: int, second: int) -> str:
        """Selects the ghosts of one pair."""
        return _sequence((self.faces[first], self.faces[second]))

    def to_json(self) -> dict[str, Any]:
        return {
            "faces": list(self.faces),
            "labels": list(self.labels),
            "flux": self.flux.tolist(),
            "flux_se": self.flux_se.tolist(),
            "rays": self.rays.tolist(),
            "total": self.total,
            "flux_unit": self.flux_unit,
        }

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(name)}</th>" for name in self.labels)
        body = "".join(
            f"<tr><th>{escape(name)}</th>"
            + "".join(
                f"<td>{marked(f'{flux:.3g}', flux, se) if flux else ''}</td>"
                for flux, se in zip(fluxes, errors, strict=True)
            )
            + "</tr>"
            for name, fluxes, errors in zip(self.labels, self.flux, self.flux_se, strict=True)
        )
        note = f"<p>{escape(FOOTNOTE)}</p>" if self.doubtful.any() else ""
        return f"<table><tr><th>first \\ second</th>{head}</tr>{body}</table>{note}"

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """(n, n) pairs whose flux is less sure than 30 %."""
        return np.vectorize(is_doubtful, otypes=[np.bool_])(self.flux, self.flux_se)  # type: ignore[no-any-return]


def ghost_matrix(
    map: RayMap,
    detector: str | None = None,
    criterion: object = None,
    *,
    threads: int | None = None,
    cancel: Cancel = None,
) -> GhostMatrix:
    """Flux of two-reflection ghosts by the pair of faces that reflect.

    Parameters
    ----------
    detector, criterion : as in `ghost_table`
    """
    return matrix_of(ghost_table(map, detector, criterion, threads=threads, cancel=cancel))


def matrix_of(table: GhostTable) -> GhostMatrix:
    """Pairs of faces as rows and columns."""
    labels = {
        face: label
        for faces, shown in zip(table.faces, table.labels, strict=True)
        for face, label in zip(faces, shown, strict=True)
    }
    names = sorted(labels)
    index = {face: k for k, face in enumerate(names)}
    n = len(names)
    flux, flux_se, rays = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n), np.int64)
    for k, (first, second) in enumerate(table.faces):
        cell = index[first], index[second]
        flux[cell], flux_se[cell], rays[cell] = table.flux[k], table.flux_se[k], table.rays[k]
    return GhostMatrix(
        faces=tuple(names),
        labels=tuple(labels[name] for name in names),
        flux=flux,
        flux_se=flux_se,
        rays=rays,
        total=table.total,
        flux_unit=table.flux_unit,
    )


def ghost_table(
    map: RayMap,
    detector: str | None = None,
    criterion: object = None,
    *,
    reflections: int = 2,
    threads: int | None = None,
    cancel: Cancel = None,
) -> GhostTable:
    """Flux of ghosts by the faces that reflect, in the light's order.

    A ghost of n reflections has exactly n specular reflections at faces that also let light pass,
    and is scattered nowhere. Reflections at mirrors, which always reflect, do not count.

    Parameters
    ----------
    detector : only ghosts that it registers; a detector's name or pattern
    criterion : only rays that satisfy this, too
    reflections : n, at least 1

    Raises
    ------
    CriterionError
        for a number of reflections below 1.
    """
    map.need_rays()
    map = map if detector is None else seen_by(map, detector)
    if reflections < 1:
        raise CriterionError(f"a ghost has 1 or more reflections, not {reflections}")
    asked: list[Criterion] = [] if detector is None else [detected(detector)]
    own = as_criterion(criterion)
    if own is not None:
        asked.append(own)

    def among(which: Criterion) -> tuple[list[LabelSums], Scan]:
        return sum_over_paths(
            map,
            And((which, *asked)) if asked else which,
            lambda base, rays: _reflecting(base, rays, counted, n_faces, reflections),
            threads=threads,
            cancel=cancel,
        )

    faces = map.directory.faces
    n_faces = len(faces)
    passing = np.array([*(surface.transmits for surface in map.directory.surfaces), True])
    counted = np.append(passing[faces.surface], True)
    products, scan = among(_ghosts(reflections))
    none = np.zeros((0, 1 + reflections), np.int64)
    chains = np.concatenate([none, *(product.about.chains for product in products)])
    others: dict[int, int] = {}
    if len(chains) == 0:
        for product in among((ghost_reflections >= 1) & ~event("scattered"))[0]:
            for number, rays in product.about.rays_by_reflections.items():
                others[number] = others.get(number, 0) + rays
    different, inverse = np.unique(chains, axis=0, return_inverse=True)
    tallies = [Tally.zeros(0), *(product.tally for product in products)]
    tally = Tally.of_paths(
        inverse.reshape(-1),
        np.concatenate([t.rays for t in tallies]),
        np.concatenate([t.sum_w for t in tallies]),
        np.concatenate([t.sum_w2 for t in tallies]),
        len(different),
    )
    return _table(map, different, tally, scan.emitted, others)


class _Ghosts(NamedTuple):
    """What reflects in some paths with rays: source and places, a row for each label."""

    chains: NDArray[np.int64]
    rays_by_reflections: dict[int, int]


def _reflecting(
    base: PathContext,
    rays: NDArray[np.int64],
    counted: NDArray[np.bool_],
    n_faces: int,
    reflections: int,
) -> PathLabels:
    """Paths with so many reflections by their source and reflecting places."""
    ghostly = (base.event & int(Event.SPECULAR_REFLECTION)) != 0
    ghostly &= (base.object >= 0) & counted[base.face]
    ghostly[base.offsets[:-1]] = False
    number = base.points.count(ghostly)
    rays_of = np.bincount(number, rays).astype(np.int64)
    found = {k: count for k, count in enumerate(rays_of.tolist()) if k and count}
    wanted = (number == reflections) & (rays > 0)
    rows = np.flatnonzero(ghostly & np.repeat(wanted, base.lengths)).reshape(-1, reflections)
    index = np.where(base.face[rows] >= 0, base.face[rows], n_faces + base.object[rows])
    chosen = np.flatnonzero(wanted)
    chains = np.column_stack((base.source[chosen].astype(np.int64), index))
    different, label = np.unique(chains, axis=0, return_inverse=True)
    return PathLabels(chosen, label.reshape(-1), len(different), _Ghosts(different, found))


def _table(
    map: RayMap,
    chains: NDArray[np.int64],
    tally: Tally,
    emitted: NDArray[np.int64],
    others: dict[int, int],
) -> GhostTable:
    directory = map.directory
    names = (*directory.faces.names, *directory.object_columns.names)
    source, sequence = chains[:, 0], chains[:, 1:]
    # The same faces lit by several sources are one row
    used, row = np.unique(sequence, axis=0, return_inverse=True)
    row, n = row.reshape(-1), len(used)
    factors = source_factors(directory, emitted)[source]
    sent = emitted[source].astype(np.float64)
    flux: Floats = sums(row, factors * tally.sum_w, n)
    spread = sums(row, variances(factors, sent, tally.sum_w, tally.sum_w2), n)
    rays = np.bincount(row, tally.rays, n).astype(np.int64)
    shared = {
        f"{item.name}.{face.name}": " = ".join((f"{item.name}.{face.name}", *face.aliases))
        for item in directory.objects
        for face in item.faces
    }
    order = np.argsort(-flux, kind="stable")
    faces = tuple(tuple(names[face] for face in used[k]) for k in order.tolist())
    return GhostTable(
        reflections=sequence.shape[1],
        faces=faces,
        labels=tuple(tuple(shared.get(face, face) for face in chain) for chain in faces),
        flux=flux[order],
        flux_se=np.sqrt(spread[order]),
        rays=rays[order],
        total=float(flux.sum()),
        flux_unit=directory.flux_unit,
        others=others,
    )
