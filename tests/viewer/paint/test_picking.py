"""The picker finds what a slow search finds."""

from __future__ import annotations

import numpy as np
import pytest

from viewer.drawn.camera import screen_ray, standard_view, view_matrix
from viewer.paint.picking import pick_segment, pick_triangle

W, H = 640, 480
BOX = (np.full(3, -10.0), np.full(3, 10.0))


def slow(segments, matrix, x, y, tolerance) -> float:
    """Least distance in pixels, sampled along every segment."""
    t = np.linspace(0, 1, 2001)[:, None]
    best = np.inf
    for a, b in segments.astype(float):
        flat = np.c_[a + t * (b - a), np.ones(len(t))] @ matrix.T
        front = flat[:, 3] > 1e-3
        if front.any():
            pixels = flat[front, :2] / flat[front, 3:]
            best = min(best, float(np.hypot(*(pixels - [x, y]).T).min()))
    return best if best <= tolerance else np.inf


@pytest.mark.parametrize("parallel", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_the_picker_finds_the_nearest_line(parallel: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    segments = rng.uniform(-12, 12, (40, 2, 3)).astype(np.float32)
    rgba = np.full((40, 4), 200, np.uint8)
    camera = standard_view("tilted", BOX, aspect=W / H, parallel=parallel)
    matrix = view_matrix(camera, W, H, 30.0)
    for x, y in rng.uniform([0, 0], [W, H], (12, 2)):
        found = pick_segment(segments, rgba, matrix, x, y, tolerance=20)
        expected = slow(segments, matrix, x, y, 20)
        if not np.isfinite(expected):
            assert found is None
            continue
        assert found is not None
        # Among lines within half a pixel the foremost is taken
        assert found.distance_px <= expected + 0.6
        place = segments[found.segment, 0] + found.fraction * np.diff(
            segments[found.segment], axis=0
        )
        flat = matrix @ np.append(place, 1.0)
        seen = np.hypot(*(flat[:2] / flat[3] - [x, y]))
        assert seen == pytest.approx(found.distance_px, abs=0.02)


def test_of_two_lines_at_one_pixel_the_foremost_is_picked() -> None:
    segments = np.array([[[0, -5, 5], [0, 5, 5]], [[0, -5, -5], [0, 5, -5]]], np.float32)
    rgba = np.full((2, 4), 255, np.uint8)
    for view, first in (("front", 1), ("back", 0)):
        camera = standard_view(view, BOX, aspect=W / H)
        matrix = view_matrix(camera, W, H, 30.0)
        found = pick_segment(segments, rgba, matrix, W / 2, H / 2)
        assert found is not None
        assert found.segment == first


def test_invisible_lines_are_not_picked() -> None:
    segments = np.array([[[0, -5, 0], [0, 5, 0]]], np.float32)
    matrix = view_matrix(standard_view("front", BOX, aspect=W / H), W, H, 30.0)
    hidden = np.array([[255, 255, 255, 0]], np.uint8)
    assert pick_segment(segments, hidden, matrix, W / 2, H / 2) is None
    assert pick_segment(segments[:0], hidden[:0], matrix, 1, 1) is None


def test_triangles_are_found_along_the_line_of_sight() -> None:
    vertices = np.array(
        [[-5, -5, 0], [5, -5, 0], [0, 8, 0], [-5, -5, 3], [5, -5, 3], [0, 8, 3]], np.float32
    )
    triangles = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    camera = standard_view("front", BOX, aspect=W / H)
    origin, direction = screen_ray(camera, W / 2, H / 2, W, H)
    found = pick_triangle(vertices, triangles, origin, direction)
    assert found is not None
    assert found[0] == 0
    assert (origin + found[1] * direction)[2] == pytest.approx(0, abs=1e-9)
    origin, direction = screen_ray(camera, 2, 2, W, H)
    assert pick_triangle(vertices, triangles, origin, direction) is None
