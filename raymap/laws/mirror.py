"""Mirrors: of a constant reflectance, or of a metal by its complex index n + i kappa."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import FailFast, Field, model_validator

from raymap.laws.law import ByChannel, InChannels, Law, Shares, constant
from raymap.laws.radial import RadialScatter
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


def metal_shares(n_i: F64, n: tuple[float, ...], k: tuple[float, ...], cos_i: F64) -> F64:
    """(n_channels, n_angles) reflectance of a metal."""
    rows = [
        [fresnel_conductor(float(outside), a, b, float(cosine)) for cosine in cos_i]
        for outside, a, b in zip(n_i, n, k, strict=True)
    ]
    return np.array(rows, np.float64).reshape(len(n), len(cos_i))
