"""Light of the cells of a detector that were met: what work and memory of a picture grow with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from query.engine.tally import sums as sums_of
from raymap.model.directory import ChannelSet, Detector
from raymap.model.errors import RayMapError
from raymap.optics.cells import CellMeasure, cell_measure
from raymap.optics.colorimetry import xyz_to_linear_srgb
from raymap.optics.photometry import channel_efficacy, channel_rgb, channel_xyz

__all__ = ["QUANTITIES", "LitCells"]

Floats = NDArray[np.float64]

_NAMES = {
    "area": ("irradiance", "illuminance"),
    "solid_angle": ("intensity", "candela"),
    "etendue": ("radiance", "luminance"),
}
"""What flux per measure of a cell is called, radiant and luminous."""

QUANTITIES = tuple(name for names in _NAMES.values() for name in names)
"""Flux per area, solid angle or étendue, in watt and in lumen."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LitCells:
    """Cells of a detector that were met, and the light in each.

    Attributes
    ----------
    detector, channel_set : of the map
    flux_unit, length_unit : of the map
    cell : (n,) int64 numbers of the cells, row x width + column, ascending
    channels : (n, n_channels) flux per cell and channel [flux unit]; in a map in lumen what each
        channel adds to them
    variance : (n,) squared standard error of the flux of a cell [flux unit²]
    rays : (n,) int64, registrations
    amounts : (n, n_channels) watt per cell and channel; None: follows from ``channels``, where the
        eye sees all of them
    other_variance : (n,) squared standard error of the flux in the other unit, lumen of a map in
        watt and watt of one in lumen; None: its relative error is that of the flux
    """

    detector: Detector
    channel_set: ChannelSet
    flux_unit: str
    length_unit: str
    cell: NDArray[np.int64]
    channels: Floats
    variance: Floats
    rays: NDArray[np.int64]
    amounts: Floats | None = None
    other_variance: Floats | None = None

    @classmethod
    def of_arrays(
        cls,
        *,
        detector: Detector,
        channel_set: ChannelSet,
        flux_unit: str,
        length_unit: str,
        channels: Floats,
        variance: Floats,
        rays: NDArray[np.int64],
        amounts: Floats | None = None,
        other_variance: Floats | None = None,
    ) -> Self:
        """The same of arrays over all cells, (cells_v, cells_u[, n_channels])."""
        met = channels.any(axis=2) | (variance != 0.0) | (rays != 0)
        if amounts is not None:
            met |= amounts.any(axis=2)
        return cls(
            detector=detector,
            channel_set=channel_set,
            flux_unit=flux_unit,
            length_unit=length_unit,
            cell=np.flatnonzero(met),
            channels=channels[met],
            variance=variance[met],
            rays=rays[met],
            amounts=None if amounts is None else amounts[met],
            other_variance=None if other_variance is None else other_variance[met],
        )

    @property
    def row(self) -> NDArray[np.int64]:
        """(n,) rows, the lowest is 0."""
        return self.cell // self.detector.cells[0]

    @property
    def column(self) -> NDArray[np.int64]:
        """(n,) columns."""
        return self.cell % self.detector.cells[0]

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """(cells_v, cells_u, …) values of lit cells among those of dark ones, which are 0."""
        return self.band(values, range(self.detector.cells[1]))

    def band(self, values: NDArray[Any], rows: range) -> NDArray[Any]:
        """(n_rows, cells_u, …) the same of some rows."""
        width = self.detector.cells[0]
        some = slice(*np.searchsorted(self.cell, (rows.start * width, rows.stop * width)))
        everywhere = np.zeros((len(rows) * width, *values.shape[1:]), values.dtype)
        everywhere[self.cell[some] - rows.start * width] = values[some]
        return everywhere.reshape(len(rows), width, *values.shape[1:])

    def blocks(self, values: Floats, side: int) -> Floats:
        """Sums over blocks of ``side`` x ``side`` cells; those at the far borders may hold fewer.

        Parameters
        ----------
        values : (n,)
        """
        width, height = (-(-cells // side) for cells in self.detector.cells)
        index = self.row // side * width + self.column // side
        return sums_of(index, values, height * width).reshape(height, width)

    @property
    def flux(self) -> Floats:
        """(n,) flux per cell [flux unit]."""
        flux: Floats = self.channels.sum(axis=1)
        return flux

    @cached_property
    def watts(self) -> Floats:
        """(n, n_channels) radiant flux per cell and channel [W].

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
        """(n,) flux per cell in "W" or "lm", whatever the unit of the map."""
        if unit == self.flux_unit:
            return self.flux
        if unit == "W":
            return np.asarray(self.watts.sum(axis=1))
        return np.asarray(self.watts @ self._per_channel(channel_efficacy(self.channel_set)))

    def flux_se_in(self, unit: str) -> Floats:
        """(n,) standard error of `flux_in`."""
        flux_se = np.sqrt(self.variance)
        if unit == self.flux_unit:
            return flux_se
        if self.other_variance is not None:
            return np.sqrt(self.other_variance)
        flux = self.flux
        share = np.divide(flux_se, flux, out=np.zeros_like(flux), where=flux > 0)
        return share * self.flux_in(unit)

    @property
    def xyz(self) -> Floats:
        """(n, 3) tristimulus values per cell; Y is the luminous flux [lm]."""
        return np.asarray(self.watts @ self._per_channel(channel_xyz(self.channel_set)))

    @property
    def linear_rgb(self) -> Floats:
        """(n, 3) linear sRGB; see `query.answers.images.pictures.DetectorImage.linear_rgb`."""
        if self.flux_unit == "lm":
            return xyz_to_linear_srgb(self.xyz)
        return np.asarray(self.watts @ self._per_channel(channel_rgb(self.channel_set)))

    def _per_channel(self, values: Floats) -> Floats:
        if len(values) != self.channels.shape[1]:
            raise RayMapError(
                f"the picture of {self.detector.name!r} has {self.channels.shape[1]} channels, the "
                f"map describes {len(values)}: they say neither lumens nor colours"
            )
        return values

    @cached_property
    def measure(self) -> CellMeasure | None:
        """Area, solid angle or étendue of each cell of the detector; None where it is not known."""
        return cell_measure(self.detector, self.length_unit)

    @cached_property
    def size(self) -> Floats:
        """(n,) measure of each lit cell.

        Raises
        ------
        RayMapError
            the size of the detector's cells is not known
        """
        if self.measure is None:
            raise RayMapError(
                f"detector {self.detector.name!r} is of kind {self.detector.kind} and the map does "
                "not tell the size of its cells; use the flux per cell"
            )
        return self.measure.sizes.at(self.row, self.column)

    def per_measure(self, values: Floats) -> Floats:
        """(n,) values per measure of the cell; 0 beside a face."""
        result: Floats = np.divide(
            values, self.size, out=np.zeros_like(values), where=self.size > 0.0
        )
        return result

    def unit_of(self, quantity: str) -> str:
        """The unit of flux that a quantity is in, refused where the cells have another quantity.

        Parameters
        ----------
        quantity : irradiance, intensity, radiance (by watt); illuminance, candela, luminance (lm)

        Raises
        ------
        RayMapError
        """
        kind, luminous = next(
            (kind, names.index(quantity)) for kind, names in _NAMES.items() if quantity in names
        )
        if self.measure is not None and self.measure.quantity != kind:
            has = _NAMES[self.measure.quantity][luminous]
            raise RayMapError(
                f"detector {self.detector.name!r} is of kind {self.detector.kind}: it has no "
                f"{quantity}; ask for its {has}"
            )
        return "lm" if luminous else "W"

    def quantity(self, name: str | None = None) -> tuple[Floats, Floats, str]:
        """(n,) values, (n,) standard errors, and their unit.

        Parameters
        ----------
        name : as of `unit_of`; None: flux per measure in the unit of the map, flux alone where the
            size of cells is not known

        Raises
        ------
        RayMapError
        """
        if name is None and self.measure is None:
            return self.flux, np.sqrt(self.variance), self.flux_unit
        unit = self.flux_unit if name is None else self.unit_of(name)
        values, errors = (
            self.per_measure(light) for light in (self.flux_in(unit), self.flux_se_in(unit))
        )
        assert self.measure is not None
        return values, errors, self.measure.density_unit(unit)

    @property
    def density_name(self) -> str | None:
        """What flux per measure is called: irradiance, illuminance, intensity, radiance, …."""
        if self.measure is None:
            return None
        return _NAMES[self.measure.quantity][self.flux_unit == "lm"]
