"""The cleavage rhombohedron of calcite."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Positive
from tracer.geometry.shapes import Polygon

__all__ = ["RhombBody", "cleavage_edges"]

Array = NDArray[np.float64]

_OBTUSE = np.radians(101.0 + 55.0 / 60.0)
"""Obtuse plane angle of the faces of the cleavage rhombohedron of calcite."""


def cleavage_edges(edge: float) -> Array:
    """(3, 3) the edges from a blunt corner, one per row; the face of the first two lies level.

    Their sum is the optic axis: the three make obtuse angles with each other about it.
    """
    cosine = np.cos(_OBTUSE)
    height = np.sqrt((1.0 + 2.0 * cosine) / 3.0)
    radius = np.sqrt(1.0 - height * height)
    azimuth = np.radians([90.0, 210.0, 330.0])
    edges = np.column_stack(
        [radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(3, height)]
    )
    # Turn the face of the first two down, by the smallest rotation
    up = np.cross(edges[0], edges[1])
    up /= np.linalg.norm(up)
    v = np.cross(up, [0.0, 0.0, 1.0])
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    turn = np.eye(3) + k + k @ k / (1.0 + up[2])
    turned: Array = edge * edges @ turn.T
    return turned


class RhombBody(Body):
    """A cleavage rhombohedron with edges of length ``edge``.

    It lies on a face below the position, the middle of that face at the position. The optic axis of
    a crystal without ``optic_axis`` or ``axes`` is where nature has it in calcite.
    """

    kind: Literal["rhomb"]
    edge: Positive

    def crystal_axis(self) -> Array:
        _, frame = self.frame()
        axis = cleavage_edges(1.0).sum(axis=0)
        turned: Array = frame @ (axis / np.linalg.norm(axis))
        return turned

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        edges = cleavage_edges(self.edge)
        corner = -0.5 * (edges[0] + edges[1])
        plans = []
        for i, names in enumerate((("side_1", "side_2"), ("side_3", "side_4"), ("top", "bottom"))):
            a, b, c = edges[(i + 1) % 3], edges[(i + 2) % 3], edges[i]
            ring = np.array([corner, corner + a, corner + a + b, corner + b])
            for name, points, outward in ((names[0], ring + c, c), (names[1], ring, -c)):
                turns = np.cross(a, b) @ outward
                faced = points if turns > 0.0 else points[::-1]
                plans.append(FacePlan(name=name, shapes=(Polygon(origin + faced @ frame.T),)))
        return plans


KINDS = (RhombBody,)
