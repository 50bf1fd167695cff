"""The polarising microscope through real lenses: rays from the source to the screen.

Every element is a function from rays to rays: `Polarizer`, `Retarder`, `Diaphragm` from
`tracer.optics.polarization_elements`, and here a lens (its direct transmission, or more levels), a
plate, a screen. `run_train` sends rays through a list of them; rays that an element stops, or that
leave the tube, are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tracer.lens import Lens, trace_lens
from tracer.optics.crystals.plates import plate_jones
from tracer.optics.polarization_elements import retard, to_plane
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays
from tracer.studies.microscopy.specimens import CrystalPlate

__all__ = ["LensStage", "MapStage", "PlateStage", "Screen", "run_train"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

Element = Callable[[PolarizedRays], PolarizedRays]


def run_train(rays: PolarizedRays, elements: Sequence[Element]) -> PolarizedRays:
    """The rays that come through all elements, in order."""
    for element in elements:
        if len(rays) == 0:
            return rays
        rays = element(rays)
    return rays


@dataclass(frozen=True, kw_only=True)
class LensStage:
    """A lens in the train.

    Attributes
    ----------
    lens : it must stand where the rays come from
    levels : of its tree that go on along the train; (2,) is the direct transmission, (2, 4) also
        the ghost of two inner reflections
    """

    lens: Lens
    levels: tuple[int, ...] = (2,)

    def __call__(self, rays: PolarizedRays) -> PolarizedRays:
        """The light behind the lens."""
        tree = trace_lens(self.lens, rays, depth=max(self.levels))
        exits = tree.exits()
        chosen = np.isin(exits.level, self.levels) & (exits.direction @ self.lens.frame[2] > 0.0)
        return tree.exit_rays(exits).where(chosen)


@dataclass(frozen=True, kw_only=True)
class PlateStage:
    """A crystal plate across the z axis, its front at ``z``.

    Rays keep their directions. Each takes the Jones matrix of its own direction, whose phase refers
    to the point of the back face right behind the point of incidence; the sideways walk of the
    light within the plate, less than its thickness, is left out.
    """

    plate: CrystalPlate
    z: float

    def __call__(self, rays: PolarizedRays) -> PolarizedRays:
        """The light behind the plate."""
        n = self.plate.index_outside
        there = to_plane(rays, (0.0, 0.0, self.z), (0.0, 0.0, 1.0), index=n)
        d = there.direction
        # s = d x n / |d x n|, n against the ray; along y at normal incidence
        across = np.stack([-d[:, 1], d[:, 0], np.zeros(len(d))], axis=1)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        s = np.where(length > 1e-12, across / np.where(length > 0.0, length, 1.0), [0.0, 1.0, 0.0])
        s = s - np.sum(s * d, axis=1, keepdims=True) * d
        p = np.cross(d, s)
        before = np.stack(
            [np.sum(there.field * s, axis=1), np.sum(there.field * p, axis=1)], axis=1
        )
        after = np.empty_like(before)
        for wavelength in np.unique(there.wavelengths):
            at = there.wavelengths == wavelength
            matrix, _ = plate_jones(
                self.plate.crystal, n * d[at, 0], n * d[at, 1], self.plate.thickness_mm,
                float(wavelength), n_before=n, n_after=n, basis="sp", levels=self.plate.levels,
            )  # fmt: skip
            after[at] = np.einsum("nij,nj->ni", matrix, before[at])
        moved = there.origin + np.array([0.0, 0.0, self.plate.thickness_mm])
        return replace(there, origin=moved, field=after[:, :1] * s + after[:, 1:] * p)


@dataclass(frozen=True, kw_only=True)
class MapStage:
    """A thin specimen whose path difference and slow vibration change from point to point.

    Attributes
    ----------
    path_difference_nm, slow_deg : functions of the coordinates (x, y) [mm]
    z : of its plane
    """

    path_difference_nm: Callable[[Real, Real], Real]
    slow_deg: Callable[[Real, Real], Real]
    z: float

    def __call__(self, rays: PolarizedRays) -> PolarizedRays:
        """The light behind the specimen."""
        there = to_plane(rays, (0.0, 0.0, self.z), (0.0, 0.0, 1.0))
        x, y = there.origin[:, 0], there.origin[:, 1]
        angle = np.deg2rad(self.slow_deg(x, y))
        slow = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        delta = 2.0 * math.pi * self.path_difference_nm(x, y) / there.wavelengths
        return there.with_field(retard(there.field, there.direction, slow, delta))


@dataclass(frozen=True, kw_only=True)
class Screen:
    """A square screen across the z axis that collects flux.

    Attributes
    ----------
    z : of its plane
    half_size : half a side [mm]
    pixels : along a side
    """

    z: float
    half_size: float
    pixels: int = 128

    def __post_init__(self) -> None:
        if not self.half_size > 0.0 or self.pixels < 1:
            raise PolarizationError("a screen has a positive half_size and at least one pixel")

    def __call__(self, rays: PolarizedRays) -> PolarizedRays:
        """The rays where they meet the plane of the screen."""
        return to_plane(rays, (0.0, 0.0, self.z), (0.0, 0.0, 1.0))

    def collect(self, rays: PolarizedRays) -> Real:
        """(pixels, pixels) flux of rays on the screen, incoherent; row i counts upward in y."""
        return self._sum(rays, rays.flux)

    def count(self, rays: PolarizedRays) -> Real:
        """(pixels, pixels) rays that arrive."""
        return self._sum(rays, np.ones(len(rays)))

    def _sum(self, rays: PolarizedRays, weights: Real) -> Real:
        side = np.linspace(-self.half_size, self.half_size, self.pixels + 1)
        total, _, _ = np.histogram2d(
            rays.origin[:, 1], rays.origin[:, 0], bins=(side, side), weights=weights
        )
        return np.asarray(total)
