"""Ideal diffusers, which send light to all directions alike, back and through."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from raymap.laws.law import ByChannel, InChannels, Law, Shares, constant

__all__ = ["LambertianLaw", "eval_lambert"]

F64 = NDArray[np.float64]


class LambertianLaw(Law):
    """Shares by channel that are scattered back and through."""

    law: Literal["lambertian"] = "lambertian"
    reflectance: ByChannel
    transmittance: ByChannel = ()

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        back = constant(self.reflectance, cos_i)
        through = constant(self.transmittance or (0.0,) * len(back), cos_i)
        return back, through


@lean_kernel
def eval_lambert(albedo: float) -> float:
    """BSDF of an ideal diffuser that scatters the share ``albedo`` to this side [1/sr]."""
    return albedo / math.pi
