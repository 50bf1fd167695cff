"""Pictures through a lens: what differs between their ways of computing, and what does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.lens import Glass, Lens
from tracer.studies.lenses.lens_pictures import Board, LensCamera, lens_picture
from tracer.studies.lenses.newton_rings import newton_rings

CAMERA = LensCamera(eye=(0.0, 0.0, -70.0), half_angle_deg=15.0, pixels=24, samples=1)
LENS = Lens(
    radius_front=50.0, radius_back=-50.0, thickness=9.0, semi_aperture_front=16.0,
    glass=Glass.named("N-SF11"),
)  # fmt: skip


def test_white_furnace() -> None:
    """In front of light from everywhere the lens itself is invisible, but for rim and remainder."""
    everywhere = Board(light=1.0, dark=1.0, background=1.0)
    clear = Lens(
        radius_front=50.0, radius_back=-50.0, thickness=9.0, semi_aperture_front=16.0, glass=1.5
    )
    for rules in ("fresnel", "schlick"):
        picture = lens_picture(
            clear, camera=CAMERA, board=everywhere, color="rgb", depth=40, rules=rules
        )
        assert picture.max() < 1.0 + 1e-12
        assert np.median(picture) == pytest.approx(1.0, abs=1e-9)


def test_fringes_are_spectral_and_the_analyser_shows_schlick_wrong() -> None:
    spectral = lens_picture(LENS, camera=CAMERA, depth=2, spectral_samples=9)
    rgb = lens_picture(LENS, camera=CAMERA, depth=2, color="rgb")
    colorfulness = [np.abs(p - p.mean(axis=2, keepdims=True)).max() for p in (spectral, rgb)]
    assert colorfulness[0] > 0.1
    assert colorfulness[1] < 0.02  # the glass absorbs a little more blue
    exact, approximate = (
        lens_picture(LENS, camera=CAMERA, color="rgb", rules=rules, analyser_deg=0.0, depth=3)
        for rules in ("fresnel", "schlick")
    )
    # Light across the plane of incidence and light in it differ left and above
    assert np.abs(exact - approximate).max() > 0.01
    turned = lens_picture(LENS, camera=CAMERA, color="rgb", analyser_deg=90.0, depth=3)
    assert np.abs(exact - turned).max() > 0.01
    both = lens_picture(LENS, camera=CAMERA, color="rgb", depth=3)
    np.testing.assert_allclose(exact + turned, both, atol=5e-3)


def test_glasses_by_name() -> None:
    glass = Glass.of("N-SF11")
    assert isinstance(glass, Glass)
    assert float(glass.index(587.5618)) == pytest.approx(1.78472, abs=1e-5)
    assert float(Glass.named("N-BK7").absorption(400.0)) == pytest.approx(
        -math.log(0.99679) / 10.0, rel=1e-6
    )
    assert Glass.of("1.7") == 1.7
    with pytest.raises(SceneError, match="N-BK8"):
        Glass.of("N-BK8")


def test_newton_rings_by_both_rules() -> None:
    r = np.sqrt(np.array([0.0, 0.5, 1.0, 1.5, 2.0]) * 589.3e-6 * 1000.0)
    right = newton_rings(1000.0, r, wavelength_nm=589.3)
    assert np.all(right[[0, 2, 4]] < 1e-3 * right[1])
    # The published rule for light across the plane of incidence turns bright and dark around
    r[0] = 1e-3
    across = (0.0, 1.0, 0.0)
    wrong = newton_rings(1000.0, r, wavelength_nm=589.3, mode="published", vibration=across)
    assert np.all(wrong[[1, 3]] < 1e-3 * wrong[0])
    same = newton_rings(1000.0, r, wavelength_nm=589.3, vibration=across)
    np.testing.assert_allclose(same, right, atol=1e-5)
    four = 4.0 * 0.04 * (1.0 - 0.04) ** 2 * math.sqrt(1.0)
    assert right[1] == pytest.approx(four, rel=0.05)
