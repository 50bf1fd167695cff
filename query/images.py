"""Detector pictures of selections: flux per cell and channel, several criteria in one pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.bound import BoundNode
from query.peaks import registrations
from query.scan import Cancel, Progress, Scan
from query.search import Found
from query.selector import bind_all
from query.tally import source_factors, squares_by_emission
from query.tally import sums as weighted_counts
from raymap.cells import CellMeasure, cell_measure, is_pinhole
from raymap.directory import ChannelSet, Detector
from raymap.errors import RayMapError
from raymap.schema import COLOR_SCALE

__all__ = ["DetectorImage", "detector_image", "detector_images"]

Floats = NDArray[np.float64]

_MAX_VALUES = 2**28


_NAMES = {
    "area": ("irradiance", "illuminance"),
    "solid_angle": ("intensity", "candela"),
    "etendue": ("radiance", "luminance"),
}
"""What flux per measure of a cell is called, radiant and luminous."""


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

    @cached_property
    def measure(self) -> CellMeasure | None:
        """Area, solid angle or étendue of each cell; None where it is not known."""
        return cell_measure(self.detector, self.length_unit)

    @property
    def cell_area_m2(self) -> float | None:
        """Area of a cell [m²]; None where cells are not flat or have no known unit."""
        if self.detector.kind != "plane" or self.measure is None:
            return None
        return float(self.measure.values[0, 0])

    def density(self, *, luminous: bool = False) -> Floats:
        """(cells_v, cells_u) flux per area, solid angle or étendue; 0 beside a face.

        ``luminous`` weighs the channels of a radiant map with their luminous efficacy.

        Raises
        ------
        RayMapError
            the size of the detector's cells is not known, or the channels' efficacies are not.
        """
        return self._per_measure(self._luminous_flux() if luminous else self.flux)

    @property
    def density_se(self) -> Floats:
        """(cells_v, cells_u) standard error of `density`."""
        return self._per_measure(self.flux_se)

    @property
    def density_unit(self) -> str | None:
        """Unit of `density`: W/m², lx, W/sr, cd, W/(m² sr), cd/m²."""
        return None if self.measure is None else self.measure.density_unit(self.flux_unit)

    @property
    def density_name(self) -> str | None:
        """What `density` is called: irradiance, illuminance, intensity, radiance, luminance."""
        if self.measure is None:
            return None
        return _NAMES[self.measure.quantity][self.flux_unit == "lm"]

    def _per_measure(self, values: Floats) -> Floats:
        if self.measure is None:
            raise RayMapError(
                f"detector {self.detector.name!r} is of kind {self.detector.kind} and the map does "
                "not tell the size of its cells; use the flux per cell"
            )
        size = self.measure.values
        result: Floats = np.divide(values, size, out=np.zeros_like(values), where=size > 0.0)
        return result

    def _luminous_flux(self) -> Floats:
        if self.flux_unit == "lm":
            return self.flux
        luminous = np.array(self.channel_set.luminous)
        if self.channel_set.kind == "rgb":
            raise RayMapError(
                "the map is in RGB and in watts: without a spectrum there is no illuminance"
            )
        if len(luminous) != self.channels.shape[2]:
            raise RayMapError(
                f"no luminous values on {self.detector.name!r}: the channels have no luminous "
                "efficacy"
            )
        result: Floats = self.channels @ luminous
        return result

    def _quantity(self, quantity: str, *, luminous: bool = False) -> Floats:
        """`density`, refused where it is not the quantity asked for."""
        if self.measure is not None and self.measure.quantity != quantity:
            has, wanted = _NAMES[self.measure.quantity][luminous], _NAMES[quantity][luminous]
            raise RayMapError(
                f"detector {self.detector.name!r} is of kind {self.detector.kind}: it has no "
                f"{wanted}; ask for its {has}"
            )
        return self.density(luminous=luminous)

    @property
    def irradiance_unit(self) -> str:
        return "lx" if self.flux_unit == "lm" else "W/m²"

    @property
    def irradiance(self) -> Floats:
        """(cells_v, cells_u) flux per area [W/m² or lx], of planes and faces.

        Raises
        ------
        RayMapError
            the detector's cells have no area.
        """
        return self._quantity("area")

    @property
    def illuminance(self) -> Floats:
        """(cells_v, cells_u) [lx]: channels weighed with their luminous efficacy where in watts."""
        return self._quantity("area", luminous=True)

    @property
    def intensity(self) -> Floats:
        """(cells_v, cells_u) flux per solid angle [W/sr or cd], of far fields."""
        return self._quantity("solid_angle")

    @property
    def candela(self) -> Floats:
        """(cells_v, cells_u) luminous intensity [cd], of far fields."""
        return self._quantity("solid_angle", luminous=True)

    @property
    def radiance(self) -> Floats:
        """(cells_v, cells_u) flux per étendue [W/(m² sr) or cd/m²], of cameras."""
        return self._quantity("etendue")

    @property
    def luminance(self) -> Floats:
        """(cells_v, cells_u) luminance [cd/m²], of cameras."""
        return self._quantity("etendue", luminous=True)

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
    plain = all(value is None for value in layers.values())
    if is_pinhole(map.directory.detectors[index]) and not plain:
        raise RayMapError(
            f"detector {detector!r} is a pinhole: its picture is summed up while tracing and no "
            "ray meets it, so no criterion can choose from it; a camera has a lens that rays pass"
        )
    if plain and (not map.rays or is_pinhole(map.directory.detectors[index])):
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
    place = portion.column("cell")[descriptors].astype(np.int64)
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
    # Add up what one emission brings to a cell before it is squared
    emission = portion.column("emission")[rays] if portion.grouped else rays
    if (np.diff(emission) == 0).any():
        squares = squares_by_emission(inverse, flux, emission, len(cell))
    else:
        squares = weighted_counts(inverse, flux**2, len(cell))
    return _Cells(cell, sums, squares, np.bincount(inverse, minlength=len(cell)))


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
        # Sums do not tell how channels go together: exact where light keeps its colour, else more
        variance=np.sqrt(squares).sum(axis=2) ** 2 * factor**2,
        rays=np.round(sums.sum(axis=2)).astype(np.int64) * (not is_pinhole(detector)),
    )
