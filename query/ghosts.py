"""The ghost matrix: flux by pair of reflecting faces, of two-reflection ghosts."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query import criteria as c
from query.builders import as_criterion, count, detected, event, hit
from query.context import PathContext
from query.path_sums import sum_over_paths
from query.scan import Cancel
from query.scans import count_of_ray
from query.tally import Tally, source_factors, sums, variances
from raymap.events import Event

if TYPE_CHECKING:
    from raymap.reader import RayMap

__all__ = ["GhostMatrix", "ghost_matrix"]

Floats = NDArray[np.float64]

_GHOST = (count(hit("*", "specular_reflection")) == 2) & ~event("scattered")


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
        for place in order.tolist():
            first, second = divmod(place, len(self.faces))
            if self.rays[first, second]:
                found.append(
                    {
                        "first": self.faces[first],
                        "second": self.faces[second],
                        "rays": int(self.rays[first, second]),
                        "flux": float(self.flux[first, second]),
                        "flux_se": float(self.flux_se[first, second]),
                        "share": float(self.flux[first, second] / self.total),
                        "criterion": self.criterion(first, second),
                        "labels": [self.labels[first], self.labels[second]],
                    }
                )
        return found

    def criterion(self, first: int, second: int) -> str:
        """Selects the ghosts of one pair."""
        from query.names import escape as literal
        from query.printer import quoted

        def name(place: int) -> str:
            owner, dot, face = self.faces[place].rpartition(".")
            return quoted(literal(owner) + dot + literal(face) if dot else literal(face))

        order = f"hit({name(first)}, specular_reflection) -> hit({name(second)}, "
        return f"{order}specular_reflection) & {_GHOST}"

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
            + "".join(f"<td>{value:.3g}</td>" if value else "<td></td>" for value in row)
            + "</tr>"
            for name, row in zip(self.labels, self.flux, strict=True)
        )
        return f"<table><tr><th>first \\ second</th>{head}</tr>{body}</table>"


def ghost_matrix(
    map: RayMap,
    detector: str | None = None,
    criterion: object = None,
    *,
    threads: int | None = None,
    cancel: Cancel = None,
) -> GhostMatrix:
    """Flux of two-reflection ghosts by the pair of faces that reflect.

    A ghost has exactly two specular reflections and is scattered nowhere.

    Parameters
    ----------
    detector : only ghosts that it registers; a detector's name or pattern
    criterion : only rays that satisfy this, too
    """
    parts: list[c.Criterion] = [_GHOST]
    if detector is not None:
        parts.append(detected(detector))
    own = as_criterion(criterion)
    if own is not None:
        parts.append(own)
    whole = parts[0] if len(parts) == 1 else c.And(tuple(parts))
    n_faces = len(map.directory.faces.names)
    n_places = n_faces + len(map.directory.objects)
    products, _, scan = sum_over_paths(
        map,
        whole,
        lambda base, tally: _reflecting(base, tally, n_faces, n_places),
        threads=threads,
        cancel=cancel,
    )
    codes = np.concatenate([code for code, _ in products]) if products else np.zeros(0, np.int64)
    different, inverse = np.unique(codes, return_inverse=True)
    tallies = [Tally.zeros(0), *(tally for _, tally in products)]
    tally = Tally.of_paths(
        inverse,
        np.concatenate([t.rays for t in tallies]),
        np.concatenate([t.sum_w for t in tallies]),
        np.concatenate([t.sum_w2 for t in tallies]),
        len(different),
    )
    return _matrix(map, different, tally, scan.emitted, n_places)


def _reflecting(
    base: PathContext, tally: Tally, n_faces: int, n_places: int
) -> tuple[NDArray[np.int64], Tally]:
    """Code of (source, first face, second face) of every path with rays, and its sums."""
    mirror = (base.event & int(Event.SPECULAR_REFLECTION)) != 0
    mirror &= base.object >= 0
    mirror[base.offsets[:-1]] = False
    twice = (count_of_ray(mirror, base.offsets) == 2) & (tally.rays > 0)
    rows = np.flatnonzero(mirror & np.repeat(twice, base.lengths)).reshape(-1, 2)
    place = np.where(base.face[rows] >= 0, base.face[rows], n_faces + base.object[rows])
    chosen = np.flatnonzero(twice)
    source = base.source[chosen].astype(np.int64)
    code = (source * n_places + place[:, 0]) * n_places + place[:, 1]
    return code, Tally(tally.rays[chosen], tally.sum_w[chosen], tally.sum_w2[chosen])


def _matrix(
    map: RayMap,
    codes: NDArray[np.int64],
    tally: Tally,
    emitted: NDArray[np.int64],
    n_places: int,
) -> GhostMatrix:
    directory = map.directory
    names = (*directory.faces.names, *(item.name for item in directory.objects))
    source, pair = codes // n_places**2, codes % n_places**2
    first, second = pair // n_places, pair % n_places
    used, place = np.unique(np.concatenate((first, second)), return_inverse=True)
    n = len(used)
    cell = place[: len(codes)] * n + place[len(codes) :]
    factors = source_factors(directory, emitted)[source]
    sent = emitted[source].astype(np.float64)
    spread = variances(factors, sent, tally.sum_w, tally.sum_w2)
    flux: Floats = sums(cell, factors * tally.sum_w, n * n).reshape(n, n)
    shared = {
        f"{item.name}.{face.name}": " = ".join((f"{item.name}.{face.name}", *face.aliases))
        for item in directory.objects
        for face in item.faces
    }
    return GhostMatrix(
        faces=tuple(names[face] for face in used),
        labels=tuple(shared.get(names[face], names[face]) for face in used),
        flux=flux,
        flux_se=np.sqrt(sums(cell, spread, n * n)).reshape(n, n),
        rays=np.bincount(cell, tally.rays, n * n).astype(np.int64).reshape(n, n),
        total=float(flux.sum()),
        flux_unit=directory.flux_unit,
    )
