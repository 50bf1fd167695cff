"""Slabs of depth: pieces cover the triangles, and are drawn from back to front."""

from __future__ import annotations

import numpy as np
import pytest

from viewer.paint.slabs import DEEP, cut_into_slabs, drawing_order

FORWARD = np.array([0.6, 0.0, 0.8])


def area(corners: np.ndarray) -> np.ndarray:
    a, b, c = (corners[:, k].astype(float) for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


@pytest.mark.parametrize("level", [False, True])
def test_pieces_lie_in_one_slab_each_and_cover_the_triangles_once(level: bool) -> None:
    rng = np.random.default_rng(5)
    corners = rng.normal(size=(40, 3, 3)).astype(np.float32)
    if level:
        # An edge across the line of sight, as along every wall of a tube
        for k in range(len(corners)):
            one, other = k % 3, (k + 1) % 3
            corners[k, one, ::2] = corners[k, other, ::2]
    depth = corners @ FORWARD
    bounds = np.linspace(depth.min(), depth.max(), 19)
    pieces, normals = cut_into_slabs(corners, 2 * corners + 1, FORWARD, bounds)
    slab = bounds[1] - bounds[0]
    whole = np.ptp(depth, axis=1) <= DEEP * slab
    assert 5 < whole.sum() < 35
    spans = np.ptp(pieces @ FORWARD, axis=1)
    assert spans[: whole.sum()].max() <= DEEP * slab
    assert spans[whole.sum() :].max() <= slab * (1 + 1e-4)
    # Areas and centres of mass: nothing is doubled or lost
    sizes = np.linalg.norm(area(pieces), axis=1)
    assert sizes.min() > 0.0
    assert sizes.sum() == pytest.approx(np.linalg.norm(area(corners), axis=1).sum(), rel=1e-5)
    centres = np.einsum("i,ij->j", sizes, pieces.mean(axis=1))
    whole_sizes = np.linalg.norm(area(corners), axis=1)
    expected = np.einsum("i,ij->j", whole_sizes, corners.mean(axis=1))
    np.testing.assert_allclose(centres, expected, atol=1e-3)
    np.testing.assert_allclose(normals, 2 * pieces + 1, atol=1e-4)


def test_small_triangles_and_none_stay_as_they_are() -> None:
    corners = np.array([[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]], np.float32)
    for given in (corners, corners[:0]):
        pieces, _ = cut_into_slabs(given, given, FORWARD, np.linspace(0, 1, 5))
        np.testing.assert_array_equal(pieces, given)


def test_far_slabs_come_first_and_bodies_on_one_another_in_their_order() -> None:
    bounds = np.linspace(0, 4, 5)
    depth = np.array([0.2, 3.5, 3.6, 1.1, 1.9, 1.5])
    body = np.array([0, 1, 0, 1, 1, 0])
    assert drawing_order(depth, body, bounds).tolist() == [2, 1, 5, 4, 3, 0]
