"""Which faces a ray can meet next, found once per scene from boxes that surely hold the faces.

A ray that leaves a face starts inside that face's box. If it does not go back along some axis, it
cannot meet what lies behind the box on that axis; and it travels at least the distance of both
boxes to meet a face. Both statements hold for every ray, so a list sorted by that distance may be
left as soon as all rays have met something nearer than the rest of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.kinds import MESH, SPHERE
from tracer.geometry.shapes import Shape

__all__ = ["find_candidates", "main_axis"]

Array = NDArray[np.float64]


def find_candidates(
    shapes: Sequence[Shape], sources: Sequence[tuple[Array, Array, Array]]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Candidate lists of all departures: first, face, distance.

    A *departure* is 2 x face (+1 for directions along the face's main axis), then one per source,
    then one for rays that start in a medium. The faces of departure k are entries first[k] to
    first[k + 1], with a lower bound of their distance, nearest first.

    Parameters
    ----------
    shapes : all faces; those of meshes are departures, but no candidates
    sources : per source the box that it emits from and the direction of its beam (zero: any)
    """
    n = len(shapes)
    boxes = [shape.bounds() for shape in shapes]
    low = np.array([box[0] for box in boxes]).reshape(n, 3)
    high = np.array([box[1] for box in boxes]).reshape(n, 3)
    analytic = np.array([shape.kind != MESH for shape in shapes], bool)
    axes = np.array([main_axis(shape) for shape in shapes], np.int32)
    lists, distances = [], []

    def add(start_low: Array, start_high: Array, signs: Array, own: int = -1) -> None:
        ahead = np.ones(n, bool)
        for axis in range(3):
            if signs[axis] > 0:
                ahead &= high[:, axis] >= start_low[axis]
            elif signs[axis] < 0:
                ahead &= low[:, axis] <= start_high[axis]
        ahead &= analytic
        if own >= 0 and shapes[own].kind < SPHERE:
            ahead[own] = False
        gap = np.maximum(0.0, np.maximum(low - start_high, start_low - high))
        distance = np.linalg.norm(gap, axis=1) * (1.0 - 1e-12)
        order = np.argsort(distance, kind="stable")
        order = order[ahead[order]]
        lists.append(order)
        distances.append(distance[order])

    for face in range(n):
        for sign in (-1, 1):
            signs = np.zeros(3)
            signs[axes[face]] = sign
            add(low[face], high[face], signs, face)
    for start_low, start_high, beam in sources:
        add(start_low, start_high, np.sign(np.where(np.abs(beam) < 1e-12, 0.0, beam)))
    everywhere = np.full(3, np.inf)
    add(-everywhere, everywhere, np.zeros(3))
    return (
        np.concatenate(([0], np.cumsum([len(item) for item in lists]))).astype(np.int64),
        np.concatenate(lists).astype(np.int64),
        np.concatenate(distances),
    )


def main_axis(shape: Shape) -> int:
    """Coordinate axis nearest to the axis or normal of a face."""
    return int(np.argmax(np.abs(shape.row()[3:6])))
