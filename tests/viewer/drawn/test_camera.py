"""The camera keeps what a hand expects of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from viewer.drawn.camera import (
    STANDARD_VIEWS,
    fit,
    orbit,
    pan,
    screen_ray,
    standard_view,
    view_axes,
    view_matrix,
    zoom,
)
from viewer.drawn.state import Camera

W, H = 800, 600
BOX = (np.array([-30.0, -20.0, -5.0]), np.array([30.0, 20.0, 140.0]))
views = st.sampled_from(sorted(STANDARD_VIEWS))
pixels = st.tuples(st.floats(1, W - 1), st.floats(1, H - 1))
steps = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


def project(camera: Camera, point: np.ndarray) -> np.ndarray:
    flat = view_matrix(camera, W, H, 100.0) @ np.append(point, 1.0)
    return flat[:2] / flat[3]


def corners() -> np.ndarray:
    grid = np.meshgrid(*zip(*BOX, strict=True))
    return np.stack([axis.ravel() for axis in grid], -1)


@given(views, st.booleans(), steps)
def test_a_fitted_box_fills_the_picture(view: str, parallel: bool, turn: tuple) -> None:
    camera = orbit(standard_view(view, BOX, aspect=W / H, parallel=parallel), *turn, H)
    camera = fit(camera, BOX, aspect=W / H, margin=1.0)
    seen = np.array([project(camera, corner) for corner in corners()])
    assert (seen >= -1e-6).all()
    assert (seen <= np.array([W, H]) + 1e-6).all()
    # and it touches at least one border
    gaps = np.concatenate([seen.min(0), np.array([W, H]) - seen.max(0)])
    assert gaps.min() < 1e-6


@given(views, st.booleans(), pixels)
def test_the_line_of_sight_leads_through_its_pixel(view: str, parallel: bool, at: tuple) -> None:
    camera = standard_view(view, BOX, aspect=W / H, parallel=parallel)
    origin, direction = screen_ray(camera, *at, W, H)
    for distance in (camera.height, 3 * camera.height):
        np.testing.assert_allclose(project(camera, origin + distance * direction), at, atol=1e-6)


@given(views, st.booleans(), steps)
def test_orbiting_keeps_distance_and_focal_point(view: str, parallel: bool, turn: tuple) -> None:
    camera = standard_view(view, BOX, aspect=W / H, parallel=parallel)
    turned = orbit(camera, *turn, H)

    def distance(c: Camera) -> float:
        return float(np.linalg.norm(np.subtract(c.position, c.focal_point)))

    assert turned.focal_point == camera.focal_point
    assert distance(turned) == pytest.approx(distance(camera))
    sight = np.subtract(turned.focal_point, turned.position)
    assert abs(sight @ np.array(turned.view_up)) < 1e-9 * distance(turned)


@given(views, st.booleans(), steps)
def test_panning_moves_the_focal_plane_with_the_hand(
    view: str, parallel: bool, step: tuple
) -> None:
    camera = standard_view(view, BOX, aspect=W / H, parallel=parallel)
    point = np.array(camera.focal_point)
    before, after = project(camera, point), project(pan(camera, *step, H), point)
    np.testing.assert_allclose(after - before, step, atol=1e-6)


@given(views, st.booleans(), pixels, st.floats(0.2, 5))
def test_zooming_holds_the_point_under_the_mouse(
    view: str, parallel: bool, at: tuple, factor: float
) -> None:
    camera = standard_view(view, BOX, aspect=W / H, parallel=parallel)
    origin, direction = screen_ray(camera, *at, W, H)
    to_focal = np.subtract(camera.focal_point, origin)
    forward = np.subtract(camera.focal_point, camera.position)
    assume(abs(direction @ forward) > 1e-6)
    point = origin + direction * (to_focal @ forward) / (direction @ forward)
    zoomed = zoom(camera, factor, *at, W, H)
    np.testing.assert_allclose(project(zoomed, point), at, atol=1e-6)
    assert zoomed.height == pytest.approx(camera.height / factor)


def test_from_the_side_light_travels_to_the_right() -> None:
    camera = standard_view("side", BOX, aspect=W / H)
    start, end = project(camera, np.zeros(3)), project(camera, np.array([0, 0, 100.0]))
    above = project(camera, np.array([0, 10.0, 0]))
    assert end[0] > start[0]
    assert above[1] < start[1]
    assert project(camera, np.array([7.0, 0, 0]))[0] == pytest.approx(start[0])


@pytest.mark.parametrize(
    ("view", "right", "upward"),
    [
        ("side", (1, 0, 0), (0, 0, 1)),
        ("top", (1, 0, 0), (0, 1, 0)),
        ("front", (0, -1, 0), (0, 0, 1)),
    ],
)
def test_of_a_scene_whose_z_points_upward(
    view: str, right: tuple[int, ...], upward: tuple[int, ...]
) -> None:
    axes = view_axes(standard_view(view, BOX, aspect=W / H, up="z"))
    np.testing.assert_allclose(axes[:2], (right, upward), atol=1e-12)


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("view", sorted(STANDARD_VIEWS))
def test_the_axis_named_points_upward_but_from_above(view: str, up: str) -> None:
    camera = standard_view(view, BOX, aspect=W / H, up=up)
    axis = np.eye(3)["xyz".index(up)]
    right, upward, forward = view_axes(camera)
    assert abs(right @ axis) < 1e-12
    assert (-forward if view == "top" else upward) @ axis > 0.7


def test_depth_grows_away_from_the_camera() -> None:
    for parallel in (True, False):
        camera = standard_view("tilted", BOX, aspect=W / H, parallel=parallel)
        matrix = view_matrix(camera, W, H, 100.0)
        origin, direction = screen_ray(camera, 300, 200, W, H)
        points = origin + np.linspace(0.5, 2, 9)[:, None] * camera.height * direction
        flat = np.c_[points, np.ones(9)] @ matrix.T
        assert (np.diff(flat[:, 2] / flat[:, 3]) > 0).all()


def test_a_camera_takes_whole_numbers() -> None:
    whole = Camera(position=(0, 0, -10), focal_point=(0, 0, 0), view_up=(0, 1, 0), height=4)
    same = Camera(
        position=(0.0, 0.0, -10.0), focal_point=(0.0, 0.0, 0.0), view_up=(0.0, 1.0, 0.0), height=4.0
    )
    np.testing.assert_array_equal(view_matrix(whole, W, H, 5.0), view_matrix(same, W, H, 5.0))
    assert orbit(whole, 10, 20, H) == orbit(same, 10, 20, H)


def test_a_line_of_sight_goes_through_what_is_painted_at_its_pixel() -> None:
    """Also where a saved camera says a place that does not fit its height."""
    for parallel in (True, False):
        camera = Camera(position=(9, 3, 4), focal_point=(0, 0, 2), view_up=(0, 1, 0), height=5,
                        parallel=parallel)  # fmt: skip
        point = np.array([0.5, -0.7, 2.9])
        x, y, _, w = view_matrix(camera, 320, 240, 1.0) @ np.append(point, 1.0)
        origin, direction = screen_ray(camera, x / w, y / w, 320, 240)
        beside = np.linalg.norm(np.cross(point - origin, direction))
        assert beside < 1e-12
