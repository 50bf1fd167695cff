"""What surely comes first on the way of every ray."""

from __future__ import annotations

import numpy as np

from tracer.geometry.shapes import Annulus, Cylinder, SphereCap
from tracer.scene.arrangement.precedence import Precedence


def _axes(n: int) -> list[np.ndarray]:
    directions = np.random.default_rng(3).normal(size=(n, 3))
    return [*np.eye(3), *(directions / np.linalg.norm(directions, axis=1)[:, None])]


def test_parts_of_one_plane_do_not_hide_each_other_however_the_plane_is_tilted() -> None:
    for axis in _axes(60):
        place = 40.0 * axis
        # A disk, its land, and where the rays come from
        shapes = [Annulus(place, axis, 0.0, 5.0), Annulus(place, axis, 5.0, 9.0)]
        shapes.append(Annulus(0.0 * axis, axis, 0.0, 7.0))
        for entered in (False, True):
            found = Precedence(shapes, []).excluded(2, entered)
            assert found[0, 1]
            assert found[1, 0]
            assert found[2].all()


def test_what_lies_behind_along_the_axis_is_met_later() -> None:
    for axis in _axes(60):
        cap = SphereCap(10.0 * axis, axis, 30.0, 2.0)
        barrel = Cylinder(0.0 * axis, axis, 12.0, 0.0, 60.0)
        shapes = [cap, barrel, Annulus(20.0 * axis, axis, 0.0, 8.0)]
        shapes.append(Annulus(50.0 * axis, axis, 0.0, 8.0))
        found = Precedence(shapes, [(-np.ones(3), np.ones(3))]).excluded(4, True)
        assert found[0, 2]
        assert found[0, 3]
        assert found[2, 3]
        assert not found[3, 2]
        assert not found[3, 0]
        # All others stand inside the barrel
        assert not found[1, [0, 2, 3]].any()
