"""Thin sheets: light goes straight on, or is absorbed; filters, polarisers, retarders."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, FailFast, Field

from raymap.jit.kernels import lean_kernel
from raymap.laws.jones import POLARISER, RETARDER, STRAIGHT, JonesRow
from raymap.laws.law import ByChannel, InChannels, Law, Shares, constant
from raymap.optics.fresnel import cos2_refracted

__all__ = ["FilterLaw", "PolariserLaw", "RetarderLaw", "filter_transmittance"]

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

    def jones(self, channels: InChannels) -> JonesRow | None:
        return JonesRow(form=STRAIGHT, numbers=np.zeros((len(channels.wavelengths_nm), 0)))


def _of_unit_length(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if abs(math.hypot(*axis) - 1.0) > 1e-9:
        raise ValueError("an axis is a unit vector")
    return axis


Axis = Annotated[tuple[float, float, float], AfterValidator(_of_unit_length)]


class PolariserLaw(Law):
    """A sheet that absorbs the vibration along an axis; light goes straight on.

    Attributes
    ----------
    absorbs : unit vector of the scene; the vibration across both it and the ray passes
    extinction : share of the absorbed vibration that gets through
    transmittance : of the vibration that passes, by channel
    """

    law: Literal["polariser"] = "polariser"
    absorbs: Axis
    extinction: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    transmittance: ByChannel

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        through = 0.5 * (1.0 + self.extinction) * constant(self.transmittance, cos_i)
        return np.zeros(through.shape), through

    def jones(self, channels: InChannels) -> JonesRow | None:
        rows = [[*self.absorbs, self.extinction, clear] for clear in self.transmittance]
        return JonesRow(form=POLARISER, numbers=np.array(rows))


class RetarderLaw(Law):
    """A sheet that delays the vibration along an axis; light goes straight on.

    Attributes
    ----------
    slow : unit vector of the scene; as much of it as lies across the ray is the slow axis
    retardance_nm : difference of optical paths, by channel
    """

    law: Literal["retarder"] = "retarder"
    slow: Axis
    retardance_nm: Annotated[tuple[float, ...], FailFast()]

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        through = np.ones((len(n_i), len(cos_i)))
        return np.zeros(through.shape), through

    def jones(self, channels: InChannels) -> JonesRow | None:
        rows = [
            [*self.slow, 2.0 * math.pi * path / float(nm)]
            for path, nm in zip(self.retardance_nm, channels.wavelengths_nm, strict=True)
        ]
        return JonesRow(form=RETARDER, numbers=np.array(rows))


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
