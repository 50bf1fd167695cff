"""``degree_of_polarisation > 0.9``: of the light of the last segment, or at certain points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from query.engine.context import RayContext
from query.engine.recorded import Floats, Ints, Recorded, degrees_of, stokes_values

__all__ = ["KINDS", "DegreeOfPolarisation", "degree_of_polarisation"]


@dataclass(frozen=True, eq=False)
class DegreeOfPolarisation(Recorded):
    """Polarised share of the light, 0 to 1."""

    word = "degree_of_polarisation"
    title = "polarised share of the light at its end"
    column = "stokes"
    place = 250

    @classmethod
    def values(cls, context: RayContext, points: Ints | None) -> Floats:
        stokes = stokes_values(context, points)
        if stokes is None:
            return np.full(context.n_rays if points is None else len(points), np.nan)
        return degrees_of(stokes)


degree_of_polarisation = DegreeOfPolarisation()

KINDS = (DegreeOfPolarisation,)
