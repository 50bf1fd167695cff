"""Mirrors: of a constant reflectance, or of a metal by its complex index n + i kappa."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import FailFast, Field, model_validator

from raymap.jit.kernels import lean_kernel
from raymap.laws.jones import EVEN_MIRROR, METAL, JonesRow
from raymap.laws.law import ByChannel, InChannels, Law, Shares, constant
from raymap.laws.microfacet_losses import (
    average_conductor_reflectance,
    conductor_table,
    multiple_reflectance,
)
from raymap.laws.radial import RadialScatter, scatter_tables
from raymap.optics.fresnel import fresnel_conductor

__all__ = ["MirrorLaw", "metal_shares"]

F64 = NDArray[np.float64]
Numbers = Annotated[tuple[Annotated[float, Field(ge=0.0)], ...], FailFast()]


class MirrorLaw(Law):
    """A mirror; what it does not reflect is absorbed.

    Attributes
    ----------
    reflectance : by channel; or
    n, k : of the metal, by channel
    roughness : GGX roughness, 0 smooth
    scatter : takes its share of the specular light
    """

    law: Literal["mirror"] = "mirror"
    reflectance: ByChannel = ()
    n: Numbers = ()
    k: Numbers = ()
    roughness: Annotated[float, Field(ge=0.0)] = 0.0
    scatter: RadialScatter | None = None

    @model_validator(mode="after")
    def _check(self) -> MirrorLaw:
        if bool(self.reflectance) == bool(self.n) or len(self.n) != len(self.k):
            raise ValueError("a mirror has a reflectance, or as many n as k")
        return self

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        """At a facet, where the mirror is rough."""
        if self.reflectance:
            reflected = constant(self.reflectance, cos_i)
        else:
            reflected = metal_shares(n_i, self.n, self.k, cos_i)
        return reflected, np.zeros(reflected.shape)

    def jones(self, channels: InChannels) -> JonesRow | None:
        columns = [self.reflectance] if self.reflectance else [self.n, self.k]
        numbers = np.column_stack([*columns, np.zeros(len(columns[0]))])
        if self.roughness > 0.0:
            table = conductor_table(self.roughness)
            averages = self.reflectance or [
                average_conductor_reflectance(1.0, n, k)
                for n, k in zip(self.n, self.k, strict=True)
            ]
            numbers[:, -1] = [multiple_reflectance(average, table) for average in averages]
        return JonesRow(
            form=EVEN_MIRROR if self.reflectance else METAL,
            numbers=numbers,
            roughness=self.roughness,
            scatter=scatter_tables(self.scatter, channels.wavelengths_nm),
        )


def metal_shares(n_i: F64, n: tuple[float, ...], k: tuple[float, ...], cos_i: F64) -> F64:
    """(n_channels, n_angles) reflectance of a metal."""
    found = np.empty((len(n), len(cos_i)))
    for channel, (outside, a, b) in enumerate(zip(n_i, n, k, strict=True)):
        _fill_reflectance(float(outside), a, b, np.asarray(cos_i, np.float64), found[channel])
    return found


@lean_kernel
def _fill_reflectance(n_i: float, n: float, k: float, cos_i: F64, found: F64) -> None:
    for i in range(len(cos_i)):
        found[i] = fresnel_conductor(n_i, n, k, cos_i[i])
