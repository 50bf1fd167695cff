"""Polarisers, retarders and diaphragms: textbook cases."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tracer.optics.polarization import stokes
from tracer.optics.polarization_elements import (
    Diaphragm,
    Polarizer,
    Retarder,
    polarize,
    retard,
    to_plane,
)
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays

Z = np.array([0.0, 0.0, 1.0])
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def beam(degrees: float = 0.0, wavelength_nm: float = 550.0) -> PolarizedRays:
    angle = math.radians(degrees)
    return PolarizedRays.linear(
        [[0.0, 0.0, -1.0]],
        [Z],
        [[math.cos(angle), math.sin(angle), 0.0]],
        wavelength_nm=wavelength_nm,
    )


@pytest.mark.parametrize("degrees", [0.0, 17.0, 45.0, 80.0, 90.0])
def test_malus(degrees: float) -> None:
    passed = Polarizer.at_angle(degrees)(beam()).flux[0]
    assert passed == pytest.approx(math.cos(math.radians(degrees)) ** 2, abs=1e-15)
    leaky = Polarizer.at_angle(degrees, extinction=1e-3)(beam()).flux[0]
    assert leaky == pytest.approx(passed + 1e-3 * (1.0 - passed), abs=1e-15)


@pytest.mark.parametrize("chi", [0.0, 30.0, 90.0])
@pytest.mark.parametrize("phi", [0.0, 12.0, 45.0, 70.0])
@pytest.mark.parametrize("difference_nm", [0.0, 137.5, 275.0, 551.0])
def test_retarder_between_polarisers(chi: float, phi: float, difference_nm: float) -> None:
    train = [Retarder.at_angle(phi, difference_nm), Polarizer.at_angle(chi, z=1.0)]
    rays = beam()
    for element in train:
        rays = element(rays)
    c, p = math.radians(chi), math.radians(phi)
    delta = 2.0 * math.pi * difference_nm / 550.0
    expected = math.cos(c) ** 2 - math.sin(2 * p) * math.sin(2 * (p - c)) * math.sin(delta / 2) ** 2
    assert rays.flux[0] == pytest.approx(expected, abs=1e-14)


def test_quarter_wave_plate_makes_circular_light() -> None:
    # The slow axis at 45° delays the vibration along it: left-handed by Born & Wolf
    e = retard(X, Z, X + Y, math.pi / 2.0)
    np.testing.assert_allclose(np.abs(stokes(e, X, Y)), [1, 0, 0, 1], atol=1e-15)
    slow, fast = (X + Y) / math.sqrt(2), (X - Y) / math.sqrt(2)
    assert np.angle((e @ slow) / (e @ fast)) == pytest.approx(math.pi / 2.0)
    np.testing.assert_allclose(retard(e, Z, X + Y, -math.pi / 2.0), X, atol=1e-15)


def test_oblique_rays_through_a_sheet() -> None:
    """The transmitted vibration is across both the ray and the absorption axis."""
    d = np.array([0.3, 0.4, math.sqrt(0.75)])
    t = np.cross(d, X) / np.linalg.norm(np.cross(d, X))
    e = np.cross(d, [0.2, -0.5, 0.7])
    out = polarize(e, d, X)
    assert abs(out @ X) < 1e-15
    assert abs(out @ d) < 1e-15
    np.testing.assert_allclose(out, (e @ t) * t, atol=1e-15)
    np.testing.assert_allclose(polarize(out, d, X), out, atol=1e-15)


def test_planes_add_optical_path_and_diaphragms_stop_rays() -> None:
    d = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.0, -1.0]])
    rays = PolarizedRays.linear(np.zeros(3), d, [Y] * 3, wavelength_nm=500.0)
    there = to_plane(rays, (0.0, 0.0, 4.0), Z, index=1.5)
    assert len(there) == 2
    np.testing.assert_allclose(there.origin, [[0, 0, 4], [3, 0, 4]], atol=1e-14)
    np.testing.assert_allclose(there.optical_path, [6.0, 7.5])
    assert len(Diaphragm(radius=2.9, center=(0.0, 0.0, 4.0))(rays)) == 1
    assert len(Diaphragm(radius=3.1, center=(0.0, 0.0, 4.0))(rays)) == 2


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Polarizer(absorption_axis=(0.0, 0.0, 0.0)), "absorption_axis"),
        (lambda: Polarizer.at_angle(0.0, extinction=2.0), "extinction"),
        (lambda: Retarder(slow_axis=(0.0, 0.0, 0.0), path_difference_nm=1.0), "slow_axis"),
        (lambda: Diaphragm(radius=0.0), "radius"),
    ],
)
def test_impossible_elements_are_refused(make: object, named: str) -> None:
    with pytest.raises(PolarizationError, match=named):
        make()  # type: ignore[operator]
