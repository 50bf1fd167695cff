"""A scattering medium as the volume-scattering studies speak of it, and what follows from it.

Lengths are millimetres throughout this package; a scene in another unit converts at its door.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError

__all__ = ["ScatteringMedium"]


@dataclass(frozen=True, kw_only=True)
class ScatteringMedium:
    """Free paths, phase function and refractive index at one wavelength.

    Parameters
    ----------
    mean_free_path_mm : m, mean path between two scatterings [mm]; inf: no scattering
    absorption_per_mm : p, absorption per path [1/mm]
    g : shape parameter of the phase function, -1 < g < 1
    gamma : exponent of A / (1 + g² - 2 g cos theta)^gamma; 3/2 is Henyey–Greenstein
    index : refractive index; the medium around it is air
    moments : Legendre moments <P_l> of another phase function, (n,) with moments[0] = 1; they
        replace g and gamma in the exact model
    """

    mean_free_path_mm: float
    absorption_per_mm: float = 0.0
    g: float = 0.0
    gamma: float = 1.5
    index: float = 1.49
    moments: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        checks = (
            (self.mean_free_path_mm > 0.0, "mean_free_path_mm", "must be > 0 (inf: none)"),
            (0.0 <= self.absorption_per_mm < math.inf, "absorption_per_mm", "must be >= 0"),
            (-1.0 < self.g < 1.0, "g", "must lie between -1 and 1, exclusive"),
            (math.isfinite(self.gamma), "gamma", "must be a finite number"),
            (1.0 <= self.index < math.inf, "index", "must be >= 1"),
        )
        for good, name, rule in checks:
            if not good:
                raise SceneError(f"scattering medium: {name} {rule}, got {getattr(self, name)}")

    @property
    def scattering_per_mm(self) -> float:
        """Scattering coefficient mu_s = 1 / m [1/mm]."""
        return 1.0 / self.mean_free_path_mm

    @property
    def extinction_per_mm(self) -> float:
        """Scattering and absorption together [1/mm]."""
        return self.scattering_per_mm + self.absorption_per_mm

    @property
    def albedo(self) -> float:
        """Share of scattering in the extinction."""
        extinction = self.extinction_per_mm
        return self.scattering_per_mm / extinction if extinction > 0.0 else 0.0

    @property
    def mean_cosine(self) -> float:
        """<cos theta> of one scattering; equal to g for Henyey–Greenstein only."""
        return float(self.legendre_moments(1)[1])

    @property
    def reduced_scattering_per_mm(self) -> float:
        """Similarity parameter mu_s' = (1 - <cos theta>) / m [1/mm]: what thick plates show."""
        return (1.0 - self.mean_cosine) * self.scattering_per_mm

    def legendre_moments(self, order: int) -> NDArray[np.float64]:
        """Moments <P_l> of the phase function for l = 0 .. order."""
        from tracer.scattering.plates.moments import generalized_moments

        if self.moments is None:
            return generalized_moments(self.g, self.gamma, order)
        given = np.asarray(self.moments, np.float64)
        if given.size <= order:
            raise SceneError(
                f"scattering medium: the exact model needs the Legendre moments up to {order}, "
                f"{given.size - 1} are given"
            )
        return given[: order + 1]
