"""Unnormalised sums of sets of rays, and their flux (`raymap.optics.fluxes`).

The rays that count as emitted are those of the portions served. Where one emission becomes several
rays, weights are summed per emission before they are squared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory
from raymap.model.errors import RayMapError
from raymap.model.rows import squares_by_emission
from raymap.optics.fluxes import flux_per_ray, variances

__all__ = [
    "Estimate",
    "Tally",
    "estimate",
    "source_factors",
    "sums",
]

Ints = NDArray[np.integer]
Floats = NDArray[np.float64]


_MOST = 1e70
"""No sum of weights is larger, which are float32, or flux of a source: squares of both, and their
product, are numbers."""


@dataclass(frozen=True)
class Estimate:
    """A flux [flux unit of the map] with its standard error.

    ``bound_95``: where no ray matched, the flux is below this with 95 % confidence; else None.
    """

    flux: float
    se: float
    bound_95: float | None = None


@dataclass(frozen=True, eq=False)
class Tally:
    """Counts and sums of weights per source, or per label: (n,) int64, (n,) and (n,) float64."""

    rays: NDArray[np.int64]
    sum_w: Floats
    sum_w2: Floats

    def __post_init__(self) -> None:
        """Refuse sums that no rays have: from here on nothing overflows.

        Raises
        ------
        RayMapError
        """
        for sums, most in ((self.sum_w, _MOST), (self.sum_w2, _MOST**2)):
            if not (np.abs(sums) <= most).all():
                raise RayMapError(
                    "the weights of the rays do not add up to a number: the file states sums that "
                    "no rays have; raymap verify says where, raymap repair saves the rest"
                )

    @classmethod
    def zeros(cls, size: int) -> Tally:
        return cls(np.zeros(size, np.int64), np.zeros(size), np.zeros(size))

    @classmethod
    def of_paths(cls, labels: Ints, rays: Ints, sum_w: Floats, sum_w2: Floats, size: int) -> Tally:
        """Sum entries by label."""
        counts = np.bincount(labels, rays, size).astype(np.int64)
        return cls(counts, sums(labels, sum_w, size), sums(labels, sum_w2, size))

    @classmethod
    def of_rays(
        cls,
        labels: Ints,
        weight: Floats | None,
        emission: Ints | None,
        size: int,
    ) -> Tally:
        """Count rays by label; ``weight`` None: all 1; ``emission`` groups rays of one emission."""
        rays = np.bincount(labels, minlength=size)
        if weight is None:
            weight = np.ones(len(labels)) if emission is not None else None
        if weight is None:
            ones = rays.astype(np.float64)
            return cls(rays, ones, ones)
        sum_w = sums(labels, weight, size)
        return cls(rays, sum_w, squares_by_emission(labels, weight, emission, size))

    def part(self, chosen: slice | Ints) -> Tally:
        """Some of the sources or labels."""
        return Tally(self.rays[chosen], self.sum_w[chosen], self.sum_w2[chosen])

    def __add__(self, other: Tally) -> Tally:
        return Tally(self.rays + other.rays, self.sum_w + other.sum_w, self.sum_w2 + other.sum_w2)

    def __sub__(self, other: Tally) -> Tally:
        return Tally(self.rays - other.rays, self.sum_w - other.sum_w, self.sum_w2 - other.sum_w2)


def sums(labels: Ints, values: Floats, size: int) -> Floats:
    """Sum of the values of each label."""
    result: Floats = np.bincount(labels, values, size).astype(np.float64, copy=False)
    return result


def source_factors(directory: Directory, emitted: Ints) -> Floats:
    """(n_sources,) flux of a ray of weight 1; 0 where a source emitted nothing.

    Raises
    ------
    RayMapError
        A flux is too large for sums.
    """
    flux = np.array([source.flux for source in directory.sources], np.float64)
    if not (flux <= _MOST).all():
        source = directory.sources[int(np.argmin(flux <= _MOST))]
        raise RayMapError(
            f"source {source.name!r} is said to emit {source.flux:g} {directory.flux_unit}, which "
            "no sum can hold: the file is damaged, or was made up"
        )
    return flux_per_ray(flux, emitted)


def estimate(tally: Tally, directory: Directory, emitted: Ints) -> Estimate:
    """Flux of a tally by source."""
    factors = source_factors(directory, emitted)
    flux = float(factors @ tally.sum_w)
    variance = float(variances(factors, emitted, tally.sum_w, tally.sum_w2).sum())
    bound = None
    if not tally.rays.any():
        bound = 3.0 * float(factors.max(initial=0.0))
    return Estimate(flux, variance**0.5, bound)
