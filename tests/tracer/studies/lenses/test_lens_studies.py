"""Levels, the cone K and vignetting against closed forms and independent numbers."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.tracer.lens.lenses import LINE_D, N_D, biconvex, plate
from tracer.lens import LensError
from tracer.studies.lenses.cone import axial_cone, inside_cone, masked_cone
from tracer.studies.lenses.lens_beams import parallel_beam, point_beam
from tracer.studies.lenses.levels import level_shares, shares_by_height
from tracer.studies.lenses.vignetting import vignetting


@pytest.mark.parametrize(("depth", "degrees"), [(2, 23.376199), (3, 20.789603), (5, 16.929366)])
def test_cone_of_a_plate_is_exact(depth: int, degrees: float) -> None:
    a, d, far = 10.0, 5.0, 20.0
    exact = brentq(
        lambda t: far * math.tan(t) + (depth - 1) * d * math.tan(math.asin(math.sin(t) / N_D)) - a,
        0.0, 1.0, xtol=1e-14,
    )  # fmt: skip
    cone = axial_cone(plate(d), far, depth=depth, wavelength_nm=LINE_D)
    assert cone.half_angle == pytest.approx(exact, abs=1e-10)
    assert math.degrees(cone.half_angle) == pytest.approx(degrees, abs=5e-7)
    for side, belongs in ((-1e-6, True), (1e-6, False)):
        angle = exact + side
        d3 = [math.sin(angle), 0.0, math.cos(angle)]
        found = inside_cone(plate(d), (0, 0, -far), d3, depth=depth, wavelength_nm=LINE_D)
        assert found[0] == belongs


@pytest.mark.parametrize(
    ("distance", "depth", "degrees"),
    [
        (20.0, 1, 30.07),
        (20.0, 2, 28.89),
        (20.0, 5, 28.89),
        (100.0, 1, 7.01),
        (100.0, 6, 7.01),
        (100.0, 7, 6.95),
    ],
)
def test_cone_of_the_biconvex_lens(distance: float, depth: int, degrees: float) -> None:
    cone = axial_cone(biconvex(), distance, depth=depth, wavelength_nm=LINE_D)
    assert math.degrees(cone.half_angle) == pytest.approx(degrees, abs=0.006)
    if depth == 1:
        assert cone.half_angle == pytest.approx(math.atan(12.5 / (distance + 1.587708)), abs=1e-6)


def test_deeper_cones_lie_inside() -> None:
    angles = np.linspace(0.0, 0.6, 400)
    d = np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)], axis=1)
    masks = [
        inside_cone(biconvex(), (0, 0, -30.0), d, depth=depth, wavelength_nm=LINE_D)
        for depth in range(1, 9)
    ]
    for shallow, deep in pairwise(masks):
        assert not np.any(deep & ~shallow)


def test_off_axis_mask() -> None:
    on_axis = masked_cone(biconvex(), (0.0, 0.0, -20.0), depth=3, wavelength_nm=LINE_D)
    axial = axial_cone(biconvex(), 20.0, depth=3, wavelength_nm=LINE_D)
    assert on_axis.half_angle == pytest.approx(axial.half_angle, abs=1e-9)
    off = masked_cone(biconvex(), (4.0, 0.0, -20.0), depth=3, wavelength_nm=LINE_D)
    assert 0.0 < off.half_angle < on_axis.half_angle
    np.testing.assert_array_equal(off.mask, off.mask[::-1])  # symmetric about the plane y = 0
    assert not np.array_equal(off.mask, off.mask[:, ::-1])
    # Everything inside the round cone belongs to K, and just outside it something does not
    chief = np.array([-4.0, 0.0, 20.0]) / math.hypot(4.0, 20.0)
    side, up = np.array([chief[2], 0.0, -chief[0]]), np.array([0.0, 1.0, 0.0])
    turn = np.linspace(0.0, 2.0 * math.pi, 720)[:, np.newaxis]
    for angle, everywhere in ((0.999 * off.half_angle, True), (1.001 * off.half_angle, False)):
        d = math.cos(angle) * chief + math.sin(angle) * (np.cos(turn) * side + np.sin(turn) * up)
        belongs = inside_cone(biconvex(), (4.0, 0.0, -20.0), d, depth=3, wavelength_nm=LINE_D)
        assert belongs.all() == everywhere
    with pytest.raises(LensError, match="point"):
        masked_cone(biconvex(), (0.0, 0.0, 3.0), depth=3, wavelength_nm=LINE_D)
    with pytest.raises(LensError, match="distance"):
        axial_cone(biconvex(), -1.0, depth=3, wavelength_nm=LINE_D)


def test_levels_of_a_narrow_beam_are_the_series_on_axis() -> None:
    lens = plate(3.0, semi_aperture=100.0)
    beam = parallel_beam(lens, 500, wavelength_nm=LINE_D)
    shares = level_shares(lens, beam, depth=5)
    r = ((N_D - 1.0) / (N_D + 1.0)) ** 2
    np.testing.assert_allclose(shares.share, [r] + [(1 - r) ** 2 * r**k for k in range(4)])
    assert shares.remainder == pytest.approx((1.0 - r) * r**4)
    assert shares.missed == 0.0


def test_levels_add_up_and_match_single_rays() -> None:
    lens = biconvex()
    beam = point_beam(lens, (3.0, -2.0, -40.0), 2000, wavelength_nm=LINE_D)
    shares = level_shares(lens, beam, depth=7)
    total = shares.share.sum() + shares.glass + shares.rim + shares.remainder
    assert total == pytest.approx(1.0, abs=1e-12)
    by_height = shares_by_height(lens, [0.0, 5.0, 10.0], wavelength_nm=LINE_D, mode="polarized")
    assert by_height[1, 1] == pytest.approx(0.920095468, abs=5e-10)
    assert by_height[2, 3] == 0.0


def test_vignetting_of_a_tube() -> None:
    """A long plate: the share transmitted is the overlap of two discs, shifted by refraction."""
    lens = plate(10.0, semi_aperture=5.0)
    result = vignetting(lens, [0.0, 20.0, 40.0], wavelength_nm=LINE_D, rays=40_000, depth=4)
    assert result.rim_hits[0] == 0
    assert result.transmitted[0] == 1.0
    for row, degrees in ((1, 20.0), (2, 40.0)):
        shift = 10.0 * math.tan(math.asin(math.sin(math.radians(degrees)) / N_D)) / 10.0
        overlap = 2.0 / math.pi * (math.acos(shift) - shift * math.sqrt(1.0 - shift * shift))
        assert result.transmitted[row] == pytest.approx(overlap, abs=2e-3)
        assert result.rim_direct[row] == pytest.approx(1.0 - overlap, abs=2e-3)
        assert result.rim_outside[row] == 0.0
