"""Where the light of a plane comes to a focus: spot size along the plane's axis.

Light that registers is followed along its straight lines, before and behind the plane, as if
nothing stood there. The squared rms radius about the centroid is then a parabola of the distance s,

    R²(s) = A + 2 C s + V s²,

A being the variance of places in the plane, V that of slopes and C their covariance, so that the
best focus lies at s = - C / V.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.peaks import registrations
from query.answers.selections.selector import bind_all
from query.engine.light import light_at, records_at
from query.engine.places import seen_by
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.expression.names import unknown
from raymap.model.doubt import with_doubts
from raymap.model.errors import RayMapError
from raymap.model.rows import squares_by_emission

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["SHARES", "Focus", "FocusRow", "focus"]

Floats = NDArray[np.float64]

SHARES = (0.5, 0.8, 0.95)
"""Of the flux, whose radii are told."""
_STEPS = 21
_MOST_RAYS = 40_000_000
"""Rays whose lines are kept: 2 GB."""


@dataclass(frozen=True, kw_only=True)
class FocusRow:
    """Spot at one distance.

    Attributes
    ----------
    distance : along the axis u x v of the plane [length unit]
    rms, rms_se : rms radius about the centroid
    radius, radius_se : by share of the flux, radius about the centroid that holds it
    centroid : along u and v of the plane
    """

    distance: float
    rms: float
    rms_se: float
    radius: dict[str, float]
    radius_se: dict[str, float]
    centroid: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """Plain values, doubtful ones marked."""
        row = {**self.__dict__, "centroid": list(self.centroid)}
        return with_doubts(row)


@dataclass(frozen=True, kw_only=True)
class Focus:
    """Spots along the axis of a plane.

    Attributes
    ----------
    rays : registrations that were followed
    best : the spot of least rms radius; None where the light is parallel
    best_se : standard error of its distance
    rows : spots at the distances that were asked for
    """

    detector: str
    length_unit: str
    rays: int
    best: FocusRow | None
    best_se: float
    rows: tuple[FocusRow, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        best = None
        if self.best is not None:
            best = {**self.best.to_json(), "distance_error": self.best_se}
        return {
            "detector": self.detector,
            "length_unit": self.length_unit,
            "registrations": self.rays,
            "best": best,
            "rows": [row.to_json() for row in self.rows],
        }


class _Lines(NamedTuple):
    """Lines of light through a plane.

    Attributes
    ----------
    place, slope : (n, 2) along u and v, and per length along the axis
    flux : (n,) [flux unit]
    emission : (n,) equal for light of one emission
    """

    place: Floats
    slope: Floats
    flux: Floats
    emission: NDArray[np.int64]


@asked_again
def focus(
    map: RayMap,
    detector: str,
    criterion: object = None,
    *,
    distances: Sequence[float] | None = None,
    threads: int | None = None,
    cancel: Cancel = None,
) -> Focus:
    """Spot size along the axis of a plane, and the best focus.

    Parameters
    ----------
    detector : a plane of the map, or the description of one (`query.with_detectors`)
    criterion : which rays
    distances : from the plane along u x v, where it looks [length unit]; by default 21 about the
        best focus, as far as the rms radius is threefold

    Raises
    ------
    UnknownName, CriterionError, RayMapError
        It is no plane, or no ray registers.
    """
    map = seen_by(map, detector)
    names = [entry.name for entry in map.directory.detectors]
    if detector not in names:
        raise unknown("detector", detector, names)
    index = names.index(detector)
    if map.directory.detectors[index].kind != "plane":
        raise RayMapError(f"{detector!r} is no plane, so that it has no axis to look for a focus")
    lines = _lines(map, index, criterion, threads, cancel)
    if not len(lines.flux) or not lines.flux.sum() > 0.0:
        raise RayMapError(f"no light of the criterion registers at {detector!r}")
    best, best_se, spread = _best(lines)
    if distances is None:
        least = 0.0 if best is None else _spot(lines, best, ()).rms
        reach = 8.0**0.5 * least / spread if spread > 0.0 else 0.0
        middle = 0.0 if best is None else best
        distances = np.linspace(middle - reach, middle + reach, _STEPS).tolist() if reach else [0.0]
    for distance in distances:
        if not abs(distance) < 1e15:
            raise RayMapError(f"a distance is a number, not {distance!r}")
    return Focus(
        detector=detector,
        length_unit=map.directory.length_unit,
        rays=len(lines.flux),
        best=None if best is None else _spot(lines, best, SHARES),
        best_se=best_se,
        rows=tuple(_spot(lines, float(distance), SHARES) for distance in distances),
    )


def _lines(
    map: RayMap, index: int, criterion: object, threads: int | None, cancel: Cancel
) -> _Lines:
    entry = map.directory.detectors[index]
    u, v = np.asarray(entry.axis_u, np.float64), np.asarray(entry.axis_v, np.float64)
    n = np.cross(u, v)
    center = np.asarray(entry.center, np.float64)
    emitted = map.emitted
    parts: list[_Lines] = []

    def visit(found: Found) -> _Lines:
        rays, descriptors = registrations(found, 0, index)
        portion = found.portion
        records = records_at(portion, descriptors)
        position = portion.column("position")
        start = position[records].astype(np.float64) - center
        way = position[records + 1].astype(np.float64) - center - start
        along = way @ n
        slope = np.stack((way @ u, way @ v), axis=1) / along[:, None]
        place = np.stack((start @ u, start @ v), axis=1) - (start @ n)[:, None] * slope
        light = map.photometry(portion.channel_set)
        source = portion.column("source")[rays]
        amounts = light_at(portion, light, rays, records, whole=criterion is not None)
        flux = light.radiant_factors(emitted)[source] * light.flux_by_channel(amounts).sum(axis=1)
        own = portion.column("emission")[rays] if portion.grouped else rays
        # In a portion of its own
        emission = own.astype(np.int64) + (np.int64(found.index) << 40)
        sound = np.isfinite(slope).all(axis=1)
        return _Lines(place[sound], slope[sound], flux[sound], emission[sound])

    def take(_: int, product: _Lines) -> None:
        parts.append(product)
        if sum(len(part.flux) for part in parts) > _MOST_RAYS:
            raise RayMapError(
                f"more than {_MOST_RAYS:,} rays register there; choose some of them by a criterion"
            )

    Scan(
        map, bind_all(map, [criterion]), visit=visit, take=take, threads=threads, cancel=cancel
    ).run()
    if not parts:
        return _Lines(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64))
    return _Lines(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _spread(lines: _Lines, values: Floats) -> float:
    """Standard error of Σ values, which add up to 0, by emission."""
    zeros = np.zeros(len(values), np.int64)
    squares = squares_by_emission(zeros, values, lines.emission, 1)
    return float(np.sqrt(squares[0]))


def _best(lines: _Lines) -> tuple[float | None, float, float]:
    """Best focus, its standard error, and the rms of the slopes."""
    share = lines.flux / lines.flux.sum()
    place, slope = (each - share @ each for each in (lines.place, lines.slope))
    variance = float(share @ (slope**2).sum(axis=1))
    if not variance > 1e-24:
        return None, 0.0, 0.0
    products = (place * slope).sum(axis=1)
    best = -float(share @ products) / variance
    values = share * (products + best * (slope**2).sum(axis=1)) / variance
    return best, _spread(lines, values), variance**0.5


def _spot(lines: _Lines, distance: float, shares: Sequence[float]) -> FocusRow:
    share = lines.flux / lines.flux.sum()
    place = lines.place + distance * lines.slope
    centroid = share @ place
    squares = ((place - centroid) ** 2).sum(axis=1)
    rms = float(share @ squares) ** 0.5
    error = _spread(lines, share * (squares - rms**2)) / (2.0 * rms) if rms > 0.0 else 0.0
    radius: dict[str, float] = {}
    radius_se: dict[str, float] = {}
    if shares:
        order = np.argsort(squares)
        r, held = np.sqrt(squares[order]), np.cumsum(share[order])
        for wanted in shares:
            at = float(r[min(int(np.searchsorted(held, wanted)), len(r) - 1)])
            # The share inside a fixed radius is known so well; its radius follows from the slope
            inside = squares <= at**2
            off = _spread(lines, share * (inside - wanted))
            low, high = (
                float(r[min(int(np.searchsorted(held, min(1.0, max(0.0, q)))), len(r) - 1)])
                for q in (wanted - off, wanted + off)
            )
            name = f"{wanted:g}"
            radius[name], radius_se[name] = at, 0.5 * (high - low)
    return FocusRow(
        distance=distance,
        rms=rms,
        rms_se=error,
        radius=radius,
        radius_se=radius_se,
        centroid=(float(centroid[0]), float(centroid[1])),
    )
