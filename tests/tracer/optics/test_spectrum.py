"""Spectra of sources: known colours, efficacies, and where their power goes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.model.errors import SceneError
from raymap.optics import colorimetry
from tracer.optics import spectrum as s
from tracer.optics.dispersion import OutOfRangeWarning


@pytest.mark.parametrize(
    ("name", "xy"),
    [
        ("A", (0.44758, 0.40745)),
        ("D50", (0.34567, 0.35850)),
        ("D65", (0.31272, 0.32903)),
        ("E", (1 / 3, 1 / 3)),
        ("FL2", (0.37208, 0.37529)),
        ("FL11", (0.38052, 0.37713)),
        ("LED-B3", (0.3756, 0.3723)),
    ],
)
def test_published_chromaticities(name: str, xy: tuple[float, float]) -> None:
    """CIE 015:2018, tables 10 and 11."""
    np.testing.assert_allclose(colorimetry.chromaticity(s.illuminant(name).xyz), xy, atol=2e-3)


def test_planck() -> None:
    """Wien's law, and the ratio of two wavelengths."""
    hot = s.blackbody(5000.0)
    assert hot.wavelength_nm[np.argmax(hot.power_per_nm)] == pytest.approx(
        2.8977719e6 / 5000, abs=1
    )
    a, b = (float(np.interp(w, hot.wavelength_nm, hot.power_per_nm)) for w in (500, 700))
    planck = [w**-5 / math.expm1(1.438776877e7 / (w * 5000)) for w in (500, 700)]
    assert a / b == pytest.approx(planck[0] / planck[1], rel=1e-9)
    # Colour of 2856 K is that of illuminant A
    np.testing.assert_allclose(
        colorimetry.chromaticity(s.blackbody(2855.5).xyz), (0.44758, 0.40745), atol=2e-4
    )
    assert s.blackbody(100.0).power > 0


def test_luminous_efficacy() -> None:
    green = s.lines([555.0], [2.0])
    assert green.luminous_efficacy == pytest.approx(683.0)
    assert green.radiant_from_luminous(683.0) == pytest.approx(1.0)
    assert green.luminous_from_radiant(2.0) == pytest.approx(1366.0)
    sodium = s.lines([589.0, 589.6], [2.0, 1.0])
    assert sodium.luminous_efficacy == pytest.approx(683 * 0.7665, rel=5e-3)
    with pytest.raises(SceneError, match=r"invisible.*give it in watt"):
        s.lines([1064.0], [1.0]).radiant_from_luminous(1.0)
    with pytest.raises(SceneError, match=r"invisible.*trace wavelengths"):
        s.lines([1064.0], [1.0]).rgb_shares()


def test_leds() -> None:
    red = s.led(630.0, 18.0)
    assert red.power == pytest.approx(1.0, abs=1e-5)
    half = np.interp([621.0, 639.0], red.wavelength_nm, red.power_per_nm)
    np.testing.assert_allclose(half, red.power_per_nm.max() / 2, rtol=1e-3)
    cold, warm = (s.phosphor_led(blue_share=share) for share in (0.4, 0.15))
    assert cold.power == pytest.approx(1.0, abs=1e-3)
    assert cold.rgb_shares()[2] > warm.rgb_shares()[2]
    assert 250 < warm.luminous_efficacy < 450


def test_channels_share_the_power() -> None:
    channels = [450.0, 550.0, 650.0]
    assert s.channel_bands(channels).tolist() == [400, 500, 600, 700]
    flat = s.equal_energy(range_nm=(400, 700))
    np.testing.assert_allclose(flat.channel_shares(channels), 1 / 3)
    # A line at a limit belongs to the upper band; a single channel takes everything
    np.testing.assert_allclose(
        s.lines([500, 450], [1, 3]).channel_shares(channels), [0.75, 0.25, 0]
    )
    assert s.illuminant("D65").channel_shares([550.0]).tolist() == [1.0]
    # Half of a triangle's power lies in its middle half: 3/4
    triangle = s.tabulated_spectrum(np.arange(400, 801, 20), 1 - np.abs(np.linspace(-1, 1, 21)))
    np.testing.assert_allclose(
        triangle.channel_shares([450, 550, 650, 750]), [1 / 8, 3 / 8, 3 / 8, 1 / 8]
    )


def test_power_outside_the_channels() -> None:
    wide = s.tabulated_spectrum(np.arange(360, 831, 10), np.ones(48))
    with pytest.warns(OutOfRangeWarning, match=r"'table': 36\.2 % of its power"):
        wide.channel_shares([450, 550, 650])
    # The range of an illuminant is only a convention
    np.testing.assert_allclose(s.equal_energy().channel_shares([450, 550, 650]), 1 / 3)
    with pytest.raises(SceneError, match="no power in the channels"):
        s.lines([1064.0], [1.0]).channel_shares([450, 550])


def test_efficacy_as_channels_carry_it() -> None:
    """With fine channels it is that of the spectrum."""
    light = s.illuminant("D65")
    fine = light.channel_efficacy(np.arange(361, 830, 2.0))
    assert fine == pytest.approx(light.luminous_efficacy, rel=2e-3)
    assert s.lines([555.0], [1.0]).channel_efficacy([555.0]) == 683.0


def test_rgb() -> None:
    np.testing.assert_allclose(s.illuminant("D65").rgb_shares(), 1 / 3, atol=2e-3)
    for color in ([1.0, 1.0, 1.0], [0.2, 0.7, 0.1], [0.9, 0.1, 0.3]):
        shares = s.rgb_spectrum(color).rgb_shares()
        np.testing.assert_allclose(shares, np.array(color) / sum(color), atol=2e-3)
    assert s.rgb_spectrum([1, 0, 0]).rgb_shares()[0] > 0.98


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: s.tabulated_spectrum([400, 500, 510], [1, 1, 1]), "gap from 400 to 500 nm"),
        (lambda: s.tabulated_spectrum([400, 410, 420], [1, np.nan, 1]), "gap: row 2 is empty"),
        (lambda: s.tabulated_spectrum([400, 410, 410], [1, 1, 1]), "410 nm stands twice"),
        (lambda: s.tabulated_spectrum([400, 410], [0, -1]), "must not be negative"),
        (lambda: s.tabulated_spectrum([400], [1]), "two or more"),
        (lambda: s.lines([], []), "as many powers"),
        (lambda: s.lines([500], [0]), "must be positive"),
        (lambda: s.blackbody(0), "100 .. 1e6 K"),
        (lambda: s.led(500, 0), "must be positive"),
        (lambda: s.phosphor_led(blue_share=2), "between 0 and 1"),
        (lambda: s.rgb_spectrum([0, 0, 0]), "not all 0"),
        (lambda: s.illuminant("D66"), "no illuminant 'D66'; the nearest names are D65"),
        (lambda: s.channel_bands([500, 400]), "must rise"),
        (lambda: s.channel_bands([0.0]), "positive numbers"),
    ],
)
def test_bad_input_is_refused(build, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SceneError, match=words):
        build()


def test_efficacies_of_illuminants_are_over_one_range() -> None:
    """A by Planck's law, E by its definition, D65 by its published table: 360 to 830 nm, each."""
    nm = np.arange(360.0, 831.0, 1.0)
    v = colorimetry.photopic(nm)
    planck = nm**-5 / np.expm1(1.435e7 / (2848.0 * nm))
    for name, power in (("A", planck), ("E", np.ones_like(nm))):
        expected = 683.0 * np.trapezoid(v * power, nm) / np.trapezoid(power, nm)
        assert s.illuminant(name).luminous_efficacy == pytest.approx(expected, rel=1e-4), name
    for name in ("A", "E", "D50", "D55", "D65", "D75"):
        light = s.illuminant(name)
        assert (light.wavelength_nm[0], light.wavelength_nm[-1]) == (360.0, 830.0), name
    # ISO/CIE 11664-2, table 1
    d65 = s.illuminant("D65")
    for at, power in ((360.0, 46.6383), (780.0, 63.3828), (800.0, 59.4519), (830.0, 60.3125)):
        assert np.interp(at, d65.wavelength_nm, d65.power_per_nm) == pytest.approx(power, abs=1e-3)


@pytest.mark.peers
@pytest.mark.filterwarnings("ignore")
def test_daylight_beyond_780_nm_is_that_of_its_definition() -> None:
    """S₀ + M₁ S₁ + M₂ S₂ of CIE 015, section 4.1.2, with the components of colour-science."""
    pytest.importorskip("colour")
    from colour.colorimetry import SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES as COMPONENTS

    m1, m2 = -0.295, -0.689  # of D65, to three decimals as the standard has them
    s0, s1, s2 = (COMPONENTS[name] for name in ("S0", "S1", "S2"))
    light = s.illuminant("D65")
    seen = (s0.wavelengths >= 360.0) & (s0.wavelengths <= 830.0)
    own = np.interp(s0.wavelengths[seen], light.wavelength_nm, light.power_per_nm)
    expected = (s0.values + m1 * s1.values + m2 * s2.values)[seen]
    np.testing.assert_allclose(own, expected, rtol=2e-3)
