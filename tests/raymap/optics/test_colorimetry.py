"""Colour and light: published chromaticities, definitions, and an independent package."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raymap.optics import colorimetry as c

GRID = np.arange(360.0, 831.0)


@pytest.mark.parametrize(
    ("illuminant", "xy"),
    [
        (c.illuminant_a, (0.44758, 0.40745)),
        (c.illuminant_d65, (0.31272, 0.32903)),
        (c.illuminant_e, (0.33331, 0.33329)),
    ],
)
def test_published_chromaticities_of_illuminants(illuminant, xy) -> None:  # type: ignore[no-untyped-def]
    """CIE 015:2018, table of chromaticities for the 2° observer."""
    found = c.chromaticity(c.spectrum_to_xyz(GRID, illuminant(GRID)))
    np.testing.assert_allclose(found, xy, atol=2e-5)


def test_the_observer_sees_best_at_555_nm() -> None:
    assert c.photopic(555.0) == 1.0
    assert c.luminous_efficacy(555.0) == 683.0
    assert c.photopic([300.0, 900.0]).tolist() == [0.0, 0.0]
    np.testing.assert_allclose(c.photopic([450, 510, 600]), [0.038, 0.503, 0.631])
    # The equal-energy spectrum has 683 times the area of V over its width
    assert c.spectrum_luminous_efficacy(GRID, c.illuminant_e(GRID)) == pytest.approx(
        683 * 106.857 / 470, rel=1e-4
    )


def test_white_and_primaries_of_srgb() -> None:
    np.testing.assert_allclose(c.linear_srgb_to_xyz([1, 1, 1]), [0.95046, 1.0, 1.08906], atol=1e-4)
    np.testing.assert_allclose(c.chromaticity(c.linear_srgb_to_xyz([0, 1, 0])), [0.3, 0.6])
    np.testing.assert_allclose(c.linear_srgb_to_xyz(np.eye(3))[:, 1], c.RGB_LUMINANCE, atol=5e-5)


def test_rgb_wavelengths_are_the_dominant_ones_of_the_primaries() -> None:
    """White, primary and the spectral colour lie on one line of the chromaticity diagram."""
    white = c.chromaticity(c.linear_srgb_to_xyz([1, 1, 1]))
    for primary, wavelength in zip(np.eye(3), c.RGB_WAVELENGTHS_NM, strict=True):
        p = c.chromaticity(c.linear_srgb_to_xyz(primary)) - white
        q = c.chromaticity(c.color_matching(wavelength)) - white
        sine = (p[0] * q[1] - p[1] * q[0]) / np.linalg.norm(p) / np.linalg.norm(q)
        assert abs(sine) < 0.02
        assert p @ q > 0


def test_transfer_function_meets_its_standard() -> None:
    # IEC 61966-2-1: the end of the linear part, photographic grey, half of the encoded range
    values = c.encode_srgb([0.0, 0.0031308, 0.18, 0.2140411, 1.0, 2.0])
    np.testing.assert_allclose(values, [0, 0.0404482, 0.4613561, 0.5, 1, 1], atol=2e-5)


@given(st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_transfer_function_and_matrix_are_inverted(rgb: list[float]) -> None:
    np.testing.assert_allclose(c.decode_srgb(c.encode_srgb(rgb)), rgb, atol=1e-6)
    np.testing.assert_allclose(c.xyz_to_linear_srgb(c.linear_srgb_to_xyz(rgb)), rgb, atol=1e-12)


@given(st.lists(st.floats(-1, 2), min_size=3, max_size=3))
def test_gamut_mapping_keeps_luminance_and_what_is_inside(rgb: list[float]) -> None:
    mapped = c.into_gamut(rgb)
    assert np.all(mapped >= 0)
    luminance = float(np.dot(rgb, c.RGB_LUMINANCE))
    if luminance >= 0:
        assert np.dot(mapped, c.RGB_LUMINANCE) == pytest.approx(luminance, abs=1e-9)
    if min(rgb) >= 0:
        np.testing.assert_array_equal(mapped, rgb)


def test_channels_of_equal_energy_have_mean_luminance_one() -> None:
    rgb = c.channel_display_rgb(np.linspace(400, 700, 11), gamut=False)
    assert (rgb @ c.linear_srgb_to_xyz(np.eye(3))[:, 1]).mean() == pytest.approx(1.0)
    assert np.all(c.channel_display_rgb([450, 530, 620], gamut=True) >= 0)
    assert c.channel_display_rgb([1064.0], gamut=True).tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.peers
@pytest.mark.filterwarnings("ignore")
def test_colour_science_agrees() -> None:
    colour = pytest.importorskip("colour")
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    np.testing.assert_allclose(c.color_matching(observer.wavelengths), observer.values, rtol=1e-9)
    for name, own in (("A", c.illuminant_a), ("D65", c.illuminant_d65)):
        other = colour.SDS_ILLUMINANTS[name]
        np.testing.assert_allclose(own(other.wavelengths), other.values, rtol=2e-4)
    values = np.linspace(0, 1, 50)
    np.testing.assert_allclose(c.encode_srgb(values), colour.cctf_encoding(values), atol=1e-7)
    rgb = np.random.default_rng(1).random((10, 3))
    other_xyz = colour.RGB_to_XYZ(rgb, "sRGB", apply_cctf_decoding=False)
    np.testing.assert_allclose(c.linear_srgb_to_xyz(rgb), other_xyz, atol=2e-4)
