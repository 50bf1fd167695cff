"""A ray of the weighted mode at a surface, and what becomes of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raymap.jit.kernels import inline_kernel

__all__ = ["Weighted", "WeightedRay", "with_weight"]


class WeightedRay(NamedTuple):
    """A ray that arrives: its number in the block, whether it has as many points as a ray may have,
    where it is, and its weight."""

    number: int
    deep: bool
    x: float
    y: float
    z: float
    weight: float


Weighted = tuple[int, bool, float, float, float, int, np.uint64, float]
"""A `tracer.surfaces.interaction.Interaction`, and the weight with which the ray goes on."""


@inline_kernel
def with_weight(ray: WeightedRay, weight: float) -> WeightedRay:
    """The ray, of another weight."""
    return WeightedRay(ray.number, ray.deep, ray.x, ray.y, ray.z, weight)
