"""Surfaces without numbers of their own: what is bare obeys Fresnel, what is black absorbs."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raymap.laws.jones import BARE, JonesRow
from raymap.laws.law import InChannels, Law, Shares
from raymap.laws.radial import RadialScatter, scatter_tables
from raymap.optics.fresnel import reflectance_column

__all__ = ["AbsorberLaw", "FresnelLaw"]

F64 = NDArray[np.float64]


class FresnelLaw(Law):
    """A bare smooth interface; ``scatter`` takes its share of the specular light."""

    law: Literal["fresnel"] = "fresnel"
    scatter: RadialScatter | None = None

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        reflected = np.stack(
            [reflectance_column(a, b, cos_i) for a, b in zip(n_i, n_o, strict=True)]
        )
        return reflected, 1.0 - reflected

    def jones(self, channels: InChannels) -> JonesRow | None:
        n = len(channels.wavelengths_nm)
        roughness: float = getattr(self, "roughness", 0.0)
        return JonesRow(
            form=BARE,
            numbers=np.zeros((n, 0)),
            roughness=roughness,
            scatter=scatter_tables(self.scatter, channels.wavelengths_nm),
        )


class AbsorberLaw(Law):
    """A black surface."""

    law: Literal["absorber"] = "absorber"

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        nothing = np.zeros((len(n_i), len(cos_i)))
        return nothing, nothing
