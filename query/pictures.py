"""What a detector saw of a selection: flux, densities and colours by cell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from query.binning import block_sums, fitting_blocks
from raymap.cells import CellMeasure, cell_measure
from raymap.colorimetry import encode_srgb
from raymap.directory import ChannelSet, Detector
from raymap.errors import RayMapError

__all__ = ["DetectorImage"]

Floats = NDArray[np.float64]

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

    @property
    def grain(self) -> float | None:
        """Standard error of a cell over its flux, the median of the lit ones; None if all are dark.

        What a picture shows as speckle.
        """
        return _grain(self.flux, self.variance)

    def calmer(self, grain: float = 0.1) -> tuple[int, float] | None:
        """Side of the blocks of cells that bring `grain` to this, and what they bring it to.

        The largest blocks if none does; None where the grain is that small already or no blocks
        fit the cells.
        """
        blocks = fitting_blocks(self.detector)
        if self.grain is None or self.grain <= grain or not blocks:
            return None
        reached = self.grain
        for side in blocks:
            reached = _grain(block_sums(self.flux, side), block_sums(self.variance, side)) or 0.0
            if reached <= grain:
                return side, reached
        return blocks[-1], reached

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
        return np.round(encode_srgb(linear * exposure) * 255).astype(np.uint8)

    def _repr_html_(self) -> str:
        from query.image_files import png_html

        return png_html(self)


def _grain(flux: Floats, variance: Floats) -> float | None:
    """Standard error over flux, the median of the lit cells."""
    lit = (flux > 0.0) & (variance > 0.0)
    return float(np.median(np.sqrt(variance[lit]) / flux[lit])) if lit.any() else None
