"""Distributions: how the flux of some light is spread over a number of its rays.

The number is a quantity of criteria (``length``, ``time``, ``incidence(hit("L1"))``, ...), or a
place: ``x(hit("L1"))``, and of a detector ``u("sensor")``, ``v``, ``radius``, ``angle``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.peaks import registrations
from query.answers.selections.selector import bind_all
from query.atoms.incidence import Incidence, surface_points
from query.engine.bound import BoundCompare
from query.engine.light import light_at, records_at
from query.engine.path_text import PathNames, path_text
from query.engine.places import seen_by
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.expression.atom import Compare, Quantity
from query.expression.grammar import parse
from query.expression.names import unknown
from raymap.model.doubt import with_doubts
from raymap.model.errors import CriterionError, RayMapError
from raymap.model.rows import squares_by_emission
from raymap.model.schema import NORMAL_SCALE
from raymap.optics.fluxes import variances

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = [
    "QUANTILES",
    "Bin",
    "By",
    "Histogram",
    "Moments",
    "PathNumbers",
    "Series",
    "histogram",
    "path_numbers",
]

By = Literal["path", "source", "object", "wavelength"]
Floats = NDArray[np.float64]
Ints = NDArray[np.integer[Any]]

QUANTILES = (0.05, 0.5, 0.95)
"""Shares of the flux whose quantiles are told."""
_MOST = 20_000_000
"""Numbers that are kept: below 1 GB."""
_MOST_SERIES = 10
"""Strongest series; the others are told as one."""
_UNITS = {"wavelength": "nm", "angle": "deg", "time": "ps"}
_AT_DETECTOR = re.compile(r'\s*(u|v|radius|angle)\s*\(\s*"((?:[^"\\]|\\.)*)"\s*\)\s*')
_AT_POINT = re.compile(r"\s*([xyz])\s*\((.*)\)\s*", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Flux of the numbers from ``low`` to below ``high``; the last bin holds ``high``, too."""

    low: float
    high: float
    flux: float
    flux_se: float
    rays: int


@dataclass(frozen=True, kw_only=True)
class Series:
    """The distribution of some of the light.

    Attributes
    ----------
    name : of the path, source, object or channel; "all" of everything
    flux, flux_se : of its numbers [flux unit]; a ray counts as often as it has one
    count : numbers
    mean, mean_se, spread, spread_se : of the numbers, weighed by flux; spread is the standard
        deviation
    quantiles, quantiles_se : by share of the flux
    bins : in rising order
    """

    name: str
    flux: float
    flux_se: float
    count: int
    mean: float
    mean_se: float
    spread: float
    spread_se: float
    quantiles: dict[str, float]
    quantiles_se: dict[str, float]
    bins: tuple[Bin, ...]

    @property
    def cumulative(self) -> Floats:
        """(n_bins,) share of the flux up to the end of each bin."""
        flux = np.cumsum([each.flux for each in self.bins])
        total = max(self.flux, np.finfo(float).tiny)
        return np.asarray(flux / total)

    def to_json(self) -> dict[str, Any]:
        """Plain values, doubtful ones marked."""
        row = with_doubts({**self.__dict__, "bins": ()})
        bins = [
            with_doubts({**each.__dict__, "cumulative": float(share)})
            for each, share in zip(self.bins, self.cumulative, strict=True)
        ]
        return {**row, "bins": bins}


@dataclass(frozen=True, kw_only=True)
class Histogram:
    """Distributions of a number, one series or several.

    Attributes
    ----------
    quantity, unit : as asked, and what it is in
    undefined, reason : rays of the criterion without such a number, and why, where that is known
    by : what tells the series apart; None: there is one, of all light
    """

    quantity: str
    unit: str
    flux_unit: str
    undefined: int
    reason: str
    by: str | None
    series: tuple[Series, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {**self.__dict__, "series": [each.to_json() for each in self.series]}


class _Samples(NamedTuple):
    """Numbers of rays: (n,) each, ``flux`` by unit of the source's flux per ray times that."""

    value: Floats
    flux: Floats
    source: Ints
    emission: NDArray[np.int64]
    label: NDArray[np.int64]


@asked_again
def histogram(
    map: RayMap,
    quantity: str | Quantity,
    criterion: object = None,
    *,
    by: By | None = None,
    bins: int = 40,
    bounds: tuple[float, float] | None = None,
    log: bool = False,
    threads: int | None = None,
    cancel: Cancel = None,
) -> Histogram:
    """How the flux of a criterion is spread over a number of its rays.

    Parameters
    ----------
    quantity : ``"length"``, ``"time"``, ``"wavelength"``, ``"bounces"``, ``"flux"``, any other
        quantity of criteria, as ``'incidence(hit("L1"))'``; ``'x(hit("L1"))'``, y, z;
        ``'u("sensor")'``, v, radius, angle at a detector
    by : tell paths, sources, objects (where rays end) or channels apart
    bins : how many
    bounds : lowest and highest; by default of all numbers. What lies outside is in no bin, but in
        mean, spread and quantiles
    log : bins of equal ratios

    Raises
    ------
    UnknownName, CriterionError, RayMapError
    """
    read = _reader(map, quantity)
    map = read.map
    if bins < 1:
        raise RayMapError(f"a histogram has 1 bin or more, not {bins}")
    labels = _Labels(map, by)
    whole, undefined, emitted = _gathered(read, labels, criterion, threads, cancel)
    edges = _edges(whole.value, bins, bounds, log)
    factors = _factors(map, emitted)
    return Histogram(
        quantity=_shown(quantity),
        unit=read.unit,
        flux_unit=map.directory.flux_unit,
        undefined=undefined,
        reason=read.reason,
        by=by,
        series=tuple(_series(whole, labels, edges, factors, emitted)),
    )


class Moments(NamedTuple):
    """A number of the rays of a path, weighed by their flux.

    Attributes
    ----------
    mean, mean_se : and its standard error
    spread : standard deviation
    samples : how many numbers
    """

    mean: float
    mean_se: float
    spread: float
    samples: int


class PathNumbers(NamedTuple):
    """A number by path.

    Attributes
    ----------
    quantity, unit : as asked, and what it is in
    undefined, reason : rays of the criterion without such a number, and why, where that is known
    of : moments by the text of the path; of paths whose rays have such a number
    """

    quantity: str
    unit: str
    undefined: int
    reason: str
    of: dict[str, Moments]


@asked_again
def path_numbers(
    map: RayMap,
    quantity: str | Quantity,
    criterion: object = None,
    *,
    by: Literal["face", "object"] = "face",
    threads: int | None = None,
    cancel: Cancel = None,
) -> PathNumbers:
    """A number of the rays of each path, as a column for the path table.

    Parameters
    ----------
    quantity : as of `histogram`
    by : how the path table tells paths apart

    Raises
    ------
    UnknownName, CriterionError, RayMapError
    """
    read = _reader(map, quantity)
    if read.map is not map:
        raise RayMapError(
            f"{_shown(quantity)}: paths of the table do not know this place; ask "
            "raymap histogram --by path, or a view of the map (query.with_detectors)"
        )
    labels = _Labels(map, "path", by)
    whole, undefined, emitted = _gathered(read, labels, criterion, threads, cancel)
    names, n = list(labels.names), len(labels.names)
    flux = whole.flux * _factors(map, emitted)[whole.source] if n else whole.flux
    total = np.maximum(np.bincount(whole.label, flux, n), np.finfo(float).tiny)
    share = flux / total[whole.label]
    mean = np.bincount(whole.label, share * whole.value, n)
    off = whole.value - mean[whole.label]
    square = np.bincount(whole.label, share * off**2, n)
    error = np.sqrt(squares_by_emission(whole.label, share * off, whole.emission, n))
    count = np.bincount(whole.label, minlength=n)
    rows = zip(mean.tolist(), error.tolist(), np.sqrt(square).tolist(), count.tolist(), strict=True)
    return PathNumbers(
        quantity=_shown(quantity),
        unit=read.unit,
        undefined=undefined,
        reason=read.reason,
        of={name: Moments(*row) for name, row in zip(names, rows, strict=True) if row[3]},
    )


def _shown(quantity: str | Quantity) -> str:
    return (quantity if isinstance(quantity, str) else str(quantity)).strip()


def _gathered(
    read: _Reader, labels: _Labels, criterion: object, threads: int | None, cancel: Cancel
) -> tuple[_Samples, int, Ints]:
    """All numbers, how many rays have none, and the rays that count as emitted."""
    map = read.map
    parts: list[_Samples] = []
    undefined = 0

    def visit(found: Found) -> tuple[_Samples, int, list[str]]:
        return _samples(found, read, labels, criterion is not None)

    def take(_: int, product: tuple[_Samples, int, list[str]]) -> None:
        nonlocal undefined
        samples, missing, names = product
        undefined += missing
        parts.append(samples._replace(label=labels.global_of(names)[samples.label]))
        if sum(len(part.value) for part in parts) > _MOST:
            raise RayMapError(
                f"more than {_MOST:,} rays have such a number; choose some of them by a criterion"
            )

    scan = Scan(
        map, bind_all(map, [criterion]), visit=visit, take=take, threads=threads, cancel=cancel
    )
    scan.run()
    return _joined(parts), undefined, scan.emitted if scan.complete else map.emitted


# -- what is read -------------------------------------------------------------------------------


class _Reader(NamedTuple):
    """How numbers are read: places in the portion of rays, records of the light, numbers.

    Records are None where the light of the ray's end counts. ``by_channel``: the number is the
    wavelength of each channel of the light.
    """

    map: RayMap
    unit: str
    read: Callable[[Found, Ints], tuple[Ints, Ints | None, Floats]]
    by_channel: bool = False
    reason: str = ""


def _reader(map: RayMap, quantity: str | Quantity) -> _Reader:
    if isinstance(quantity, str):
        if found := _AT_DETECTOR.fullmatch(quantity):
            return _at_detector(map, found[1], found[2])
        if (found := _AT_POINT.fullmatch(quantity)) is not None:
            return _at_points(map, "xyz".index(found[1]), found[2])
        quantity = _parsed(quantity)
    if quantity.word == "wavelength":
        return _Reader(map, "nm", lambda _, rays: (rays, None, np.zeros(len(rays))), True)
    [node] = bind_all(map, [Compare(quantity, ">", 0.0)])
    assert isinstance(node, BoundCompare)
    reason = node.never(map)
    if reason is not None:
        raise RayMapError(reason.removeprefix(f"{node.text}: "))
    unit = _UNITS.get(quantity.dimension, "")
    if quantity.dimension == "length":
        unit = map.directory.length_unit
    if quantity.dimension == "flux":
        unit = map.directory.flux_unit

    def read(found: Found, rays: Ints) -> tuple[Ints, Ints | None, Floats]:
        context = found.context(None if len(rays) == found.portion.n_rays else rays)
        own, values = node.samples(context)
        return rays[own], None, np.asarray(values, np.float64)

    return _Reader(map, unit, read, reason=node.undefined(map))


def _parsed(text: str) -> Quantity:
    try:
        tree = parse(f"{text} > 0")
    except CriterionError as error:
        said = str(error).splitlines()[0].split(" (column")[0]
        raise CriterionError(
            f"{text!r} is no number of a ray ({said}); write length, time, wavelength, bounces, "
            'flux, incidence(hit("L1")), x(hit("L1")) or u("sensor")'
        ) from None
    if not isinstance(tree, Compare):
        raise CriterionError(f"{text!r} is no number of a ray: write one quantity, as length")
    return tree.quantity


def _at_points(map: RayMap, axis: int, point: str) -> _Reader:
    quantity = _parsed(f"incidence({point})")
    assert isinstance(quantity, Incidence)
    [node] = bind_all(map, [Compare(quantity, ">", 0.0)])
    where = node.children[0]

    def read(found: Found, rays: Ints) -> tuple[Ints, Ints | None, Floats]:
        context = found.context(None if len(rays) == found.portion.n_rays else rays)
        own, step, _ = surface_points(context, where)
        records = context.starts[own] + step
        # The light that arrives is that of the segment before
        return rays[own], records - 1, context.position[records, axis].astype(np.float64)

    return _Reader(map, map.directory.length_unit, read)


def _at_detector(map: RayMap, word: str, name: str) -> _Reader:
    map = seen_by(map, name)
    names = [entry.name for entry in map.directory.detectors]
    if name not in names:
        raise unknown("detector", name, names)
    index = names.index(name)
    entry = map.directory.detectors[index]
    unit = str(entry.parameters.get("size_unit", map.directory.length_unit))
    if word == "angle":
        unit = "deg"
    elif word == "radius" and entry.kind != "plane":
        raise RayMapError(f"{name!r} is no plane, so that places on it have no radius")

    def read(found: Found, rays: Ints) -> tuple[Ints, Ints | None, Floats]:
        own, descriptors = registrations(found, 0, index)
        portion = found.portion
        if word == "angle":
            cosine = portion.descriptors().cosine[descriptors] / NORMAL_SCALE
            values = np.degrees(np.arccos(np.clip(np.abs(cosine), 0.0, 1.0)))
        else:
            place = (portion.column("uv")[descriptors] / 65535.0 - 0.5) * entry.size
            values = np.hypot(*place.T) if word == "radius" else place[:, int(word == "v")]
        return own, records_at(portion, descriptors), values

    return _Reader(map, unit, read)


def _samples(
    found: Found, read: _Reader, labels: _Labels, whole: bool
) -> tuple[_Samples, int, list[str]]:
    portion = found.portion
    rays, records, value = read.read(found, np.flatnonzero(found.masks[0]))
    known = np.isfinite(value)
    undefined = len(np.unique(rays[~known]))
    rays, value = rays[known], value[known]
    if records is None:
        records = portion.record_offsets()[1:][rays] - 1
        whole = True
    else:
        records = records[known]
    light = read.map.photometry(portion.channel_set)
    amounts = light.flux_by_channel(light_at(portion, light, rays, records, whole=whole))
    source = portion.column("source")[rays].astype(np.int64)
    own = portion.column("emission")[rays] if portion.grouped else rays
    emission = own.astype(np.int64) + (np.int64(found.index) << 40)
    label, names = labels.of_rays(found, rays)
    if labels.by == "wavelength" or read.by_channel:
        # Each channel of a ray by itself
        row, channel = np.nonzero(amounts)
        channels = read.map.channel_sets[portion.channel_set]
        value, label = value[row], label[row]
        if read.by_channel:
            value = np.asarray(channels.wavelengths_nm, np.float64)[channel]
        if labels.by == "wavelength":
            label, names = channel.astype(np.int64), channels.labels
        samples = _Samples(value, amounts[row, channel], source[row], emission[row], label)
        return samples, undefined, names
    return _Samples(value, amounts.sum(axis=1), source, emission, label), undefined, names


class _Labels:
    """What tells series apart."""

    def __init__(self, map: RayMap, by: By | None, told: str = "face") -> None:
        self.map, self.by, self.told = map, by, told
        self.names: dict[str, int] = {}
        self._words = PathNames(map.directory)

    def of_rays(self, found: Found, rays: Ints) -> tuple[NDArray[np.int64], list[str]]:
        """Numbers of names (n,), and the names."""
        directory = self.map.directory
        path = found.paths.of_ray[rays].astype(np.int64)
        base = found.paths.base
        if self.by in (None, "wavelength"):
            return np.zeros(len(rays), np.int64), ["all"]
        if self.by == "source":
            names = [entry.name for entry in directory.sources]
            return base.source[path].astype(np.int64), names
        if self.by == "object":
            names = [*directory.faces.object_names, "none"]
            last = base.object[base.offsets[1:] - 1].astype(np.int64)
            return np.where(last < 0, len(names) - 1, last)[path], names
        rows, own = np.unique(path, return_inverse=True)
        texts = [path_text(base, int(row), self._words, self.told) for row in rows]
        return own.ravel().astype(np.int64), texts

    def global_of(self, names: list[str]) -> NDArray[np.int64]:
        """Numbers of names in the whole map."""
        return np.array(
            [self.names.setdefault(name, len(self.names)) for name in names] or [0], np.int64
        )


# -- what is made of it -------------------------------------------------------------------------


def _joined(parts: list[_Samples]) -> _Samples:
    if not parts:
        none = np.zeros(0, np.int64)
        return _Samples(np.zeros(0), np.zeros(0), none, none, none)
    return _Samples(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _factors(map: RayMap, emitted: Ints) -> Floats:
    """Flux of a unit of `light_at` of each source; channel sets share the sources."""
    return map.photometry(0).radiant_factors(emitted) if map.channel_sets else np.zeros(0)


def _edges(value: Floats, bins: int, bounds: tuple[float, float] | None, log: bool) -> Floats:
    if bounds is None:
        usable = value[value > 0.0] if log else value
        if not len(usable):
            return np.array([0.0, 1.0])
        low, high = float(usable.min()), float(usable.max())
    else:
        low, high = _finite(bounds)
    if log and not low > 0.0:
        raise RayMapError(f"logarithmic bins begin above 0, not at {low:g}")
    if bounds is None and not log and high - low < bins and (value == np.rint(value)).all():
        # Whole numbers have a bin each
        return np.arange(low, high + 2.0) - 0.5
    if high <= low:
        if bounds is not None:
            raise RayMapError(f"bins go from low to high, not from {low:g} to {high:g}")
        # All alike
        width = abs(low) * 1e-6 or 0.5
        low, high = low - width, high + width
    return np.geomspace(low, high, bins + 1) if log else np.linspace(low, high, bins + 1)


def _finite(bounds: tuple[float, float]) -> tuple[float, float]:
    """Two finite numbers."""
    low, high = (float(bound) for bound in bounds)
    if not np.isfinite([low, high]).all():
        raise RayMapError(f"bounds are numbers, not {low} and {high}")
    return low, high


def _series(
    whole: _Samples, labels: _Labels, edges: Floats, factors: Floats, emitted: Ints
) -> list[Series]:
    flux = whole.flux * factors[whole.source] if len(whole.value) else whole.flux
    names = list(labels.names) or ["all"]
    total = np.bincount(whole.label, flux, len(names))
    order = [k for k in np.argsort(-total, kind="stable").tolist() if total[k] > 0.0]
    if labels.by is None:
        order = order or [0]
    found = [
        _one(names[k], whole, flux, whole.label == k, edges, emitted) for k in order[:_MOST_SERIES]
    ]
    rest = order[_MOST_SERIES:]
    if rest:
        chosen = np.isin(whole.label, rest)
        found.append(_one(f"{len(rest)} others", whole, flux, chosen, edges, emitted))
    return found


def _one(
    name: str,
    whole: _Samples,
    flux: Floats,
    chosen: NDArray[np.bool_],
    edges: Floats,
    emitted: Ints,
) -> Series:
    value, own = whole.value[chosen], flux[chosen]
    source, emission = whole.source[chosen], whole.emission[chosen]
    n, n_sources = len(edges) - 1, len(emitted)
    index = np.searchsorted(edges, value, side="right") - 1
    index[value == edges[-1]] = n - 1
    inside = (index >= 0) & (index < n)

    def spread_of(label: Ints, values: Floats, emission: Ints, size: int) -> Floats:
        """Squared standard errors of sums by label, of independent emissions of each source."""
        sums = np.bincount(label, values, size).astype(np.float64)
        squares = squares_by_emission(label, values, emission, size)
        return variances(1.0, np.tile(emitted, size // n_sources), sums, squares)

    row = index[inside] * n_sources + source[inside]
    variance = spread_of(row, own[inside], emission[inside], n * n_sources)
    in_bins = np.bincount(index[inside], own[inside], n)
    errors = np.sqrt(variance.reshape(n, n_sources).sum(axis=1))
    counts = np.bincount(index[inside], minlength=n)
    total = float(own.sum())
    share = own / total if total > 0.0 else own
    mean = float(share @ value)
    square = float(share @ (value - mean) ** 2)
    zeros = np.zeros(len(value), np.int64)

    def error(values: Floats) -> float:
        """Standard error of a sum that is 0."""
        return float(np.sqrt(squares_by_emission(zeros, values, emission, 1)[0]))

    spread = square**0.5
    spread_se = error(share * ((value - mean) ** 2 - square)) / (2.0 * spread) if spread else 0.0
    order = np.argsort(value)
    sorted_value, held = value[order], np.cumsum(share[order])
    quantiles: dict[str, float] = {}
    quantiles_se: dict[str, float] = {}
    for wanted in QUANTILES if len(value) else ():
        at = _quantile(sorted_value, held, wanted)
        off = error(share * ((value <= at) - wanted))
        ends = (_quantile(sorted_value, held, wanted + side * off) for side in (-1.0, 1.0))
        low, high = ends
        quantiles[f"{wanted:g}"], quantiles_se[f"{wanted:g}"] = at, 0.5 * (high - low)
    whole_variance = spread_of(source, own, emission, n_sources).sum()
    return Series(
        name=name,
        flux=total,
        flux_se=float(np.sqrt(whole_variance)),
        count=len(value),
        mean=mean,
        mean_se=error(share * (value - mean)),
        spread=spread,
        spread_se=spread_se,
        quantiles=quantiles,
        quantiles_se=quantiles_se,
        bins=tuple(
            Bin(
                low=float(edges[k]),
                high=float(edges[k + 1]),
                flux=float(in_bins[k]),
                flux_se=float(errors[k]),
                rays=int(counts[k]),
            )
            for k in range(n)
        ),
    )


def _quantile(sorted_value: Floats, held: Floats, share: float) -> float:
    index = int(np.searchsorted(held, min(1.0, max(0.0, share))))
    return float(sorted_value[min(index, len(held) - 1)])
