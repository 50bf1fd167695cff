"""What a local model is: a Python function that says what happens to one ray at a boundary.

The verification suite takes any such function, ours or another's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tracer.optics.crystals.local import solve_interface
from tracer.optics.crystals.media import Crystal

__all__ = ["LocalModel", "OutgoingRay", "raymap_model"]

Real = NDArray[np.float64]
Complex = NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class OutgoingRay:
    """One ray that leaves the boundary.

    Attributes
    ----------
    side : "reflected" or "refracted"
    refraction_vector : (3,) wave normal times refractive index
    direction : (3,) unit ray direction (flow of energy)
    field : (3,) complex E; only its shape and phase relative to the incident field matter
    share : flux through the boundary over the incident flux
    """

    side: Literal["reflected", "refracted"]
    refraction_vector: Real
    direction: Real
    field: Complex
    share: float


class LocalModel(Protocol):
    """The function to verify."""

    def __call__(
        self,
        first: Crystal,
        second: Crystal,
        refraction_vector: Real,
        field: Complex,
        normal: Real,
        wavelength_nm: float,
    ) -> list[OutgoingRay]:
        """Rays that leave the boundary.

        Parameters
        ----------
        first, second : media before and behind it; ``principal_indices(wavelength_nm)``,
            ``orientation``, ``tensor(wavelength_nm)`` describe them
        refraction_vector : (3,) of the incident wave, index times wave normal
        field : (3,) complex E of the incident wave
        normal : (3,) unit, pointing into the second medium
        """


def raymap_model(
    first: Crystal,
    second: Crystal,
    refraction_vector: Real,
    field: Complex,
    normal: Real,
    wavelength_nm: float,
) -> list[OutgoingRay]:
    """Raymap's own local model, one ray at a time."""
    waves = solve_interface(
        first, second, refraction_vector, field, normal, wavelength_nm=wavelength_nm
    )
    rays = []
    for j in range(4):
        if waves.kind[0, j] > 0 and waves.share[0, j] > 0.0:
            rays.append(
                OutgoingRay(
                    side="reflected" if j < 2 else "refracted",
                    refraction_vector=waves.refraction_vector[0, j],
                    direction=waves.direction[0, j],
                    field=waves.field[0, j],
                    share=float(waves.share[0, j]),
                )
            )
    return rays
