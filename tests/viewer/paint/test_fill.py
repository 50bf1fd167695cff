"""Laws of the triangle painter: no gaps, no doubles, depth decides."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from viewer.paint.fill import fill_triangles

W, H = 128, 96


def fill(corners, rgba, *, threads: int = 1) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array(corners, np.float64).reshape(-1, 3, 3)
    depth = np.full((H, W), np.inf, np.float32)
    image = np.zeros((H, W, 4), np.float32)
    normals = np.zeros(corners.shape, np.float32)
    normals[:, :, 2] = -1.0
    fill_triangles(
        corners, normals, np.array(rgba, np.float32).reshape(-1, 4), depth=depth, image=image,
        threads=threads,
    )  # fmt: skip
    return image, depth


def fan(points: np.ndarray) -> np.ndarray:
    """A convex polygon as triangles around its centre."""
    flat = np.c_[points, np.zeros(len(points))]
    center = flat.mean(axis=0)
    return np.array([[center, a, b] for a, b in zip(flat, np.roll(flat, -1, 0), strict=True)])


@settings(max_examples=examples(40))
@given(
    st.integers(3, 12),
    st.floats(0, 6),
    st.floats(5, 40),
    st.tuples(st.floats(45, 80), st.floats(42, 54)),
)
def test_a_translucent_polygon_is_filled_once(n, turn, radius, center) -> None:  # fmt: skip
    angle = turn + 2 * np.pi * np.arange(n) / n
    points = np.array(center) + radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    image, _ = fill(fan(points), np.tile([1, 1, 1, 0.25], (n, 1)))
    alpha = image[:, :, 3]
    np.testing.assert_allclose(alpha[alpha > 0], 0.25, atol=1e-6)
    area = 0.5 * n * radius**2 * np.sin(2 * np.pi / n)
    assert (alpha > 0).sum() == pytest.approx(area, rel=0.05, abs=4 * radius)


def test_the_nearer_opaque_triangle_wins() -> None:
    big = np.array([[-10, -10, 0.5], [300, -10, 0.5], [-10, 300, 0.5]])
    near = np.array([[20, 20, 0.1], [60, 20, 0.1], [20, 60, 0.1]])
    for order in ([big, near], [near, big]):
        colors = [[1, 0, 0, 1] if c is big else [0, 0, 1, 1] for c in order]
        image, depth = fill(order, colors)
        # The other colour is at most a highlight
        assert image[30, 30, 2] > 0.3 > 0.05 > image[30, 30, 0]
        assert image[80, 5, 0] > 0.3 > 0.05 > image[80, 5, 2]
        assert depth[30, 30] == pytest.approx(0.1)


def test_translucent_triangles_are_sorted_and_hidden_by_opaque_ones() -> None:
    whole = np.array([[-10, -10, 0], [400, -10, 0], [-10, 400, 0]], float)
    front, middle, back = (whole + np.array([0, 0, z]) for z in (0.1, 0.5, 0.9))
    colors = {"front": [1, 0, 0, 0.5], "middle": [0, 1, 0, 1], "back": [0, 0, 1, 0.5]}
    image, _ = fill([front, middle, back], list(colors.values()))
    red, green, blue = image[40, 40, :3]
    assert blue < 0.2  # highlights are white
    assert red > 0.2
    assert green > 0.2
    one, _ = fill([front, back], [colors["front"], colors["back"]])
    two, _ = fill([back, front], [colors["back"], colors["front"]])
    np.testing.assert_array_equal(one, two)


def test_threads_fill_the_same_bits() -> None:
    rng = np.random.default_rng(2)
    corners = rng.uniform(-20, 150, (300, 3, 3)) * [1, 1, 0.01]
    rgba = np.c_[rng.random((300, 3)), rng.choice([1.0, 0.3], 300)]
    one, _ = fill(corners, rgba)
    many, _ = fill(corners, rgba, threads=3)
    np.testing.assert_array_equal(one, many)


def test_degenerate_triangles_do_no_harm() -> None:
    image, _ = fill(
        [
            [[10, 10, 0], [10, 10, 0], [50, 50, 0]],
            [[np.nan, 0, 0], [10, 0, 0], [0, 10, 0]],
            [[-1e12, -1e12, 0], [1e12, 0, 0], [0, 1e12, 0]],
        ],
        np.tile([1, 1, 1, 1], (3, 1)),
    )
    assert np.isfinite(image).all()
