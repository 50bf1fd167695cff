"""What a fit of one wavelength compares: measured rows, the model at them, parameters in between.

The parameters are (ln mu_s', ln p, atanh g). Plates show mu_s' = (1 - <cos theta>) / m and p; along
g at constant mu_s' they hardly change, so this choice keeps the valley of the objective straight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tracer.scattering.measured.measurement import FluxTable, MeasurementError
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.moments import generalized_moments
from tracer.scattering.plates.plate_exact import ExactPlates

__all__ = ["BOUNDS", "Bounds", "WavelengthProblem", "bounds_hit", "medium_of", "parameters_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Where a fit may go; hitting one is reported, because the data then ask for more."""

    g_low: float = -0.5
    g_high: float = 0.99
    mean_free_path_low_mm: float = 0.01
    absorption_low_per_mm: float = 1e-6
    absorption_high_per_mm: float = 20.0


BOUNDS = Bounds()


def parameters_of(medium: ScatteringMedium) -> Array:
    """(ln mu_s', ln p, atanh g) of a medium."""
    return np.array(
        [
            math.log(medium.reduced_scattering_per_mm),
            math.log(max(medium.absorption_per_mm, BOUNDS.absorption_low_per_mm)),
            math.atanh(medium.g),
        ]
    )


def medium_of(parameters: Array, gamma: float, index: float) -> ScatteringMedium:
    """The medium of (ln mu_s', ln p, atanh g); g gives way where m would fall below its bound."""
    reduced = math.exp(parameters[0])
    g = math.tanh(parameters[2])
    lost = 1.0 - generalized_moments(g, gamma, 1)[1]
    shortest = BOUNDS.mean_free_path_low_mm
    if lost < shortest * reduced < 1.0:
        g = _shape_with_mean_cosine(1.0 - shortest * reduced, gamma)
        lost = shortest * reduced
    return ScatteringMedium(
        mean_free_path_mm=lost / reduced,
        absorption_per_mm=math.exp(parameters[1]),
        g=g,
        gamma=gamma,
        index=index,
    )


def _shape_with_mean_cosine(mean_cosine: float, gamma: float) -> float:
    low, high = BOUNDS.g_low, 0.9999
    for _ in range(60):
        middle = 0.5 * (low + high)
        if generalized_moments(middle, gamma, 1)[1] < mean_cosine:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def bounds_hit(medium: ScatteringMedium) -> tuple[str, ...]:
    """Names of the bounds at which a fitted medium stands."""
    hits = (
        (medium.g >= BOUNDS.g_high - 1e-4, f"g at its upper bound {BOUNDS.g_high:g}"),
        (medium.g <= BOUNDS.g_low + 1e-3, f"g at its lower bound {BOUNDS.g_low:g}"),
        (
            medium.mean_free_path_mm <= BOUNDS.mean_free_path_low_mm * 1.001,
            f"m at its lower bound {BOUNDS.mean_free_path_low_mm:g} mm",
        ),
        (
            medium.absorption_per_mm <= BOUNDS.absorption_low_per_mm * 1.05,
            f"p at its lower bound {BOUNDS.absorption_low_per_mm:g} per mm: none measured",
        ),
        (
            medium.absorption_per_mm >= BOUNDS.absorption_high_per_mm * 0.99,
            f"p at its upper bound {BOUNDS.absorption_high_per_mm:g} per mm",
        ),
    )
    return tuple(text for hit, text in hits if hit)


@dataclass(frozen=True, kw_only=True)
class WavelengthProblem:
    """Rows of one wavelength, ready for many evaluations of the exact model.

    Attributes
    ----------
    flux : measured rows
    index : refractive index
    weights : (2 n,) weight of each value in the objective: R rows, then T rows
    section : polar angles, values, relative errors of the BTDF of the thinnest plate at normal
        incidence; its shape is compared, not its level
    nodes : of the exact model
    """

    flux: FluxTable
    index: float
    weights: Array
    section: tuple[Array, Array, Array] | None = None
    nodes: int = 16
    solver: ExactPlates = field(init=False)
    plates: Array = field(init=False)
    places: tuple[NDArray[np.intp], NDArray[np.intp]] = field(init=False)

    def __post_init__(self) -> None:
        plates, plate = np.unique(self.flux.thickness_mm, return_inverse=True)
        angles, angle = np.unique(self.flux.incidence_deg, return_inverse=True)
        solver = ExactPlates(
            index=self.index,
            incidence_deg=angles,
            section_deg=() if self.section is None else self.section[0],
            nodes=self.nodes,
        )
        object.__setattr__(self, "plates", plates)
        object.__setattr__(self, "places", (plate.ravel(), angle.ravel()))
        object.__setattr__(self, "solver", solver)
        if self.values < 3:
            raise MeasurementError(
                f"{self.values} measured values with weight cannot fix 3 parameters (m, p, g); "
                "measure more angles, plates, or both R and T"
            )

    @property
    def measured(self) -> Array:
        """(2 n,) R rows, then T rows."""
        return np.concatenate((self.flux.reflectance, self.flux.transmittance))

    @property
    def errors(self) -> Array:
        """(2 n,) relative standard errors."""
        return np.concatenate((self.flux.reflectance_error, self.flux.transmittance_error))

    @property
    def used(self) -> NDArray[np.bool_]:
        """(2 n,) values that were measured and count."""
        return np.isfinite(self.measured) & (self.weights > 0.0)

    @property
    def values(self) -> int:
        """How many values count."""
        return int(self.used.sum())

    def predict(self, medium: ScatteringMedium) -> tuple[Array, Array]:
        """(2 n,) model at the rows, and the BTDF section of the thinnest plate."""
        out = self.solver.solve(medium, self.plates)
        model = np.concatenate((out.reflectance[self.places], out.transmittance[self.places]))
        return model, out.btdf[0]

    def shape_residuals(self, section: Array) -> Array:
        """(k,) logarithm of model over measured BTDF, its level taken out, over the errors."""
        if self.section is None:
            return np.zeros(0)
        _, value, error = self.section
        ratio = np.log(np.maximum(section, 1e-12) / value)
        level = np.average(ratio, weights=error**-2)
        return np.asarray((ratio - level) / error)
