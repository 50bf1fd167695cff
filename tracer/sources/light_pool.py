"""Tables of light in one flat pool for the engine: intensities, pictures, lists of rays.

Layout of the tables, from their place in the pool on (``n``, ``m``: cells):

========= ======================================================================================
intensity n, m, gamma [rad] (n + 1), C as azimuth about the axis [rad] (m + 1), running sum of
          the cells' fluxes (n m), intensities ((n + 1)(m + 1)), all by gamma first; then the
          largest of the running sums is 1 and the total flux (of the intensities) follows
picture   columns n, rows m, running sum of the pixels' fluxes (n m; row 0 at the bottom), colours
          (n m C)
list      first row in ``rays``, count n, even (1: all fluxes equal), in order (1), turns per
          pattern, length of the pattern P, first row of the palette in the pool; ranks in the
          pattern (P, -1 where another source has its turn); running sum of fluxes (n, none where
          even); palette
========= ======================================================================================

A row of ``rays`` holds position, direction (both in the frame of the source) and colour: a channel,
-1 for the colour of the source, -2 - k for row k of the palette.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import RayMapError, SceneError
from raymap.model.units import length_scale
from tracer.light import IntensityGrid

__all__ = ["LightPool", "PooledList", "length_in"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

LARGEST_PICTURE = 2**24
"""Most pixels of an emitting picture."""


def length_in(unit: str, wanted: str) -> float:
    """How many ``wanted`` make one ``unit``.

    Raises
    ------
    SceneError
        for an unknown unit
    """
    try:
        return length_scale(unit, wanted)
    except RayMapError as error:
        raise SceneError(str(error)) from None


@dataclass(frozen=True, kw_only=True, eq=False)
class PooledList:
    """A list of rays ready for the pool; see the layout above."""

    positions: NDArray[np.float32]
    directions: NDArray[np.float32]
    flux: Array
    color: Integers
    palette: Array
    in_order: bool


class LightPool:
    """Collects tables of light."""

    def __init__(self, wavelengths_nm: Array, *, rgb: bool) -> None:
        self.wavelengths = wavelengths_nm
        self.rgb = rgb
        self.parts: list[Array] = []
        self.size = 0
        self.rays: list[NDArray[np.float32]] = []
        self.n_rays = 0
        self.means: dict[int, Array] = {}
        """By place the mean colour (C,) of light that has colours of its own."""

    def _add(self, *parts: Array) -> int:
        first = self.size
        for part in parts:
            self.parts.append(np.asarray(part, np.float64).ravel())
            self.size += self.parts[-1].size
        return first

    def add_intensity(self, grid: IntensityGrid) -> int:
        """Place of an intensity table."""
        planes, values = grid.full()
        fluxes = grid.cell_fluxes()
        # C turns against the azimuth of the frame: put the planes in rising order of azimuth
        azimuth = np.radians(-planes[::-1])
        running = np.cumsum(fluxes[:, ::-1].ravel())
        total = running[-1]
        return self._add(
            np.array([fluxes.shape[0], fluxes.shape[1]]),
            np.radians(grid.gamma_deg),
            azimuth,
            running / total,
            values[:, ::-1],
            np.array([total]),
        )

    def add_ring(self) -> int:
        """A tilted ring needs no table, but the engine that knows of it."""
        return self._add(np.zeros(1))

    def add_own(self, numbers: Sequence[float]) -> int:
        """Place of the numbers of a kind that the engine does not know, and how many."""
        own = np.asarray(numbers, np.float64).ravel()
        return self._add(np.array([len(own)]), own)

    def add_picture(self, linear_rgb: Array) -> int:
        """Place of a picture (rows, columns, 3), linear, row 0 at the bottom."""
        height, width = linear_rgb.shape[:2]
        if height * width > LARGEST_PICTURE:
            raise SceneError(
                f"a picture of {width} x {height} pixels is too large to emit; scale it down to "
                f"{LARGEST_PICTURE:,} pixels"
            )
        channels = linear_rgb @ self._basis()
        flux = channels.sum(axis=2)
        if not flux.max() > 0.0:
            raise SceneError("the picture is black everywhere")
        running = np.cumsum(flux.ravel())
        colors = channels / np.where(flux > 0.0, flux, 1.0)[:, :, None]
        first = self._add(np.array([width, height]), running / running[-1], colors)
        self.means[first] = channels.sum(axis=(0, 1)) / flux.sum()
        return first

    def _basis(self) -> Array:
        """(3, C) light in the channels of one unit of R, G and B."""
        if self.rgb:
            return np.eye(3)
        from tracer.optics.spectrum import rgb_spectrum

        spectra = [rgb_spectrum(row) for row in np.eye(3)]
        return np.array([item.power * item.channel_shares(self.wavelengths) for item in spectra])

    def colors(self, rgb: Array) -> tuple[Integers, Array]:
        """Colours of rays that look like linear sRGB (n, 3): codes, and rows of a palette.

        Shares of R, G and B are rounded to 1/64, so that the palette stays small.
        """
        total = rgb.sum(axis=1, keepdims=True)
        shares = np.where(total > 0.0, rgb / np.where(total > 0.0, total, 1.0), 1.0 / 3.0)
        steps, inverse = np.unique(np.round(64.0 * shares), axis=0, return_inverse=True)
        channels = steps @ self._basis()
        palette = channels / channels.sum(axis=1, keepdims=True)
        return (-2 - inverse.reshape(-1)).astype(np.int64), palette

    def add_list(self, light: PooledList, turns: Integers, pattern: int) -> int:
        """Place of a list of rays, whose source has its ``turns`` in the ``pattern``."""
        n = len(light.flux)
        rows = np.empty((n, 7), np.float32)
        rows[:, 0:3], rows[:, 3:6], rows[:, 6] = light.positions, light.directions, light.color
        first_row = self.n_rays
        self.rays.append(rows)
        self.n_rays += n
        even = bool(np.all(light.flux == light.flux[0]))
        ranks = np.full(pattern, -1.0)
        ranks[turns] = np.arange(len(turns))
        running = np.zeros(0) if even else np.cumsum(light.flux) / light.flux.sum()
        palette = self.size + 7 + pattern + len(running)
        head = [first_row, n, even, light.in_order, len(turns), pattern, palette]
        first = self._add(np.array(head, float), ranks, running, light.palette)
        if (light.color != -1).all():
            shares = self._shares(light)
            self.means[first] = light.flux @ shares / light.flux.sum()
        return first

    def _shares(self, light: PooledList) -> Array:
        """(n, C) colours of rays that have one."""
        single = np.eye(len(self.wavelengths))
        table = np.concatenate((single, light.palette.reshape(-1, len(single))))
        return table[np.where(light.color >= 0, light.color, len(single) - 2 - light.color)]

    def by_power(self, light: PooledList, efficacy: Array) -> PooledList:
        """A list whose fluxes are lumens, with those that its rays have as shares of channels."""
        if (light.color == -1).any():
            return light
        seen = self._shares(light) @ efficacy
        flux = np.divide(light.flux, seen, out=np.zeros(len(seen)), where=seen > 0.0)
        return replace(light, flux=flux)

    def finish(self) -> tuple[Array | None, NDArray[np.float32] | None]:
        """The pool and the rays, None where no source needs them."""
        rays = np.concatenate(self.rays) if self.rays else np.zeros((0, 7), np.float32)
        if not self.parts:
            return None, None
        return np.concatenate(self.parts), rays
