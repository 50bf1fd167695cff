"""Retroreflectors: light goes back where it came from, within a cone."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.jit.kernels import lean_kernel
from raymap.laws.law import ByChannel, InChannels, Law, Shares, constant

__all__ = ["RetroreflectorLaw", "pdf_retro"]

F64 = NDArray[np.float64]


class RetroreflectorLaw(Law):
    """Reflectance by channel, and the half angle of the cone."""

    law: Literal["retroreflector"] = "retroreflector"
    reflectance: ByChannel
    spread_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 0.0

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        back = constant(self.reflectance, cos_i)
        return back, np.zeros(back.shape)


@lean_kernel
def pdf_retro(
    wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float, wo_z: float, cos_spread: float
) -> float:
    """Density of directions per solid angle, mirrored to the front; 0 for an exact one."""
    if cos_spread >= 1.0 or wo_z <= 0.0:
        return 0.0
    across = wi_x * wo_x + wi_y * wo_y
    density = 1.0 / (2.0 * math.pi * (1.0 - cos_spread))
    total = density if across + wi_z * wo_z >= cos_spread else 0.0
    if across - wi_z * wo_z >= cos_spread:
        total += density
    return total
