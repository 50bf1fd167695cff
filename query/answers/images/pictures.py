"""What a detector saw of a selection: flux, densities and colours by cell."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.answers.images.binning import fitting_blocks
from query.answers.images.lit import LitCells
from query.engine.tally import sums as sums_of
from raymap.model.directory import ChannelSet, Detector
from raymap.optics.cells import CellMeasure
from raymap.optics.colorimetry import encode_srgb, into_gamut
from raymap.pictures.png import png_bytes, upright

__all__ = ["DetectorImage"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class DetectorImage:
    """What a detector saw of a selection.

    What has a value per cell is made anew each time it is asked for, zeros and all; ``lit`` holds
    the cells that were met. Row 0 is the bottom row of the detector, as cells are counted; files
    show it upright.

    Attributes
    ----------
    lit : the cells that were met, and their light
    complete : False if the search was cancelled
    total_variance : squared standard error of the flux of all cells together, by unit ("W", "lm");
        None: that of cells that are independent, which of most light is more
    """

    lit: LitCells
    complete: bool = True
    total_variance: dict[str, float] | None = None

    @property
    def detector(self) -> Detector:
        """Of the map, with its cells joined if they are."""
        return self.lit.detector

    @property
    def channel_set(self) -> ChannelSet:
        """Of the map."""
        return self.lit.channel_set

    @property
    def flux_unit(self) -> str:
        """Of the map: W or lm."""
        return self.lit.flux_unit

    @property
    def length_unit(self) -> str:
        """Of the map."""
        return self.lit.length_unit

    @property
    def channels(self) -> Floats:
        """(cells_v, cells_u, n_channels) flux per cell and channel [flux unit]."""
        return self.lit.spread(self.lit.channels)

    @property
    def variance(self) -> Floats:
        """(cells_v, cells_u) squared standard error of the flux of a cell [flux unit²]."""
        return self.lit.spread(self.lit.variance)

    @property
    def rays(self) -> NDArray[np.int64]:
        """(cells_v, cells_u) registrations."""
        return self.lit.spread(self.lit.rays)

    @property
    def registrations(self) -> int:
        """Of all cells."""
        return int(self.lit.rays.sum())

    @property
    def flux(self) -> Floats:
        """(cells_v, cells_u) flux per cell [flux unit]."""
        return self.lit.spread(self.lit.flux)

    @property
    def flux_se(self) -> Floats:
        """(cells_v, cells_u) standard error of the flux per cell."""
        return np.sqrt(self.variance)

    @property
    def total(self) -> float:
        """Flux registered [flux unit]."""
        return float(self.lit.channels.sum())

    @property
    def total_se(self) -> float:
        """Standard error of the flux registered [flux unit]."""
        return self.total_se_in(self.flux_unit)

    def total_in(self, unit: str) -> float:
        """Flux registered in "W" or "lm", whatever the unit of the map."""
        return float(self.lit.flux_in(unit).sum())

    def total_se_in(self, unit: str) -> float:
        """Standard error of all flux in "W" or "lm", whatever the unit of the map."""
        if self.total_variance is not None:
            return math.sqrt(self.total_variance[unit])
        return float(np.sqrt((self.lit.flux_se_in(unit) ** 2).sum()))

    @property
    def grain(self) -> float | None:
        """Standard error of a cell over its flux, the median of the lit ones; None if all are dark.

        What a picture shows as speckle.
        """
        return _grain(self.lit.flux, self.lit.variance)

    def calmer(self, grain: float = 0.1) -> tuple[int, float] | None:
        """Side of the blocks of cells that bring `grain` to this, and what they bring it to.

        The largest blocks if none does; None where the grain is that small already or no blocks
        fit the cells.
        """
        blocks = fitting_blocks(self.detector)
        if self.grain is None or self.grain <= grain or not blocks:
            return None
        lit = self.lit
        rows, columns = lit.row, lit.column
        reached = self.grain
        for side in blocks:
            width = self.detector.cells[0] // side
            _, block = np.unique(rows // side * width + columns // side, return_inverse=True)
            joined = (sums_of(block, values, 0) for values in (lit.flux, lit.variance))
            reached = _grain(*joined) or 0.0
            if reached <= grain:
                return side, reached
        return blocks[-1], reached

    @property
    def measure(self) -> CellMeasure | None:
        """Area, solid angle or étendue of each cell; None where it is not known."""
        return self.lit.measure

    @property
    def cell_area_m2(self) -> float | None:
        """Area of a cell [m²]; None where cells are not flat or have no known unit."""
        if self.detector.kind != "plane" or self.measure is None:
            return None
        return self.measure.sizes.alike

    @property
    def watts(self) -> Floats:
        """(cells_v, cells_u, n_channels) radiant flux per cell and channel [W].

        Of light in RGB by 179 lm/W of white.

        Raises
        ------
        RayMapError
            the channels of the map are not those of its picture
        """
        return self.lit.spread(self.lit.watts)

    def flux_in(self, unit: str) -> Floats:
        """(cells_v, cells_u) flux per cell in "W" or "lm", whatever the unit of the map."""
        return self.lit.spread(self.lit.flux_in(unit))

    def flux_se_in(self, unit: str) -> Floats:
        """(cells_v, cells_u) standard error of `flux_in`."""
        return self.lit.spread(self.lit.flux_se_in(unit))

    @property
    def xyz(self) -> Floats:
        """(cells_v, cells_u, 3) tristimulus values per cell; Y is the luminous flux [lm]."""
        return self.lit.spread(self.lit.xyz)

    def density(self, *, luminous: bool = False) -> Floats:
        """(cells_v, cells_u) flux per area, solid angle or étendue; 0 beside a face.

        ``luminous`` in lumen, whatever the unit of the map; else in that unit.

        Raises
        ------
        RayMapError
            the size of the detector's cells is not known
        """
        unit = "lm" if luminous else self.flux_unit
        return self.lit.spread(self.lit.per_measure(self.lit.flux_in(unit)))

    @property
    def density_se(self) -> Floats:
        """(cells_v, cells_u) standard error of `density`."""
        return self.lit.spread(self.lit.per_measure(np.sqrt(self.lit.variance)))

    @property
    def density_unit(self) -> str | None:
        """Unit of `density`: W/m², lx, W/sr, cd, W/(m² sr), cd/m²."""
        return None if self.measure is None else self.measure.density_unit(self.flux_unit)

    @property
    def density_name(self) -> str | None:
        """What `density` is called: irradiance, illuminance, intensity, radiance, luminance."""
        return self.lit.density_name

    def quantity(self, name: str) -> tuple[Floats, Floats, str]:
        """Values, standard errors and unit of a quantity, refused where the cells have another.

        Parameters
        ----------
        name : irradiance, intensity, radiance (by watt); illuminance, candela, luminance (by lumen)

        Raises
        ------
        RayMapError
        """
        values, errors, unit = self.lit.quantity(name)
        return self.lit.spread(values), self.lit.spread(errors), unit

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
        return self.lit.spread(self.lit.linear_rgb)

    def srgb(self, exposure: float | None = None, percentile: float = 99.9) -> NDArray[np.uint8]:
        """(cells_v, cells_u, 3) 8-bit sRGB; the brightest cells (``percentile``) become white.

        Colours outside the gamut get white of their own luminance. ``exposure`` multiplies the
        linear picture instead.
        """
        linear = into_gamut(self.lit.linear_rgb)
        if exposure is None:
            bright = linear.max(axis=1)
            lit = bright[bright > 0]
            exposure = 1.0 / float(np.percentile(lit, percentile)) if len(lit) else 1.0
        return self.lit.spread(np.round(encode_srgb(linear * exposure) * 255).astype(np.uint8))

    def _repr_html_(self) -> str:
        data = base64.b64encode(png_bytes(upright(self.srgb()))).decode()
        return f'<img src="data:image/png;base64,{data}" alt="{self.detector.name}">'


def _grain(flux: Floats, variance: Floats) -> float | None:
    """Standard error over flux, the median of the lit cells."""
    lit = (flux > 0.0) & (variance > 0.0)
    return float(np.median(np.sqrt(variance[lit]) / flux[lit])) if lit.any() else None
