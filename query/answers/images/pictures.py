"""What a detector saw of a selection: flux, densities and colours by cell."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from query.answers.images.binning import fitting_blocks
from query.answers.images.png import png_bytes, upright
from raymap.model.directory import ChannelSet, Detector
from raymap.model.errors import RayMapError
from raymap.optics.cells import CellMeasure, cell_measure
from raymap.optics.colorimetry import encode_srgb, into_gamut, xyz_to_linear_srgb
from raymap.optics.photometry import channel_efficacy, channel_rgb, channel_xyz

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
    channels : (cells_v, cells_u, n_channels) flux per cell and channel [flux unit]; in a map in
        lumen what each channel adds to them
    variance : (cells_v, cells_u) squared standard error of the flux of a cell [flux unit²]
    rays : (cells_v, cells_u) int64, registrations
    complete : False if the search was cancelled
    amounts : (cells_v, cells_u, n_channels) watt per cell and channel; None: follows from
        ``channels``, where the eye sees all of them
    other_variance : (cells_v, cells_u) squared standard error of the flux in the other unit, lumen
        of a map in watt and watt of one in lumen; None: its relative error is that of the flux
    total_variance : squared standard error of the flux of all cells together, by unit ("W", "lm");
        None: that of cells that are independent, which of most light is more
    """

    detector: Detector
    channel_set: ChannelSet
    flux_unit: str
    length_unit: str
    channels: Floats
    variance: Floats
    rays: NDArray[np.int64]
    complete: bool = True
    amounts: Floats | None = None
    other_variance: Floats | None = None
    total_variance: dict[str, float] | None = None

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
    def total_se(self) -> float:
        """Standard error of the flux registered [flux unit]."""
        return self.total_se_in(self.flux_unit)

    def total_se_in(self, unit: str) -> float:
        """Standard error of all flux in "W" or "lm", whatever the unit of the map."""
        if self.total_variance is not None:
            return math.sqrt(self.total_variance[unit])
        return float(np.sqrt((self.flux_se_in(unit) ** 2).sum()))

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
        flux = self.flux
        rows, columns = np.nonzero((flux != 0.0) | (self.variance != 0.0))
        light, squares = flux[rows, columns], self.variance[rows, columns]
        reached = self.grain
        for side in blocks:
            width = self.detector.cells[0] // side
            _, block = np.unique(rows // side * width + columns // side, return_inverse=True)
            joined = (np.bincount(block, values).astype(np.float64) for values in (light, squares))
            reached = _grain(*joined) or 0.0
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

    @cached_property
    def watts(self) -> Floats:
        """(cells_v, cells_u, n_channels) radiant flux per cell and channel [W].

        Of light in RGB by 179 lm/W of white.

        Raises
        ------
        RayMapError
            the channels of the map are not those of its picture
        """
        if self.amounts is not None:
            return self.amounts
        efficacy = self._per_channel(channel_efficacy(self.channel_set))
        if self.flux_unit == "W":
            return self.channels
        watts: Floats = np.divide(
            self.channels, efficacy, out=np.zeros_like(self.channels), where=efficacy > 0.0
        )
        return watts

    def flux_in(self, unit: str) -> Floats:
        """(cells_v, cells_u) flux per cell in "W" or "lm", whatever the unit of the map."""
        if unit == self.flux_unit:
            return self.flux
        if unit == "W":
            return np.asarray(self.watts.sum(axis=2))
        return np.asarray(self.watts @ self._per_channel(channel_efficacy(self.channel_set)))

    def flux_se_in(self, unit: str) -> Floats:
        """(cells_v, cells_u) standard error of `flux_in`."""
        if unit == self.flux_unit:
            return self.flux_se
        if self.other_variance is not None:
            return np.sqrt(self.other_variance)
        share = np.divide(
            self.flux_se, self.flux, out=np.zeros_like(self.flux), where=self.flux > 0
        )
        return share * self.flux_in(unit)

    @property
    def xyz(self) -> Floats:
        """(cells_v, cells_u, 3) tristimulus values per cell; Y is the luminous flux [lm]."""
        return np.asarray(self.watts @ self._per_channel(channel_xyz(self.channel_set)))

    def _per_channel(self, values: Floats) -> Floats:
        if len(values) != self.channels.shape[2]:
            raise RayMapError(
                f"the picture of {self.detector.name!r} has {self.channels.shape[2]} channels, the "
                f"map describes {len(values)}: they say neither lumens nor colours"
            )
        return values

    def density(self, *, luminous: bool = False) -> Floats:
        """(cells_v, cells_u) flux per area, solid angle or étendue; 0 beside a face.

        ``luminous`` in lumen, whatever the unit of the map; else in that unit.

        Raises
        ------
        RayMapError
            the size of the detector's cells is not known
        """
        return self._per_measure(self.flux_in("lm") if luminous else self.flux)

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

    def quantity(self, name: str) -> tuple[Floats, Floats, str]:
        """Values, standard errors and unit of a quantity, refused where the cells have another.

        Parameters
        ----------
        name : irradiance, intensity, radiance (by watt); illuminance, candela, luminance (by lumen)

        Raises
        ------
        RayMapError
        """
        quantity, luminous = next(
            (quantity, names.index(name)) for quantity, names in _NAMES.items() if name in names
        )
        if self.measure is not None and self.measure.quantity != quantity:
            has = _NAMES[self.measure.quantity][luminous]
            raise RayMapError(
                f"detector {self.detector.name!r} is of kind {self.detector.kind}: it has no "
                f"{name}; ask for its {has}"
            )
        unit = "lm" if luminous else "W"
        values, errors = (self._per_measure(v) for v in (self.flux_in(unit), self.flux_se_in(unit)))
        assert self.measure is not None
        return values, errors, self.measure.density_unit(unit)

    @property
    def irradiance(self) -> Floats:
        """(cells_v, cells_u) radiant flux per area [W/m²], of planes and faces.

        Raises
        ------
        RayMapError
            the detector's cells have no area.
        """
        return self.quantity("irradiance")[0]

    @property
    def illuminance(self) -> Floats:
        """(cells_v, cells_u) luminous flux per area [lx], of planes and faces."""
        return self.quantity("illuminance")[0]

    @property
    def intensity(self) -> Floats:
        """(cells_v, cells_u) radiant intensity [W/sr], of far fields."""
        return self.quantity("intensity")[0]

    @property
    def candela(self) -> Floats:
        """(cells_v, cells_u) luminous intensity [cd], of far fields."""
        return self.quantity("candela")[0]

    @property
    def radiance(self) -> Floats:
        """(cells_v, cells_u) radiance [W/(m² sr)], of cameras."""
        return self.quantity("radiance")[0]

    @property
    def luminance(self) -> Floats:
        """(cells_v, cells_u) luminance [cd/m²], of cameras."""
        return self.quantity("luminance")[0]

    @property
    def linear_rgb(self) -> Floats:
        """(cells_v, cells_u, 3) linear sRGB; spectra through the CIE observer.

        In a map in lumen the luminance of a cell's colour is its flux [lm]; in a map in watt red,
        green and blue of an RGB trace, and a common scale for spectra (`raymap.optics.photometry`).
        Parts are negative where light lies outside the gamut.
        """
        if self.flux_unit == "lm":
            return xyz_to_linear_srgb(self.xyz)
        return np.asarray(self.watts @ self._per_channel(channel_rgb(self.channel_set)))

    def srgb(self, exposure: float | None = None, percentile: float = 99.9) -> NDArray[np.uint8]:
        """(cells_v, cells_u, 3) 8-bit sRGB; the brightest cells (``percentile``) become white.

        Colours outside the gamut get white of their own luminance. ``exposure`` multiplies the
        linear picture instead.
        """
        linear = into_gamut(self.linear_rgb)
        if exposure is None:
            bright = linear.max(axis=2)
            lit = bright[bright > 0]
            exposure = 1.0 / float(np.percentile(lit, percentile)) if len(lit) else 1.0
        return np.round(encode_srgb(linear * exposure) * 255).astype(np.uint8)

    def _repr_html_(self) -> str:
        data = base64.b64encode(png_bytes(upright(self.srgb()))).decode()
        return f'<img src="data:image/png;base64,{data}" alt="{self.detector.name}">'


def _grain(flux: Floats, variance: Floats) -> float | None:
    """Standard error over flux, the median of the lit cells."""
    lit = (flux > 0.0) & (variance > 0.0)
    return float(np.median(np.sqrt(variance[lit]) / flux[lit])) if lit.any() else None
