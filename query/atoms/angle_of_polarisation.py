"""``angle_of_polarisation < 10 deg``: of the light of the last segment, or at certain points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from query.engine.context import RayContext
from query.engine.recorded import Floats, Ints, Recorded, angles_of, stokes_values

__all__ = ["KINDS", "AngleOfPolarisation", "angle_of_polarisation"]


@dataclass(frozen=True, eq=False)
class AngleOfPolarisation(Recorded):
    """Azimuth of the vibration from the transverse axis x [deg], (-90, 90]."""

    word = "angle_of_polarisation"
    title = "azimuth of the vibration at its end"
    column = "stokes"
    dimension = "angle"
    measured = "an angle of polarisation"
    place = 260

    @classmethod
    def values(cls, context: RayContext, points: Ints | None) -> Floats:
        stokes = stokes_values(context, points)
        if stokes is None:
            return np.full(context.n_rays if points is None else len(points), np.nan)
        return angles_of(stokes)


angle_of_polarisation = AngleOfPolarisation()

KINDS = (AngleOfPolarisation,)
