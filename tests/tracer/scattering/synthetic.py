"""Synthetic measurements for the tests of the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tracer.scattering.fits.problem import WavelengthProblem
from tracer.scattering.measured.measurement import FluxTable
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_exact import reflectance_transmittance

__all__ = ["DENSE", "DENSE_PLATES", "CLEAR", "CLEAR_PLATES", "flux_table", "problem_of"]

DENSE = ScatteringMedium(mean_free_path_mm=0.06, absorption_per_mm=0.01, g=0.5, gamma=2.5)
DENSE_PLATES = (1.53, 1.98, 3.15)
CLEAR = ScatteringMedium(mean_free_path_mm=0.35, absorption_per_mm=0.01, g=0.35, gamma=10.0)
CLEAR_PLATES = (2.05, 3.06, 3.63)
ANGLES = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0)
WEIGHTS = {45.0: 0.5, 60.0: 0.0}


def flux_table(
    medium: ScatteringMedium,
    plates: Sequence[float],
    *,
    angles: Sequence[float] = ANGLES,
    noise: float = 0.0,
    random: np.random.Generator | None = None,
    error: float = 0.05,
    wavelength_nm: float = 550.0,
) -> FluxTable:
    """R and T of the exact model with independent relative noise."""
    out = reflectance_transmittance(medium, plates, angles, nodes=32)
    plate, angle = np.meshgrid(plates, angles, indexing="ij")
    n = plate.size

    def measured(values: NDArray[np.float64]) -> NDArray[np.float64]:
        draws = random.standard_normal(n) if random is not None else np.zeros(n)
        return np.asarray(values.ravel() * (1.0 + noise * draws))

    return FluxTable(
        thickness_mm=plate.ravel(),
        wavelength_nm=np.full(n, wavelength_nm),
        incidence_deg=angle.ravel(),
        reflectance=measured(out.reflectance),
        transmittance=measured(out.transmittance),
        reflectance_error=np.full(n, error),
        transmittance_error=np.full(n, error),
    )


def problem_of(flux: FluxTable, *, equal_weights: bool = False) -> WavelengthProblem:
    weights = np.array(
        [1.0 if equal_weights else WEIGHTS.get(float(a), 1.0) for a in flux.incidence_deg]
    )
    return WavelengthProblem(flux=flux, index=1.49, weights=np.concatenate((weights, weights)))
