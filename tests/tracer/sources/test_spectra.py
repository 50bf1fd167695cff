"""Spectra in the scene description."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from raymap.model.errors import SceneError
from raymap.optics.colorimetry import luminous_efficacy
from tracer.sources.spectra import SpectrumModel, convert_flux, source_shares


@pytest.mark.parametrize(
    "text",
    [
        {"illuminant": "D65"},
        {"blackbody": 3000},
        {"led": {"peak_nm": 525}},
        {"white_led": {}},
        {"lines": {"wavelength_nm": [486.1, 656.3], "power": [1, 2]}},
        {"color": [0.9, 0.6, 0.2]},
    ],
)
def test_every_kind_gives_shares(text: dict[str, object]) -> None:
    light = SpectrumModel.model_validate(text).build()
    channels = np.linspace(380.0, 780.0, 41)
    for shares in (
        source_shares(light, channels, rgb=False),
        source_shares(light, channels[:3], rgb=True),
    ):
        assert shares.sum() == pytest.approx(1.0)
        assert shares.min() >= 0.0


def test_flux_changes_unit_through_the_spectrum() -> None:
    green = SpectrumModel.model_validate({"lines": {"wavelength_nm": [555], "power": [1]}}).build()
    line = np.array([555.0])
    assert convert_flux(683.0, "lm", "W", green, wavelengths_nm=line) == pytest.approx(1.0)
    assert convert_flux(2.0, "W", "lm", green) == pytest.approx(1366.0)
    assert convert_flux(5.0, "lm", "lm", None) == 5.0
    # With few channels, what they carry counts
    day = SpectrumModel.model_validate({"illuminant": "D65"}).build()
    channels = np.array([450.0, 550.0, 650.0])
    watt = convert_flux(100.0, "lm", "W", day, wavelengths_nm=channels)
    carried = watt * source_shares(day, channels, rgb=False) @ luminous_efficacy(channels)
    assert carried == pytest.approx(100.0)
    # In RGB one constant makes lumens of watts, 179 lm/W of R = G = B, and watts of lumens
    white = SpectrumModel(color=(1.0, 1.0, 1.0)).build()
    assert convert_flux(358.0, "lm", "W", white) == pytest.approx(2.0, rel=2e-2)
    infrared = SpectrumModel.model_validate({"led": {"peak_nm": 940}}).build()
    with pytest.raises(SceneError, match="'ir': the eye sees none"):
        convert_flux(1.0, "lm", "W", infrared, name="ir")
    with pytest.raises(SceneError, match="'lamp': flux in lm cannot become W without a spectrum"):
        convert_flux(1.0, "lm", "W", None, name="lamp")


def test_one_key_only() -> None:
    with pytest.raises(ValidationError, match="exactly one of"):
        SpectrumModel.model_validate({"illuminant": "A", "blackbody": 3000})
    with pytest.raises(ValidationError, match="exactly one of"):
        SpectrumModel.model_validate({})
    with pytest.raises(SceneError, match="no illuminant"):
        SpectrumModel.model_validate({"illuminant": "X9"}).build()
