"""Laws of the line painter: coverage is area, threads do not matter, depth and cuts hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap.model.errors import RayMapError
from tests.examples import examples
from viewer.paint.raster import draw_segments

W, H = 160, 128
PIXELS = np.diag([1.0, 1.0, 1.0, 0.0])
PIXELS[3, 3] = 1.0


def blank() -> tuple[np.ndarray, np.ndarray]:
    return np.full((H, W), np.inf, np.float32), np.zeros((H, W, 4), np.float32)


def draw(ends, *, width=1.0, alpha=255, matrix=PIXELS, depth=None, threads=1) -> np.ndarray:
    far, image = blank()
    segments = np.array(ends, np.float32).reshape(-1, 2, 3)
    rgba = np.tile(np.array([255, 255, 255, alpha], np.uint8), (len(segments), 1))
    draw_segments(
        segments, rgba, matrix, width=width, depth=far if depth is None else depth, image=image,
        threads=threads,
    )  # fmt: skip
    return image


inside = st.tuples(st.floats(15, W - 15), st.floats(15, H - 15))


@settings(max_examples=examples(60))
@given(inside, inside, st.floats(0.4, 6))
def test_the_light_of_a_line_is_its_area(a: tuple, b: tuple, width: float) -> None:
    length = float(np.hypot(b[0] - a[0], b[1] - a[1]))
    image = draw([[*a, 0.0], [*b, 0.0]], width=width)
    # Ends are cut along the shorter axis, which keeps the area
    assert image[:, :, 3].sum() == pytest.approx(length * width, rel=1e-3, abs=1e-2)


def test_blending_is_in_order() -> None:
    far, image = blank()
    segments = np.array([[[10, 20, 0], [90, 20, 0]]] * 2, np.float32)
    rgba = np.array([[255, 0, 0, 255], [0, 0, 255, 128]], np.uint8)
    draw_segments(segments, rgba, PIXELS, width=4.0, depth=far, image=image)
    np.testing.assert_allclose(image[20, 50, :3], [1 - 128 / 255, 0, 128 / 255], atol=1e-6)


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_paint_the_same_bits(threads: int) -> None:
    rng = np.random.default_rng(1)
    ends = rng.uniform(-60, 220, (3000, 2, 3))
    np.testing.assert_array_equal(
        draw(ends, alpha=90, width=1.7, threads=threads), draw(ends, alpha=90, width=1.7)
    )


def test_opaque_bodies_hide_lines_behind_them() -> None:
    depth = np.full((H, W), np.inf, np.float32)
    depth[:, 80:] = 0.5
    image = draw([[10, 60, 1.0], [150, 60, 1.0]], depth=depth)
    assert image[60, 40, 3] > 0
    assert image[60, 120, 3] == 0
    in_front = draw([[10, 60, 0.2], [150, 60, 0.2]], depth=depth)
    assert in_front[60, 120, 3] > 0


def test_what_is_behind_the_camera_is_cut_away() -> None:
    matrix = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]], float)
    crossing = draw([[80, 60, 1.0], [80, 60, -50.0]], matrix=matrix)
    assert np.isfinite(crossing).all()
    behind = draw([[80, 60, -1.0], [10, 10, -2.0]], matrix=matrix)
    assert behind.sum() == 0


def test_huge_and_degenerate_lines_do_no_harm() -> None:
    image = draw(
        [
            [[-1e9, 64, 0], [1e9, 64, 0]],
            [[50, 50, 0], [50, 50, 0]],
            [[np.nan, 0, 0], [10, 10, 0]],
            [[np.inf, 0, 0], [10, 10, 0]],
        ]
    )
    assert np.isfinite(image).all()
    assert image[63:65, :, 3].sum() > 0.9 * W


def test_nothing_drawn_leaves_the_picture() -> None:
    assert draw(np.empty((0, 2, 3))).sum() == 0
    assert draw([[10, 10, 0], [50, 50, 0]], alpha=0).sum() == 0


@pytest.mark.parametrize("width", [0.0, -1.0, 1001.0, 1e300, float("nan"), float("inf")])
def test_lines_have_a_width(width):
    arrays = np.zeros((1, 2, 3), np.float32), np.full((1, 4), 255, np.uint8), np.eye(4)
    depth, image = np.ones((8, 8), np.float32), np.zeros((8, 8, 4), np.float32)
    with pytest.raises(RayMapError, match="pixels wide"):
        draw_segments(*arrays, width=width, depth=depth, image=image)
    for wrong in (image[:, :7], image[..., :3]):
        with pytest.raises(RayMapError, match="do not fit together"):
            draw_segments(*arrays, width=1.0, depth=depth, image=wrong)
    assert not image.any()
