"""Frames: orthonormal, right-handed, and turned as they promise, also in the awkward directions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from raymap.jit.kernels import kernel
from raymap.optics.frames import (
    frame_about,
    frame_of,
    frame_towards,
    s_vector,
    transverse_axes,
    turn_to,
    unit_factor,
)

Array = np.ndarray


@kernel
def _about(n: Array, out: Array) -> None:
    out[0, 0], out[0, 1], out[0, 2], out[1, 0], out[1, 1], out[1, 2] = frame_about(n[0], n[1], n[2])


@kernel
def _towards(n: Array, t: Array, s: Array, out: Array) -> float:
    length, out[0, 0], out[0, 1], out[0, 2], out[1, 0], out[1, 1], out[1, 2] = frame_towards(
        n[0], n[1], n[2], t[0], t[1], t[2], s[0], s[1], s[2]
    )
    return length


@kernel
def _factor(x: float, y: float, z: float) -> float:
    return unit_factor(x, y, z)


def unit(vector: object) -> Array:
    v = np.asarray(vector, float)
    return v / np.linalg.norm(v)


@st.composite
def directions(draw: st.DrawFn) -> Array:
    """Any direction; often one near an axis, where frames go wrong."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d = unit(rng.normal(size=3))
    if draw(st.booleans()):
        axis = np.eye(3)[draw(st.integers(0, 2))] * draw(st.sampled_from([-1.0, 1.0]))
        d = unit(axis + d * 10.0 ** -draw(st.integers(1, 20)))
    return d


ROUNDING = 4e-15
"""Of products between the vectors of a frame, by the standard model of rounding (u = 2^-53).

One projection of t onto the plane across n leaves of |t| along n at most 3u (the product of three
terms) + 6u (a normalised n has a length within 3u of 1, which counts twice) + 2u (product and
difference of each coordinate) = 11u, and is the last one only where what it leaves of t is at least
sqrt(0.1) |t| long: 35u = 3.9e-15. In 10^7 frames, a quarter of them at that limit: 2.2e-15.
"""


def assert_frame(x: Array, y: Array, n: Array) -> None:
    frame = np.array([x, y, n])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), rtol=0.0, atol=ROUNDING)
    np.testing.assert_allclose(np.cross(n, x), y, rtol=0.0, atol=ROUNDING)


@given(directions())
def test_a_frame_about_a_direction(n: Array) -> None:
    axes = np.empty((2, 3))
    _about(n, axes)
    assert_frame(*axes, n)


@given(directions(), directions(), st.floats(1e-3, 1e3))
@example(
    unit([0.93010912, -0.03569074, 0.36554506]),
    unit([0.98487297, -0.14460805, -0.09546598]),
    358.3,
)
def test_the_first_axis_points_towards_the_vector(n: Array, towards: Array, size: float) -> None:
    axes, spare = np.empty((2, 3)), np.eye(3)[np.argmin(np.abs(n))]
    length = _towards(n, size * towards, spare, axes)
    assert_frame(*axes, n)
    sine = np.linalg.norm(np.cross(n, towards))
    if length == 0.0:
        assert sine < 2e-14
        assert axes[0] @ spare > 0.0
        return
    assert length == pytest.approx(size * sine, rel=1e-9, abs=ROUNDING * size)
    if sine > 1e-6:
        assert axes[0] @ towards > 0.0
        assert abs(axes[1] @ towards) < ROUNDING


def test_what_stands_in_along_the_direction() -> None:
    axes = np.empty((2, 3))
    assert _towards(np.eye(3)[2], 5.0 * np.eye(3)[2], np.array([1.0, 1.0, 7.0]), axes) == 0.0
    np.testing.assert_allclose(axes[0], unit([1.0, 1.0, 0.0]), atol=1e-16)


def test_s_of_a_plane_of_incidence() -> None:
    """s = d x n / |d x n|, as the conventions say."""
    d, n = unit([0.3, -0.4, 0.9]), unit([0.1, 0.2, -1.0])
    np.testing.assert_allclose(s_vector(*d, *n), unit(np.cross(d, n)), atol=1e-15)


def test_many_directions_of_any_shape() -> None:
    draws = np.random.default_rng(4)
    d = draws.normal(size=(2, 5, 3))
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    x, y = transverse_axes(d, (0.0, 0.0, 3.0))
    np.testing.assert_allclose(np.sum(x * d, axis=-1), 0.0, atol=ROUNDING)
    np.testing.assert_allclose(np.cross(d, x), y, rtol=0.0, atol=ROUNDING)
    assert np.all(x[..., 2] > 0.0)


def test_the_frame_of_an_axis() -> None:
    np.testing.assert_array_equal(frame_of((0, 0, 7)), np.eye(3))
    u, v, w = frame_of((1.0, 0.0, 0.0))
    assert_frame(u, v, w)
    np.testing.assert_allclose(u, [0.0, 1.0, 0.0], atol=1e-16)
    u, v, w = frame_of((1.0, 2.0, -2.0))
    assert_frame(u, v, w)
    assert u[0] == pytest.approx(math.sqrt(1.0 - 1.0 / 9.0))


@pytest.mark.parametrize("axis", [(0, 0, 2), (1, 2, 3), (1, 2, -3), (1e-4, 0, -1), (0, 0, -1)])
def test_the_least_rotation(axis: tuple[float, float, float]) -> None:
    """As scipy's rotation by the angle about the common normal."""
    w = unit(axis)
    found = turn_to(axis)
    np.testing.assert_allclose(found[:, 2], w, atol=1e-9)
    about = np.cross([0.0, 0.0, 1.0], w)
    if np.linalg.norm(about) == 0.0:
        about = np.array([1.0, 0.0, 0.0])
    angle = math.acos(w[2])
    expected = Rotation.from_rotvec(angle * unit(about)).as_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-7)


@given(st.floats(-1e-8, 1e-8))
def test_a_length_that_is_nearly_one(error: float) -> None:
    """Newton's step leaves 3/2 of the square of the error."""
    v = unit([0.3, -0.7, 0.2]) * (1.0 + error)
    assert np.linalg.norm(v * _factor(*v)) == pytest.approx(1.0, abs=1e-15)
