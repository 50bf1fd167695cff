"""States of polarised light and their conversions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raymap.jit.kernels import kernel
from raymap.optics.frames import transverse_axes
from raymap.optics.waves import restore_state, stokes_axis, store_state
from tests.tracer.lens.lenses import biconvex, parallel_ray
from tracer.lens import trace_lens
from tracer.optics.polarization import (
    azimuth,
    coherency,
    degree_of_polarization,
    ellipticity,
    field_from_jones,
    jones,
    linear_field,
    stokes,
    stokes_from_coherency,
)
from tracer.optics.polarization_payload import from_payload, to_payload
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays, natural_light

Z = (0.0, 0.0, 1.0)
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@st.composite
def states(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    e = rng.normal(size=3) + 1j * rng.normal(size=3)
    return d, e - (e @ d) * d


def test_axes_are_a_right_handed_triad() -> None:
    d = np.random.default_rng(3).normal(size=(200, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    x, y = transverse_axes(d)
    np.testing.assert_allclose(np.cross(x, y), d, atol=1e-15)
    same, _ = transverse_axes(Z, (5.0, 0.0, 3.0))
    np.testing.assert_allclose(same, X)
    lost, _ = transverse_axes(Z, Z)  # a reference along the ray says nothing
    assert abs(lost @ np.array(Z)) == 0.0


def test_textbook_stokes_vectors() -> None:
    for field, expected in [
        (X, (1, 1, 0, 0)),
        (Y, (1, -1, 0, 0)),
        ((X + Y) / math.sqrt(2), (1, 0, 1, 0)),
        # Under exp(-i w t) the vibration (1, -i) turns from y to x: clockwise seen against the ray
        ((X - 1j * Y) / math.sqrt(2), (1, 0, 0, 1)),
        ((X + 1j * Y) / math.sqrt(2), (1, 0, 0, -1)),
    ]:
        np.testing.assert_allclose(stokes(field, X, Y), expected, atol=1e-15)


@given(states(), st.floats(0.0, 1.0))
def test_fields_made_of_a_stokes_vector_have_it(
    state: tuple[np.ndarray, np.ndarray], p: float
) -> None:
    """Stored and restored: any degree of polarisation, by the Stokes vector of the field itself."""
    d, field = state
    x = np.array(stokes_axis.py_func(*d))
    s0, *polarised = stokes(field, x, np.cross(d, x))
    expected = p * np.array(polarised) / s0
    waves, found = np.empty((2, 6)), np.empty((1, 3), np.float32)
    _restored(waves, d, expected, found)
    assert np.sum(waves**2) == pytest.approx(1.0)
    np.testing.assert_allclose(waves.reshape(2, 2, 3) @ d, 0.0, atol=1e-12)
    np.testing.assert_allclose(found[0], expected, atol=1e-6)


@kernel
def _restored(waves: Any, d: Any, s: Any, found: Any) -> None:
    restore_state(waves, d[0], d[1], d[2], s[0], s[1], s[2])
    store_state(waves, d[0], d[1], d[2], 0, found, np.empty(0, np.float32))


def test_right_handed_light_turns_clockwise_for_the_observer() -> None:
    field = (X - 1j * Y) / math.sqrt(2)
    now, later = ((field * np.exp(-1j * phase)).real for phase in (0.0, 0.1))
    # The observer looks along -z: x to his left, so clockwise is from +y to +x … from +x to -y
    assert np.cross(now, later)[2] < 0.0


@given(states())
def test_conversions_are_one_state(state: tuple[np.ndarray, np.ndarray]) -> None:
    d, e = state
    x, y = transverse_axes(d)
    np.testing.assert_allclose(field_from_jones(jones(e, x, y), x, y), e, atol=1e-12)
    s = stokes(e, x, y)
    np.testing.assert_allclose(stokes_from_coherency(coherency(e), x, y), s, atol=1e-12)
    assert degree_of_polarization(s) == pytest.approx(1.0, abs=1e-12)
    # The ellipse has these axes: project the field on its major axis
    psi, chi = azimuth(s), ellipticity(s)
    major = math.cos(psi) * x + math.sin(psi) * y
    minor = np.cross(d, major)
    power = np.sum(np.abs(e) ** 2)
    assert abs(e @ major) ** 2 == pytest.approx(power * math.cos(chi) ** 2, abs=1e-9)
    assert abs(e @ minor) ** 2 == pytest.approx(power * math.sin(chi) ** 2, abs=1e-9)


def test_natural_light_is_unpolarised_and_never_interferes() -> None:
    d = np.random.default_rng(4).normal(size=(20, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    first, second = natural_light(np.zeros(3), d, wavelength_nm=500.0, coherence=np.arange(20))
    x, y = transverse_axes(d, (0.3, 0.2, 0.9))
    mixed = stokes(first.field, x, y) + stokes(second.field, x, y)
    np.testing.assert_allclose(mixed[:, 0], 1.0)
    np.testing.assert_allclose(degree_of_polarization(mixed), 0.0, atol=1e-14)
    assert len(set(first.coherence) | set(second.coherence)) == 40


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"vibration": [[0.0, 0.0, 0.0]]}, "vibration"),
        ({"vibration": [[1.0, 0.0, 0.1]]}, r"vibration.*perpendicular"),
        ({"vibration": [[math.nan, 0.0, 0.0]]}, "vibration"),
        ({"direction": [[0.0, 0.0, 2.0]]}, "direction"),
        ({"flux": -1.0}, "flux"),
        ({"wavelength_nm": 0.0}, "wavelength_nm"),
        ({"origin": [[math.inf, 0.0, 0.0]]}, "origin"),
        ({"origin": [[0.0, 0.0]]}, "origin"),
        ({"optical_path": [1.0, 2.0]}, "columns"),
    ],
)
def test_bad_rays_are_refused_by_field(arguments: dict[str, object], named: str) -> None:
    values: dict[str, object] = {
        "origin": [[0.0, 0.0, 0.0]],
        "direction": [Z],
        "vibration": [[1.0, 0.0, 0.0]],
        "wavelength_nm": 550.0,
    }
    with pytest.raises(PolarizationError, match=named):
        PolarizedRays.linear(**(values | arguments))  # type: ignore[arg-type]


@given(states())
def test_elliptical_light_is_two_coherent_payload_rows(
    state: tuple[np.ndarray, np.ndarray],
) -> None:
    d, e = state
    rays = PolarizedRays.from_field(np.zeros(3), d, e, wavelength_nm=550.0, coherence=7)
    payload = to_payload(rays)
    assert len(payload) == 2
    assert payload.group[0] == payload.group[1] == 0
    assert set(payload.channel) == {7}
    np.testing.assert_allclose(payload.field.sum(axis=0), e, atol=1e-9)
    np.testing.assert_allclose(payload.intensity.sum(), np.sum(np.abs(e) ** 2), rtol=1e-9)
    assert abs(payload.vibration[0] @ payload.vibration[1]) < 1e-7
    again = from_payload(payload, np.zeros(3), d)
    np.testing.assert_allclose(again.field.sum(axis=0), e, atol=1e-9)


def test_linear_light_is_one_payload_row_and_its_sign_is_a_matter_of_taste() -> None:
    vibration = np.array([0.6, -0.8, 0.0])
    for phase, jumps in ((0.0, 0), (math.pi, 1)):
        e = linear_field(2.0, vibration, phase)
        rays = PolarizedRays.from_field(np.zeros(3), Z, e, wavelength_nm=550.0)
        for counted in (None, [3], [4]):
            payload = to_payload(rays, counted)
            assert len(payload) == 1
            np.testing.assert_allclose(payload.field[0], e, atol=1e-12)
            assert payload.phase[0] == 0.0
        del jumps


def test_lens_exits_in_the_published_payload() -> None:
    tree = trace_lens(biconvex(), parallel_ray(6.0, 5.0, (0.6, 0.8, 0.0)), depth=5)
    exits = tree.exits()
    rays = tree.exit_rays(exits)
    payload = to_payload(rays, exits.half_waves)
    assert len(payload) == len(exits)  # no total reflection, all linear
    np.testing.assert_allclose(payload.field, exits.field, atol=1e-12)
    # One jump where light reflects at the denser medium; inside the glass near normal none
    assert exits.half_waves is not None
    assert list(exits.half_waves[:3]) == [1, 0, 0]
