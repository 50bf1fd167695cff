"""Detector pictures of selections: flux per cell and channel, several criteria in one pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.binning import block_sums, coarser
from query.answers.images.lit import LitCells
from query.answers.images.pictures import DetectorImage
from query.answers.paths.peaks import registrations
from query.answers.selections.selector import bind_all
from query.engine.bound import BoundNode
from query.engine.light import light_at, records_at
from query.engine.places import seen_by
from query.engine.scan import Cancel, Progress, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import sums as weighted_counts
from raymap.model.directory import Detector
from raymap.model.errors import RayMapError
from raymap.model.limits import PICTURE_FLOOR, PICTURE_PER_BYTE, affordable
from raymap.model.rows import squares_by_emission
from raymap.optics.cells import is_pinhole
from raymap.optics.fluxes import variances
from raymap.optics.photometry import Photometry

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["detector_image", "detector_images"]

Floats = NDArray[np.float64]

_MAX_VALUES = 2**28


def detector_image(
    map: RayMap,
    detector: str,
    criterion: object = None,
    *,
    bin: int = 1,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
) -> DetectorImage:
    """The picture that the rays of a selection made on a detector.

    Parameters
    ----------
    detector : name, or the description of a place (`query.with_detectors`)
    criterion : text, tree or JSON; None: all rays
    bin : join blocks of so many cells by so many, for a picture of few rays

    Raises
    ------
    UnknownName, CriterionError, RayMapError
    """
    return detector_images(
        map,
        detector,
        {"": criterion},
        bin=bin,
        threads=threads,
        progress=progress,
        cancel=cancel,
    )[""]


@asked_again
def detector_images(
    map: RayMap,
    detector: str,
    layers: Mapping[str, object],
    *,
    bin: int = 1,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
) -> dict[str, DetectorImage]:
    """Pictures of several criteria on one detector, in one pass over the map.

    Raises
    ------
    UnknownName, CriterionError, RayMapError
        also where portions have channel sets with different numbers of channels.
    """
    map = seen_by(map, detector)
    index = _detector_index(map, detector)
    seen = coarser(map.directory.detectors[index], bin)
    shape = _shape(map, seen, len(layers))
    nodes = bind_all(map, list(layers.values()))
    plain = all(value is None for value in layers.values())
    if is_pinhole(map.directory.detectors[index]) and not plain:
        raise RayMapError(
            f"detector {detector!r} is a pinhole: its picture is summed up while tracing and no "
            "ray meets it, so no criterion can choose from it; a camera has a lens that rays pass"
        )
    if plain and (not map.rays or is_pinhole(map.directory.detectors[index])):
        return {name: _from_results(map, seen, bin) for name in layers}
    emitted = map.emitted
    chosen = [value is not None for value in layers.values()]
    sums, scan = _accumulate(
        map, nodes, chosen, (index, bin), shape, emitted, threads, progress, cancel
    )
    if scan.complete and (scan.emitted != emitted).any():
        # Damage was met on the way: the emitted rays of what was lost do not count.
        emitted = scan.emitted
        sums, scan = _accumulate(
            map, nodes, chosen, (index, bin), shape, emitted, threads, None, cancel
        )
    share = 1.0 if scan.complete else float(emitted.sum() / max(int(scan.emitted.sum()), 1))
    used = min({portion.channel_set for portion in map.portions} or {0})
    light = map.photometry(used)
    pictures = {}
    for name, found in zip(layers, sums, strict=True):
        cells = found.cells()
        pictures[name] = DetectorImage(
            lit=LitCells(
                detector=seen,
                channel_set=map.channel_sets[used],
                flux_unit=map.directory.flux_unit,
                length_unit=map.directory.length_unit,
                cell=cells.cell,
                channels=light.flux_by_channel(cells.amounts) * share,
                amounts=cells.amounts * share,
                variance=cells.squares * share**2,
                other_variance=cells.other_squares * share**2,
                rays=cells.rays,
            ),
            complete=scan.complete,
            total_variance={
                unit: share**2 * variance
                for unit, variance in cells.totals.variance(light.unit, emitted).items()
            },
        )
    return pictures


def _accumulate(
    map: RayMap,
    nodes: list[BoundNode],
    chosen: list[bool],
    detector: tuple[int, int],
    shape: tuple[int, int, int],
    emitted: NDArray[np.int64],
    threads: int | None,
    progress: Callable[[Progress], None] | None,
    cancel: Cancel,
) -> tuple[list[_Sums], Scan]:
    """Sums of cells, per criterion, in one pass.

    Parameters
    ----------
    chosen : whether each of the nodes is a criterion, by which whole rays are chosen
    detector : its number, and the side of blocks of cells
    """
    sums = [_Sums(shape, len(map.directory.sources)) for _ in nodes]
    width = shape[1]

    def visit(found: Found) -> list[_Cells | None]:
        light = map.photometry(found.portion.channel_set)
        return [
            _cells(found, number, detector, width, light, emitted, whole=chosen[number])
            for number in range(len(nodes))
        ]

    def take(_: int, product: list[_Cells | None]) -> None:
        for total, cells in zip(sums, product, strict=True):
            if cells is not None:
                total.add(cells)

    scan = Scan(
        map, nodes, visit=visit, take=take, threads=threads, progress=progress, cancel=cancel
    )
    scan.run()
    return sums, scan


@dataclass(frozen=True, eq=False)
class _Cells:
    """Sums of one portion over the cells that were met: cell numbers and their sums.

    ``amounts`` [W] by channel, squares of flux in the unit of the map and in the other one.
    """

    cell: NDArray[np.int64]
    amounts: Floats
    squares: Floats
    other_squares: Floats
    rays: NDArray[np.int64]
    totals: _Totals


class _Sums:
    """Sums of many portions over the cells that were met, in the order in which they were."""

    def __init__(self, shape: tuple[int, int, int], n_sources: int) -> None:
        # Where a cell's sums stand, from 1 on; pages that no ray comes to take no memory
        self._place = np.zeros(shape[0] * shape[1], np.int32)
        self._n = 0
        self._sums = self._room(0, shape[2])
        self._totals = _Totals(*np.zeros((4, n_sources)))

    @staticmethod
    def _room(n: int, n_channels: int) -> tuple[NDArray[Any], ...]:
        """Cell, amounts, squares, other squares and rays of so many cells."""
        floats = np.zeros((n, n_channels)), np.zeros(n), np.zeros(n)
        return np.zeros(n, np.int64), *floats, np.zeros(n, np.int64)

    def add(self, cells: _Cells) -> None:
        """Add another portion's."""
        new = cells.cell[self._place[cells.cell] == 0]
        end = self._n + len(new)
        if end > len(self._sums[0]):
            more = self._room(max(end - self._n, self._n), self._sums[1].shape[1])
            self._sums = tuple(
                np.concatenate((mine[: self._n], zeros))
                for mine, zeros in zip(self._sums, more, strict=True)
            )
        self._place[new] = np.arange(self._n, end) + 1
        self._sums[0][self._n : end] = new
        self._n = end
        index = self._place[cells.cell] - 1
        news = cells.amounts, cells.squares, cells.other_squares, cells.rays
        for mine, light in zip(self._sums[1:], news, strict=True):
            mine[index] += light
        self._totals.add(cells.totals)

    def cells(self) -> _Cells:
        """All of them, in ascending order."""
        order = np.argsort(self._sums[0][: self._n])
        cell, amounts, squares, other_squares, rays = (values[order] for values in self._sums)
        return _Cells(cell, amounts, squares, other_squares, rays, self._totals)


@dataclass(frozen=True, eq=False)
class _Totals:
    """Light of all cells, by source: flux and squares of what each emission brings, in both units.

    The first are in the unit of the map.
    """

    flux: Floats
    squares: Floats
    other_flux: Floats
    other_squares: Floats

    def add(self, more: _Totals) -> None:
        """Add another portion's in place."""
        for name in self.__dataclass_fields__:
            getattr(self, name)[:] += getattr(more, name)

    def variance(self, unit: str, emitted: NDArray[np.int64]) -> dict[str, float]:
        """Squared standard error of all light, by unit; ``unit`` is that of the map."""
        ones = np.ones(len(emitted))
        own = variances(ones, emitted, self.flux, self.squares)
        other = variances(ones, emitted, self.other_flux, self.other_squares)
        return {unit: float(own.sum()), "lm" if unit == "W" else "W": float(other.sum())}


def _cells(
    found: Found,
    number: int,
    detector: tuple[int, int],
    width: int,
    light: Photometry,
    emitted: NDArray[np.int64],
    *,
    whole: bool,
) -> _Cells | None:
    """Light of the matching rays per cell, in worker threads.

    ``whole`` : of light that goes on as the whole ray did, as a criterion asks
    """
    rays, descriptors = registrations(found, number, detector[0])
    if not len(rays):
        return None
    portion = found.portion
    index = portion.column("cell")[descriptors].astype(np.int64) // detector[1]
    source = found.paths.base.source[found.paths.of_ray[rays]]
    watt = light.radiant_factors(emitted)[source]
    records = records_at(portion, descriptors)
    amounts = watt[:, None] * light_at(portion, light, rays, records, whole=whole)
    cell, inverse = np.unique(index[:, 1] * width + index[:, 0], return_inverse=True)
    sums = np.empty((len(cell), amounts.shape[1]))
    for channel in range(amounts.shape[1]):
        sums[:, channel] = np.bincount(inverse, amounts[:, channel], len(cell))
    fluxes = {
        "W": amounts.sum(axis=1),
        "lm": amounts @ light.efficacy,
    }
    emission = portion.column("emission")[rays] if portion.grouped else rays
    squares = {unit: _squares(inverse, flux, emission, len(cell)) for unit, flux in fluxes.items()}
    n_sources = len(emitted)
    by_source = {
        unit: (
            weighted_counts(source, flux, n_sources),
            _squares(source, flux, emission, n_sources),
        )
        for unit, flux in fluxes.items()
    }
    own, totals = squares.pop(light.unit), by_source.pop(light.unit)
    [other], [other_totals] = squares.values(), by_source.values()
    met = np.bincount(inverse, minlength=len(cell))
    return _Cells(cell, sums, own, other, met, _Totals(*totals, *other_totals))


def _squares(cell: NDArray[np.integer], flux: Floats, emission: NDArray[Any], size: int) -> Floats:
    """Squares of what each emission brings to a cell or label, added up."""
    if (np.diff(emission) == 0).any():
        return squares_by_emission(cell, flux, emission, size)
    return weighted_counts(cell, flux**2, size)


def _detector_index(map: RayMap, name: str) -> int:
    from query.expression.names import unknown

    names = [detector.name for detector in map.directory.detectors]
    if name not in names:
        raise unknown("detector", name, names)
    return names.index(name)


def _channels(map: RayMap) -> int:
    """Number of the channels that all light of a map has.

    Raises
    ------
    RayMapError
        Portions have other channels, even if as many: R is no light of 450 nm.
    """
    used = {portion.channel_set for portion in map.portions} or set(range(len(map.channel_sets)))
    found = {
        (chosen.kind, chosen.wavelengths_nm): chosen
        for number, chosen in enumerate(map.channel_sets)
        if number in used
    }
    if len(found) > 1:
        said = " and ".join(found[key].said for key in sorted(found))
        raise RayMapError(
            f"portions of this map have different channels ({said}), of which no picture can be "
            "summed; record them as maps of their own"
        )
    return next(iter(found.values())).n_channels if found else 1


def _shape(map: RayMap, detector: Detector, n_layers: int) -> tuple[int, int, int]:
    width, height = detector.cells
    shape = height, width, _channels(map)
    if height * width * shape[2] * n_layers > _MAX_VALUES:
        raise RayMapError(
            f"{n_layers} pictures of {width} x {height} cells and {shape[2]} channels do not fit "
            "in memory; ask for fewer layers at a time"
        )
    if height * width * n_layers > (most := affordable(map.bytes, PICTURE_FLOOR, PICTURE_PER_BYTE)):
        raise RayMapError(
            f"{n_layers} x {width} x {height} cells are more than a map of {map.bytes} bytes can "
            f"pay for ({most} cells); join blocks of cells (--bin), or ask for fewer "
            "layers at a time"
        )
    return shape


def _from_results(map: RayMap, detector: Detector, bin: int) -> DetectorImage:
    """The detector's own sums, of a map that stores no rays."""
    result = map.detector_result(detector.name)
    if result is None:
        raise RayMapError(f"the map holds neither rays nor sums of detector {detector.name!r}")
    light = map.photometry(0)
    factor = light.result_factor(map.emitted)
    sums, squares = (block_sums(values, bin) for values in result)
    amounts = sums * factor
    # Sums do not tell how channels go together: exact where light keeps its colour, else more
    errors = {
        "W": np.sqrt(squares).sum(axis=2) * factor,
        "lm": np.sqrt(squares) @ light.efficacy * factor,
    }
    variance = errors.pop(light.unit) ** 2
    [other] = errors.values()
    lit = LitCells.of_arrays(
        detector=detector,
        channel_set=map.channel_sets[0],
        flux_unit=map.directory.flux_unit,
        length_unit=map.directory.length_unit,
        channels=light.flux_by_channel(amounts),
        amounts=amounts,
        variance=variance,
        other_variance=other**2,
        rays=np.round(sums.sum(axis=2)).astype(np.int64) * (not is_pinhole(detector)),
    )
    error = map.detector_error(detector.name)
    if error is None:
        return DetectorImage(lit=lit)
    # In the other unit the relative error is taken to be the same
    share = error / flux if (flux := float(lit.flux.sum())) > 0.0 else 0.0
    whole = {unit: (share * float(lit.flux_in(unit).sum())) ** 2 for unit in ("W", "lm")}
    return DetectorImage(lit=lit, total_variance=whole | {light.unit: error**2})
