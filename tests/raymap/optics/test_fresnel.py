"""Smooth interfaces: printed values, textbook cases, energy."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raymap.optics import fresnel as f
from tests.naive import fresnel as naive

ANGLES = st.floats(0.0, 89.99).map(math.radians)
INDEX = st.floats(1.0, 3.0)

# n1 = 1, n2 = 1.5: angle, r_s, r_p, t_s, t_p, R unpolarised, R of Schlick
AIR_GLASS = [
    (0.0, -0.2, 0.2, 0.8, 0.8, 0.04, 0.04),
    (30.0, -0.240408206, 0.158899800, 0.759591794, 0.772599867, 0.041522626, 0.040041437),
    (45.0, -0.303337045, 0.092013363, 0.696662955, 0.728008909, 0.050239911, 0.042069273),
    (70.0, -0.547352426, -0.206131979, 0.452647574, 0.529245347, 0.171042535, 0.158395235),
    (85.0, -0.855771861, -0.702320306, 0.144228139, 0.198453130, 0.612799645, 0.648491718),
]

# n1 = 1.5, n2 = 1: angle, r_s, r_p
GLASS_AIR = [
    (0.0, 0.2, -0.2),
    (20.0, 0.243029269, -0.156185181),
    (41.0, 0.728681528, 0.478043682),
    (45.0, 0.8 - 0.6j, 0.28 - 0.96j),
    (50.0, 0.487433280 - 0.873160236j, -0.271277249 - 0.962501249j),
    (60.0, -0.1 - 0.994987437j, -0.721739130 - 0.692165174j),
    (80.0, -0.891446717 - 0.453125534j, -0.977580905 - 0.210560143j),
]


@pytest.mark.parametrize("row", AIR_GLASS)
def test_from_air_to_glass(row: tuple[float, ...]) -> None:
    cosine = math.cos(math.radians(row[0]))
    found = f.fresnel_amplitudes(1.0 + 0j, 1.5 + 0j, cosine)
    np.testing.assert_allclose(found[:4], row[1:5], atol=1e-9)
    assert f.fresnel_reflectance(1.0, 1.5, cosine) == pytest.approx(row[5], abs=1e-9)
    assert f.schlick_reflectance(1.0, 1.5, cosine) == pytest.approx(row[6], abs=1e-9)


@pytest.mark.parametrize("row", GLASS_AIR)
def test_from_glass_to_air(row: tuple[float, complex, complex]) -> None:
    found = f.fresnel_amplitudes(1.5 + 0j, 1.0 + 0j, math.cos(math.radians(row[0])))
    np.testing.assert_allclose(found[:2], row[1:], atol=1e-9)


def test_brewster() -> None:
    angle = math.atan(1.5)
    _, r_p, _, _, _ = f.fresnel_amplitudes(1.0 + 0j, 1.5 + 0j, math.cos(angle))
    assert abs(r_p) < 1e-15
    assert f.fresnel_reflectance(1.0, 1.5, math.cos(angle)) == pytest.approx(0.147928994 / 2)


@given(st.floats(math.asin(1 / 1.51) + 1e-6, math.pi / 2 - 1e-6))
def test_phase_of_total_reflection(angle: float) -> None:
    """tan(delta / 2) = cos θ sqrt(sin² θ - n²) / sin² θ (Born & Wolf 1.5.4, eq. 61)."""
    r_s, r_p, _, _, _ = f.fresnel_amplitudes(1.51 + 0j, 1.0 + 0j, math.cos(angle))
    delta = cmath.phase(r_p / r_s)
    sine = math.sin(angle)
    expected = math.cos(angle) * math.sqrt(sine**2 - 1.51**-2) / sine**2
    assert math.tan(abs(delta) / 2) == pytest.approx(expected, abs=1e-7)
    assert abs(r_s) == pytest.approx(1)
    assert f.fresnel_reflectance(1.51, 1.0, math.cos(angle)) == 1.0


@pytest.mark.parametrize("angle_deg", [48.624359, 54.623105])
def test_fresnel_rhomb(angle_deg: float) -> None:
    r_s, r_p, _, _, _ = f.fresnel_amplitudes(1.51 + 0j, 1.0 + 0j, math.cos(math.radians(angle_deg)))
    assert abs(cmath.phase(r_p / r_s)) == pytest.approx(math.pi / 4, abs=1e-7)


@given(INDEX, INDEX, ANGLES)
def test_flux_is_conserved_and_reversible(n1: float, n2: float, angle: float) -> None:
    cosine = math.cos(angle)
    r_s, r_p, t_s, t_p, cos_t = f.fresnel_amplitudes(n1 + 0j, n2 + 0j, cosine)
    tube = (n2 * cos_t).real / (n1 * cosine)
    for r, t in ((r_s, t_s), (r_p, t_p)):
        assert abs(r) ** 2 + tube * abs(t) ** 2 == pytest.approx(1.0, abs=1e-9)
    if cos_t.imag == 0 and cos_t.real > 0.01:
        # Stokes: r' = -r, t t' + r² = 1
        back = f.fresnel_amplitudes(n2 + 0j, n1 + 0j, cos_t.real)
        assert back[0] == pytest.approx(-r_s, abs=1e-9)
        assert t_s * back[2] + r_s * r_s == pytest.approx(1.0, abs=1e-9)


def test_metals() -> None:
    """Normal incidence: ((n - 1)² + k²) / ((n + 1)² + k²); grazing: everything."""
    n, k = 0.97, 6.2  # aluminium in the visible
    normal = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    assert f.fresnel_conductor(1.0, n, k, 1.0) == pytest.approx(normal)
    assert f.fresnel_conductor(1.0, n, k, 1e-9) == pytest.approx(1.0)
    assert f.fresnel_conductor(1.0, 1.5, 0.0, 0.3) == pytest.approx(
        f.fresnel_reflectance(1.0, 1.5, 0.3)
    )


@given(INDEX, INDEX, ANGLES, st.floats(0, 6.28))
def test_directions_obey_snell(n1: float, n2: float, angle: float, turn: float) -> None:
    rotation = np.linalg.qr(np.random.default_rng(int(turn * 1e6)).normal(size=(3, 3)))[0]
    normal = rotation @ [0.0, 0.0, 1.0]
    d = rotation @ [math.sin(angle), 0.0, -math.cos(angle)]
    mirrored = np.array(f.reflect(*d, *normal))
    assert mirrored @ normal == pytest.approx(-d @ normal, abs=1e-12)
    np.testing.assert_allclose(np.cross(mirrored, normal), np.cross(d, normal), atol=1e-12)
    *direction, cosine = f.refract(*d, *normal, n1 / n2)
    if n1 * math.sin(angle) > n2:
        assert cosine < 0
        return
    bent = np.array(direction)
    assert np.linalg.norm(bent) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(n2 * np.cross(bent, normal), n1 * np.cross(d, normal), atol=1e-9)
    assert bent @ normal == pytest.approx(-cosine, abs=1e-9)


@given(INDEX, INDEX, ANGLES, st.floats(0.0, 5.0))
def test_as_the_wave_vectors_say(n1: float, n2: float, angle: float, kappa: float) -> None:
    cosine = math.cos(angle)
    assert f.fresnel_reflectance(n1, n2, cosine) == pytest.approx(
        naive.fresnel_reflectance(n1, n2, cosine), abs=1e-9
    )
    assert f.fresnel_conductor(n1, n2, kappa, cosine) == pytest.approx(
        naive.fresnel_conductor(n1, n2, kappa, cosine), abs=1e-9
    )
    column = f.reflectance_column(n1, n2, [[cosine], [1.0]])
    assert column.shape == (2, 1)
    assert column[0, 0] == f.fresnel_reflectance(n1, n2, cosine)
