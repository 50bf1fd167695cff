"""Reflection and refraction of fields: reference tables, textbook cases, laws.

The tables follow from Fresnel's equations, Born & Wolf, Principles of Optics, 7th ed., 1.5.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from raymap.optics.frames import s_vector
from raymap.optics.fresnel import (
    dielectric_amplitudes,
    fresnel_amplitudes,
    fresnel_reflectance,
    schlick_reflectance,
)
from tracer.optics.polarization_fresnel import Wave, published_amplitudes, split_field

BREWSTER = math.degrees(math.atan(1.5))

EXTERNAL = [
    (0.0, -0.200000000, 0.200000000, 0.800000000, 0.800000000, 0.040000000, 0.040000000),
    (30.0, -0.240408206, 0.158899800, 0.759591794, 0.772599867, 0.041522626, 0.040041437),
    (45.0, -0.303337045, 0.092013363, 0.696662955, 0.728008909, 0.050239911, 0.042069273),
    (BREWSTER, -0.384615385, 0.0, 0.615384615, 0.666666667, 0.073964497, 0.056808686),
    (70.0, -0.547352426, -0.206131979, 0.452647574, 0.529245347, 0.171042535, 0.158395235),
    (85.0, -0.855771861, -0.702320306, 0.144228139, 0.198453130, 0.612799645, 0.648491718),
]

INTERNAL = [
    (0.0, 0.2, -0.2),
    (20.0, 0.243029269, -0.156185181),
    (90.0 - BREWSTER, 0.384615385, 0.0),
    (41.0, 0.728681528, 0.478043682),
    (45.0, 0.8 - 0.6j, 0.28 - 0.96j),
    (50.0, 0.487433280 - 0.873160236j, -0.271277249 - 0.962501249j),
    (60.0, -0.1 - 0.994987437j, -0.721739130 - 0.692165174j),
    (80.0, -0.891446717 - 0.453125534j, -0.977580905 - 0.210560143j),
]


@pytest.mark.parametrize("row", EXTERNAL)
def test_air_to_glass(row: tuple[float, ...]) -> None:
    angle, r_s, r_p, t_s, t_p, reflectance, schlick = row
    cos_i = math.cos(math.radians(angle))
    found = dielectric_amplitudes(1.0, 1.5, cos_i)
    np.testing.assert_allclose(found[:4], [r_s, r_p, t_s, t_p], atol=5e-10)
    assert fresnel_reflectance(1.0, 1.5, cos_i) == pytest.approx(reflectance, abs=5e-10)
    assert schlick_reflectance(1.0, 1.5, cos_i) == pytest.approx(schlick, abs=5e-10)


@pytest.mark.parametrize("row", INTERNAL)
def test_glass_to_air(row: tuple[float, complex, complex]) -> None:
    angle, r_s, r_p = row
    found = dielectric_amplitudes(1.5, 1.0, math.cos(math.radians(angle)))
    np.testing.assert_allclose(found[:2], [r_s, r_p], atol=5e-10)


def test_the_critical_angle_has_no_jump() -> None:
    r_s, r_p, _, _, cos_t = dielectric_amplitudes(1.5, 1.0, math.sqrt(1.0 - 1.0 / 2.25))
    assert abs(r_s - 1.0) < 1e-7
    assert abs(r_p - 1.0) < 1e-7
    assert cos_t == pytest.approx(0.0, abs=1e-7)


@given(st.floats(1.0, 3.0), st.floats(1.0, 3.0), st.floats(1e-6, 1.0))
def test_agrees_with_the_complex_form(n1: float, n2: float, cos_i: float) -> None:
    fast = dielectric_amplitudes(n1, n2, cos_i)
    general = fresnel_amplitudes(complex(n1), complex(n2), cos_i)
    np.testing.assert_allclose(fast[:2], general[:2], atol=1e-7)


@pytest.mark.parametrize("angle", [45.0, 50.0, 60.0, 80.0])
def test_total_reflection_phase_identity(angle: float) -> None:
    theta = math.radians(angle)
    r_s, r_p, *_ = dielectric_amplitudes(1.5, 1.0, math.cos(theta))
    delta = cmath.phase(r_p / r_s)
    expected = math.cos(theta) * math.sqrt(math.sin(theta) ** 2 - 1 / 2.25) / math.sin(theta) ** 2
    assert math.tan(abs(delta) / 2.0) == pytest.approx(expected, rel=1e-12)


def test_fresnel_rhomb() -> None:
    def delta(angle: float) -> float:
        r_s, r_p, *_ = dielectric_amplitudes(1.51, 1.0, math.cos(math.radians(angle)))
        return abs(math.degrees(cmath.phase(r_p / r_s)))

    assert delta(48.624359) == pytest.approx(45.0, abs=1e-6)
    assert delta(54.623105) == pytest.approx(45.0, abs=1e-6)
    assert delta(51.339100) == pytest.approx(45.941667, abs=1e-6)
    assert delta(51.2) < delta(51.3391) > delta(51.5)


def test_published_rules_disagree_only_where_they_are_wrong() -> None:
    for n1, n2 in ((1.0, 1.5), (1.5, 1.0)):
        for angle in (1.0, 20.0, 33.0, 35.0, 41.0, 50.0, 60.0, 80.0):
            if n1 > n2 and angle > 41.8:
                continue  # total reflection: none of the rules covers it
            cos_i = math.cos(math.radians(angle))
            r_s, r_p, *_ = dielectric_amplitudes(n1, n2, cos_i)
            rule_s, rule_p = published_amplitudes(n1, n2, cos_i, r_s, r_p)
            assert rule_p == pytest.approx(r_p)
            assert rule_s == pytest.approx(r_s if n1 < n2 else -r_s)


@pytest.mark.parametrize(("n1", "n2"), [(1.0, 1.5), (1.5, 1.0)])
def test_published_rules_depend_on_the_choice_of_s_at_normal_incidence(
    n1: float, n2: float
) -> None:
    """There s and p are interchangeable: a sound rule reflects both vibrations alike."""

    def reflected(published: bool) -> list[float]:
        signs = []
        for tilt in (0.0, math.pi / 2.0):
            # An incidence just off normal fixes s; turn the plane of incidence by 90°
            d = np.array([math.cos(tilt), math.sin(tilt), 0.0]) * 1e-7 + [0.0, 0.0, 1.0]
            d /= np.linalg.norm(d)
            parts = split_field(
                Wave(1.0, 0.0, -d[0], 0.0, 0.0, 0.0, *d), 0, 0, -1.0, n1, n2, published
            )
            signs.append(parts[0])
        return signs

    first, second = reflected(published=False)
    assert first == pytest.approx(second, abs=1e-6)
    first, second = reflected(published=True)
    if n1 < n2:
        assert first == pytest.approx(second, abs=1e-6)
    else:
        assert first == pytest.approx(-second, abs=1e-6)


@st.composite
def incidences(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    if draw(st.booleans()):  # nearly normal incidence
        d = -n + d * 10.0 ** -draw(st.integers(1, 20))
        d /= np.linalg.norm(d)
    if d @ n > 0.0:
        n = -n
    e = rng.normal(size=3) + 1j * rng.normal(size=3)
    e -= (e @ d) * d
    return d, n, e


@given(incidences(), st.floats(1.0, 3.0), st.floats(1.0, 3.0), st.booleans())
def test_split_conserves_flux_and_stays_transverse(
    incidence: tuple[np.ndarray, np.ndarray, np.ndarray], n1: float, n2: float, published: bool
) -> None:
    d, n, e = incidence
    p = np.array(split_field(Wave(*e.real, *e.imag, *d), *n, n1, n2, published)[:18])
    reflected, refracted = p[0:3] + 1j * p[3:6], p[9:12] + 1j * p[12:15]
    total = np.sum(np.abs(reflected) ** 2) + np.sum(np.abs(refracted) ** 2)
    assert total == pytest.approx(np.sum(np.abs(e) ** 2), rel=1e-13)
    assert abs(reflected @ p[6:9]) < 1e-13
    assert abs(refracted @ p[15:18]) < 1e-13
    assert np.linalg.norm(p[6:9]) == pytest.approx(1.0, abs=1e-13)


@example(
    (
        np.array([-0.83113865, -0.17737821, 0.52701567]),
        np.array([0.83092245, 0.17562187, -0.52794398]),
        np.zeros(3, np.complex128),
    )
)  # two thousandths from the normal
@given(incidences())
def test_s_stands_across_ray_and_normal(
    incidence: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    d, n, _ = incidence
    s = np.array(s_vector(*d, *n))
    assert np.linalg.norm(s) == pytest.approx(1.0, abs=1e-14)
    assert abs(s @ d) < 1e-15 * 4
    assert abs(s @ n) < 1e-7
