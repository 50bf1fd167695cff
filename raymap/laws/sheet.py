"""Thin absorbing sheets: light goes straight on, or is absorbed."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.jit.kernels import lean_kernel
from raymap.laws.law import ByChannel, InChannels, Law, Shares
from raymap.optics.fresnel import cos2_refracted

__all__ = ["FilterLaw", "filter_transmittance"]

F64 = NDArray[np.float64]


class FilterLaw(Law):
    """A filter of an internal transmittance at normal incidence, by channel, and an index."""

    law: Literal["filter"] = "filter"
    transmittance: ByChannel
    index: Annotated[float, Field(gt=0.0)] = 1.5

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        through = np.array(
            [
                [filter_transmittance(t, float(c), float(n), self.index) for c in cos_i]
                for t, n in zip(self.transmittance, n_i, strict=True)
            ],
            np.float64,
        ).reshape(len(n_i), len(cos_i))
        return np.zeros(through.shape), through


@lean_kernel
def filter_transmittance(normal: float, cos_i: float, n_i: float, n_filter: float) -> float:
    """Internal transmittance of a thin absorbing sheet at an angle.

    Parameters
    ----------
    normal : internal transmittance at normal incidence
    cos_i : cosine of the angle of incidence
    n_i, n_filter : indices of the medium around and of the sheet; the path inside is longer by
        1 / cos of the refracted angle
    """
    if normal <= 0.0:
        return 0.0
    square = cos2_refracted(n_i / n_filter, cos_i)
    if square <= 0.0:
        return 0.0
    return float(normal ** (1.0 / math.sqrt(square)))
