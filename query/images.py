"""Detector pictures of selections: flux per cell and channel, several criteria in one pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.bound import BoundNode
from query.peaks import registrations
from query.scan import Cancel, Progress, Scan
from query.search import Found
from query.selector import bind_all
from query.tally import source_factors
from query.tally import sums as weighted_counts
from raymap.directory import ChannelSet, Detector
from raymap.errors import RayMapError
from raymap.schema import COLOR_SCALE

__all__ = ["DetectorImage", "detector_image", "detector_images"]

Floats = NDArray[np.float64]

_METRES = {"nm": 1e-9, "um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_MAX_VALUES = 2**28


@dataclass(frozen=True, eq=False, kw_only=True)
class DetectorImage:
    """What a detector saw of a selection.

    Row 0 is the bottom row of the detector, as cells are counted; files show it upright.

    Attributes
    ----------
    detector, channel_set : of the map
    flux_unit, length_unit : of the map
    channels : (cells_v, cells_u, n_channels) flux per cell and channel [flux unit]
    variance : (cells_v, cells_u) squared standard error of the flux of a cell [flux unit²]
    rays : (cells_v, cells_u) int64, registrations
    complete : False if the search was cancelled
    """

    detector: Detector
    channel_set: ChannelSet
    flux_unit: str
    length_unit: str
    channels: Floats
    variance: Floats
    rays: NDArray[np.int64]
    complete: bool = True

    @property
    def flux(self) -> Floats:
        """(cells_v, cells_u) flux per cell [flux unit]."""
        flux: Floats = self.channels.sum(axis=2)
        return flux

    @property
    def flux_se(self) -> Floats:
        """(cells_v, cells_u) standard error of the flux per cell."""
        return np.sqrt(self.variance)

    @property
    def total(self) -> float:
        """Flux registered [flux unit]."""
        return float(self.channels.sum())

    @property
    def cell_area_m2(self) -> float | None:
        """Area of a cell [m²]; None where cells are not flat or have no known unit."""
        unit = self.detector.parameters.get("size_unit", self.length_unit)
        if self.detector.kind != "plane" or unit not in _METRES:
            return None
        width, height = (
            self.detector.size[axis] * _METRES[unit] / self.detector.cells[axis] for axis in (0, 1)
        )
        return float(width * height)

    @property
    def irradiance_unit(self) -> str:
        return "lx" if self.flux_unit == "lm" else "W/m²"

    @property
    def irradiance(self) -> Floats:
        """(cells_v, cells_u) flux per area [W/m² or lx].

        Raises
        ------
        RayMapError
            the detector's cells have no area.
        """
        area = self.cell_area_m2
        if area is None:
            raise RayMapError(
                f"detector {self.detector.name!r} is of kind {self.detector.kind}: its cells have "
                "no area, so there is no irradiance; use the flux per cell"
            )
        return self.flux / area

    @property
    def illuminance(self) -> Floats:
        """(cells_v, cells_u) [lx]: channels weighed with their luminous efficacy where in watts."""
        if self.flux_unit == "lm":
            return self.irradiance
        area = self.cell_area_m2
        luminous = np.array(self.channel_set.luminous)
        if area is None or len(luminous) != self.channels.shape[2]:
            raise RayMapError(
                f"no illuminance on {self.detector.name!r}: it takes a flat detector and channels "
                "with luminous efficacy"
            )
        if self.channel_set.kind == "rgb":
            raise RayMapError(
                "the map is in RGB and in watts: without a spectrum there is no illuminance"
            )
        result: Floats = self.channels @ luminous / area
        return result

    @property
    def linear_rgb(self) -> Floats:
        """(cells_v, cells_u, 3) linear sRGB in units of flux; spectra through the CIE observer."""
        matrix = np.array(self.channel_set.display_rgb, np.float64).reshape(-1, 3)
        if len(matrix) != self.channels.shape[2]:
            raise RayMapError("the channels of this map have no display colours")
        rgb: Floats = self.channels @ matrix
        return rgb

    def srgb(self, exposure: float | None = None, percentile: float = 99.9) -> NDArray[np.uint8]:
        """(cells_v, cells_u, 3) 8-bit sRGB; the brightest cells (``percentile``) become white.

        ``exposure`` multiplies the linear picture instead.
        """
        linear = np.maximum(self.linear_rgb, 0.0)
        if exposure is None:
            bright = linear.max(axis=2)
            lit = bright[bright > 0]
            exposure = 1.0 / float(np.percentile(lit, percentile)) if len(lit) else 1.0
        linear = np.minimum(linear * exposure, 1.0)
        # The transfer function of IEC 61966-2-1.
        encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        return np.round(encoded * 255).astype(np.uint8)

    def _repr_html_(self) -> str:
        from query.image_files import png_html

        return png_html(self)


def detector_image(
    map: Any,
    detector: str,
    criterion: object = None,
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Cancel = None,
) -> DetectorImage:
    """The picture that the rays of a selection made on a detector.

    Parameters
    ----------
    detector : name
    criterion : text, tree or JSON; None: all rays

    Raises
    ------
    UnknownName, CriterionError, RayMapError
    """
    return detector_images(
        map,
        detector,
        {"": criterion},
        threads=threads,
        progress=progress,
        cancel=cancel,
    )[""]


def detector_images(
    map: Any,
    detector: str,
    layers: Mapping[str, object],
    *,
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
    index = _detector_index(map, detector)
    shape = _shape(map, index, len(layers))
    nodes = bind_all(map, list(layers.values()))
    if not map.rays and all(value is None for value in layers.values()):
        return {name: _from_results(map, index, shape) for name in layers}
    emitted = map.emitted
    sums, scan = _accumulate(map, nodes, index, shape, emitted, threads, progress, cancel)
    if scan.complete and (scan.emitted != emitted).any():
        # Damage was met on the way: the emitted rays of what was lost do not count.
        emitted = scan.emitted
        sums, scan = _accumulate(map, nodes, index, shape, emitted, threads, None, cancel)
    share = 1.0 if scan.complete else float(emitted.sum() / max(int(scan.emitted.sum()), 1))
    used = {portion.channel_set for portion in map.portions} or {0}
    return {
        name: DetectorImage(
            detector=map.directory.detectors[index],
            channel_set=map.channel_sets[min(used)],
            flux_unit=map.directory.flux_unit,
            length_unit=map.directory.length_unit,
            channels=sums[number].channels.reshape(shape) * share,
            variance=sums[number].squares.reshape(shape[:2]) * share**2,
            rays=sums[number].rays.reshape(shape[:2]),
            complete=scan.complete,
        )
        for number, name in enumerate(layers)
    }


def _accumulate(
    map: Any,
    nodes: list[BoundNode],
    detector: int,
    shape: tuple[int, int, int],
    emitted: NDArray[np.int64],
    threads: int | None,
    progress: Callable[[Progress], None] | None,
    cancel: Cancel,
) -> tuple[list[_Cells], Scan]:
    """Sums over all cells, per criterion, in one pass."""
    n_cells = shape[0] * shape[1]
    everywhere = np.arange(n_cells)
    sums = [
        _Cells(
            everywhere,
            np.zeros((n_cells, shape[2])),
            np.zeros(n_cells),
            np.zeros(n_cells, np.int64),
        )
        for _ in nodes
    ]
    factors = source_factors(map.directory, emitted)
    width = shape[1]

    def visit(found: Found) -> list[_Cells | None]:
        return [_cells(found, number, detector, width, factors) for number in range(len(nodes))]

    def take(_: int, product: list[_Cells | None]) -> None:
        for total, cells in zip(sums, product, strict=True):
            if cells is not None:
                total.channels[cells.cell] += cells.channels
                total.squares[cells.cell] += cells.squares
                total.rays[cells.cell] += cells.rays

    scan = Scan(
        map, nodes, visit=visit, take=take, threads=threads, progress=progress, cancel=cancel
    )
    scan.run()
    return sums, scan


@dataclass(frozen=True, eq=False)
class _Cells:
    """Sums of one portion over the cells that were met: cell numbers and their sums."""

    cell: NDArray[np.int64]
    channels: Floats
    squares: Floats
    rays: NDArray[np.int64]


def _cells(found: Found, number: int, detector: int, width: int, factors: Floats) -> _Cells | None:
    """Flux of the matching rays per cell, in worker threads."""
    rays, descriptors = registrations(found, number, detector)
    if not len(rays):
        return None
    portion = found.portion
    place = portion.descriptors().cell[descriptors].astype(np.int64)
    flux = factors[found.paths.base.source[found.paths.of_ray[rays]]]
    if portion.has_weights:
        flux = flux * portion.column("weight")[rays]
    # The record whose segment met the detector has the colour.
    first = portion.column("first_descriptor")
    counts = portion.column("descriptor_count")
    met = np.flatnonzero(counts)
    record = met[np.searchsorted(first[met], descriptors, side="right") - 1]
    code = portion.column("color_code")[record]
    n_channels = found.channel_sets[portion.channel_set].n_channels
    own = np.eye(n_channels) * COLOR_SCALE
    colors = np.concatenate((own, portion.color_table())) / COLOR_SCALE
    cell, inverse = np.unique(place[:, 1] * width + place[:, 0], return_inverse=True)
    sums = np.empty((len(cell), n_channels))
    for channel in range(n_channels):
        sums[:, channel] = np.bincount(inverse, flux * colors[code, channel], len(cell))
    return _Cells(
        cell,
        sums,
        weighted_counts(inverse, flux**2, len(cell)),
        np.bincount(inverse, minlength=len(cell)),
    )


def _detector_index(map: Any, name: str) -> int:
    from query.names import unknown

    names = [detector.name for detector in map.directory.detectors]
    if name not in names:
        raise unknown("detector", name, names)
    return names.index(name)


def _shape(map: Any, detector: int, n_layers: int) -> tuple[int, int, int]:
    used = {portion.channel_set for portion in map.portions} or {0}
    sizes = {map.channel_sets[number].n_channels for number in used if map.channel_sets}
    if len(sizes) > 1:
        raise RayMapError(
            "portions of this map have different channels; ask for one part of it at a time, "
            "for example of the file that was recorded in RGB"
        )
    width, height = map.directory.detectors[detector].cells
    shape = height, width, sizes.pop() if sizes else 1
    if height * width * shape[2] * n_layers > _MAX_VALUES:
        raise RayMapError(
            f"{n_layers} pictures of {width} x {height} cells and {shape[2]} channels do not fit "
            "in memory; ask for fewer layers at a time"
        )
    return shape


def _from_results(map: Any, index: int, shape: tuple[int, int, int]) -> DetectorImage:
    """The detector's own sums, of a map that stores no rays."""
    detector = map.directory.detectors[index]
    result = map.detector_result(detector.name)
    if result is None:
        raise RayMapError(f"the map holds neither rays nor sums of detector {detector.name!r}")
    # Sums do not tell sources apart: all rays of such a map carry the same flux.
    flux = sum(source.flux for source in map.directory.sources)
    factor = flux / max(int(map.emitted.sum()), 1)
    sums, squares = result
    return DetectorImage(
        detector=detector,
        channel_set=map.channel_sets[0],
        flux_unit=map.directory.flux_unit,
        length_unit=map.directory.length_unit,
        channels=sums * factor,
        variance=squares.sum(axis=2) * factor**2,
        rays=np.round(sums.sum(axis=2)).astype(np.int64),
    )
