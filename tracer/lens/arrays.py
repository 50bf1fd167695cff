"""The flat arrays between the compiled trees and Python: rays in, nodes and exits out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel
from tracer.lens.shape import LensShape

__all__ = [
    "NodeArrays",
    "RayArrays",
    "TreeOptions",
    "empty_nodes",
    "starting_distance",
    "to_lens",
    "to_world",
]

Real = NDArray[np.float64]


class RayArrays(NamedTuple):
    """Rays sent into a lens.

    ``medium`` is a row of the tables of outside index, glass index and absorption [1/mm];
    ``frame`` holds the lens's axes x, y, z as rows, in world coordinates, then its origin.
    """

    origin: Real
    direction: Real
    field: NDArray[np.complex128]
    flux: Real
    path: Real
    medium: NDArray[np.int32]
    outside_index: Real
    glass_index: Real
    absorption: Real
    frame: Real


class TreeOptions(NamedTuple):
    """How a tree is grown; see `tracer.lens.forward.trace_lens`."""

    depth: int
    rules: int
    keep_reflection: bool
    keep_backward: bool
    min_share: float
    path_from_origin: bool


class NodeArrays(NamedTuple):
    """Nodes of the trees: row ray, column level - 1. Unused places hold face -1 and zeros.

    A node is a hit of a face; where light leaves the lens there, ``flux`` is positive and
    direction, field, path, tube and half_waves describe the exit. Per ray: what the glass and the
    rim absorbed, what suppressed exits carried, what was still inside after the last level.
    """

    face: NDArray[np.int8]
    half_waves: NDArray[np.int8]
    point: Real
    direction: Real
    field: NDArray[np.complex128]
    flux: Real
    path: Real
    tube: Real
    absorbed_glass: Real
    absorbed_rim: Real
    suppressed: Real
    remainder: Real
    status: NDArray[np.int8]


def empty_nodes(n_rays: int, depth: int, *, polarized: bool) -> NodeArrays:
    """Room for the trees of a batch; the compiled trees fill every place."""
    nodes = (n_rays, depth)
    field_shape = (*nodes, 3) if polarized else (0, 0, 3)
    extra = nodes if polarized else (0, 0)
    return NodeArrays(
        face=np.empty(nodes, np.int8),
        half_waves=np.empty(extra, np.int8),
        point=np.empty((*nodes, 3)),
        direction=np.empty((*nodes, 3)),
        field=np.empty(field_shape, np.complex128),
        flux=np.empty(nodes),
        path=np.empty(nodes),
        tube=np.empty(extra),
        absorbed_glass=np.empty(n_rays),
        absorbed_rim=np.empty(n_rays),
        suppressed=np.empty(n_rays),
        remainder=np.empty(n_rays),
        status=np.empty(n_rays, np.int8),
    )


@inner_kernel
def to_lens(frame: Real, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Components of a world vector along the axes of the lens."""
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@inner_kernel
def to_world(frame: Real, x: float, y: float, z: float) -> tuple[float, float, float]:
    """World components of a vector given along the axes of the lens."""
    return (
        frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z,
        frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z,
        frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z,
    )


@inner_kernel
def starting_distance(
    shape: LensShape, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> float:
    """Distance that a ray from far away can be moved towards the lens without reaching it.

    Roots of a quadratic taken from far away would lose digits.
    """
    reach = (
        shape.semi_aperture_front
        + shape.semi_aperture_back
        + 2.0 * shape.thickness
        + abs(shape.edge_front)
        + abs(shape.edge_back)
    )
    distance = -(x * dx + y * dy + z * dz) - reach
    return distance if distance > 0.0 else 0.0
