"""Beams of vignetted fields: the ellipses that their light fills."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.optics.frames import turn_to

__all__ = ["Ellipse", "beam_of", "cone_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipse:
    """What a beam fills.

    Attributes
    ----------
    middle : (3,) of a beam where its axis crosses the plane of the given points; of a cone its axis
    half : half axes, of a beam [length unit], of a cone of sin(theta / 2)
    turn_deg : from the first axis of the frame that turns +z to the axis, to the first half axis
    """

    middle: Array
    half: tuple[float, float]
    turn_deg: float


def beam_of(point: Array, d: Array, edge: Array, angles: Array) -> Ellipse:
    """Of a parallel beam.

    Parameters
    ----------
    point, d : (3,) a point on its axis, and its unit direction
    edge : (n, 3) points that rays at the edge pass
    angles : (n,) of these around the pupil [rad]
    """
    across = turn_to(d)[:, :2]
    middle, half, turn = _fitted((edge - point) @ across, angles)
    return Ellipse(middle=point + across @ middle, half=half, turn_deg=turn)


def cone_of(d: Array, edge: Array, angles: Array) -> Ellipse:
    """Of rays from a point, by Lambert's azimuthal projection, which keeps solid angles.

    Parameters
    ----------
    d : (3,) unit direction within the cone
    edge : (n, 3) unit directions of rays at its edge
    angles : (n,) of these around the pupil [rad]
    """
    half, turn = (0.0, 0.0), 0.0
    # The axis moves to the middle of what it sees
    for _ in range(4):
        frame = turn_to(d)
        along = edge @ frame
        flat = along[:, :2] / np.sqrt(2.0 * (1.0 + along[:, 2:]))
        middle, half, turn = _fitted(flat, angles)
        r2 = float(middle @ middle)
        d = frame @ np.array([*(2.0 * math.sqrt(1.0 - r2) * middle), 1.0 - 2.0 * r2])
    return Ellipse(middle=d, half=half, turn_deg=turn)


def _fitted(places: Array, angles: Array) -> tuple[Array, tuple[float, float], float]:
    """Middle, half axes and turn of the ellipse that is nearest to places at angles of a circle."""
    columns = np.column_stack([np.ones(len(angles)), np.cos(angles), np.sin(angles)])
    fitted = np.linalg.lstsq(columns, places, rcond=None)[0]
    axes, half, _ = np.linalg.svd(fitted[1:].T)
    turn = math.degrees(math.atan2(axes[1, 0], axes[0, 0]))
    return fitted[0], (float(half[0]), float(half[1])), turn
