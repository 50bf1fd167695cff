"""What a channel is worth: watt, lumen and colour against formulas written down by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from raymap.model.directory import ChannelSet, Directory, Source
from raymap.optics.colorimetry import chromaticity, photopic, xyz_to_linear_srgb
from raymap.optics.photometry import (
    Photometry,
    channel_efficacy,
    channel_rgb,
    channel_xyz,
    colors_of_codes,
    displayed,
)

NM = (450.0, 550.0, 610.0)
RGB = ChannelSet(kind="rgb", wavelengths_nm=(611, 549, 464), source_colors=((0.25, 0.25, 0.5),))


def spectral(*colors: tuple[float, ...]) -> ChannelSet:
    return ChannelSet(kind="spectral", wavelengths_nm=NM, source_colors=colors)


def directory(unit: str, *fluxes: float) -> Directory:
    sources = tuple(Source(name=f"s{k}", flux=flux) for k, flux in enumerate(fluxes))
    return Directory(flux_unit=unit, sources=sources)


def test_two_lines_of_which_one_is_filtered_out() -> None:
    """100 lm of 450 and 550 nm in equal power; 550 nm alone keeps V(550) / (V(450) + V(550))."""
    light = Photometry(directory("lm", 100.0), spectral((0.5, 0.5, 0.0)))
    v = photopic(NM)
    left = 100.0 * 0.5 * light.worth([[0.0, 1.0, 0.0]])[0, 0]
    assert left == pytest.approx(100 * v[1] / (v[0] + v[1]), rel=3e-5)
    assert left == pytest.approx(96.32, abs=0.01)
    # The same in watt
    watt = Photometry(directory("W", float(light.radiant_fluxes[0])), spectral((0.5, 0.5, 0.0)))
    assert watt.worth([[0.0, 1.0, 0.0]])[0, 0] == 1.0
    assert 0.5 * watt.radiant_fluxes[0] * watt.efficacy[1] == pytest.approx(left)
    assert light.radiant_fluxes[0] * (683 * 0.5 * (v[0] + v[1])) == pytest.approx(100, rel=3e-5)


def test_rgb_is_amounts_of_linear_srgb() -> None:
    """IEC 61966-2-1: Y = 0.2126 R + 0.7152 G + 0.0722 B; white has 179 lm/W."""
    light = Photometry(directory("lm", 100.0), RGB)
    y = 0.2126 * 0.25 + 0.7152 * 0.25 + 0.0722 * 0.5
    np.testing.assert_allclose(light.channel_worth[0], np.array((0.2126, 0.7152, 0.0722)) / y, 1e-4)
    white = np.full(3, 1 / 3)
    assert white @ channel_efficacy(RGB) == pytest.approx(179.0)
    # D65 (CIE 15): x = 0.3127, y = 0.3290
    np.testing.assert_allclose(chromaticity(white @ channel_xyz(RGB)), (0.3127, 0.3290), atol=1e-9)
    np.testing.assert_allclose(channel_rgb(RGB), np.eye(3))


def test_light_of_unknown_colour_is_worth_its_weight() -> None:
    silent = ChannelSet(kind="spectral", wavelengths_nm=NM)
    light = Photometry(directory("lm", 5.0, 7.0), silent)
    shares = np.array([[1.0, 0.0, 0.0], [0.2, 0.3, 0.5]])
    assert not light.changes
    assert (light.worth(shares) == 1.0).all()
    # Their watts are those that make these lumens
    np.testing.assert_allclose(light.amounts(shares) @ light.efficacy, 1.0)
    single = ChannelSet(kind="spectral", wavelengths_nm=(550.0,))
    assert Photometry(directory("lm", 683.0), single).radiant_fluxes[0] == pytest.approx(
        1 / photopic(550.0)
    )


def test_sources_that_differ_count_in_one_currency() -> None:
    """Lumens of sources of different spectrum and share become watt by the light of each."""
    light = Photometry(directory("lm", 30.0, 90.0), spectral((1.0, 0.0, 0.0), (0.0, 0.5, 0.5)))
    emitted = np.array([700, 300])
    watts = light.radiant_factors(emitted) * emitted
    np.testing.assert_allclose(watts * light.emitted_efficacy, (30.0, 90.0))
    assert light.result_factor(emitted) == pytest.approx(watts.sum() / 1000)
    assert light.radiant_factors(np.array([0, 1]))[0] == 0.0


def test_mixed_light_is_brought_into_the_gamut_once() -> None:
    """Equal energy of many channels is nearly white; single wavelengths lie outside the gamut."""
    channels = ChannelSet(kind="spectral", wavelengths_nm=tuple(np.arange(400.0, 701.0, 5.0)))
    n = channels.n_channels
    whole = displayed(channels, np.full(n, 1 / n))
    expected = xyz_to_linear_srgb(channel_xyz(channels).sum(axis=0))
    np.testing.assert_allclose(whole / whole[1], expected / expected[1], rtol=1e-9)
    each = displayed(channels, np.eye(n))
    assert (channel_rgb(channels) < 0).any()
    assert (each >= 0).all()
    # Summed after each was clipped, the mixture is far too red
    clipped = each.mean(axis=0)
    assert abs(clipped[0] / clipped[2] - whole[0] / whole[2]) > 0.1


def test_stated_false_colours_are_kept() -> None:
    infrared = ChannelSet(
        kind="spectral", wavelengths_nm=(1064.0, 1550.0), display_rgb=((1, 0, 0), (0, 0, 1))
    )
    np.testing.assert_array_equal(channel_rgb(infrared), [[1, 0, 0], [0, 0, 1]])
    seen = ChannelSet(kind="spectral", wavelengths_nm=NM)
    stored = seen.model_copy(
        update={"display_rgb": tuple(map(tuple, displayed(seen, np.eye(3)).tolist()))}
    )
    # Maps of old state colours that were clipped one by one
    np.testing.assert_allclose(channel_rgb(stored), channel_rgb(seen))


@pytest.mark.parametrize(
    ("fields", "match"),
    [
        ({"kind": "rgb", "wavelengths_nm": NM[:2]}, "three channels, not 2"),
        ({"kind": "spectral", "source_colors": ((0.5, 0.5), (1.0,))}, "source_colors has rows"),
    ],
)
def test_sets_that_contradict_themselves_are_refused(fields: dict[str, Any], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        ChannelSet(**{"wavelengths_nm": NM, **fields})


def test_shares_by_code() -> None:
    table = np.array([[65535, 0, 0], [13107, 13107, 39321]], np.uint16)
    np.testing.assert_allclose(colors_of_codes(table, 3), [*np.eye(3), [1, 0, 0], [0.2, 0.2, 0.6]])
