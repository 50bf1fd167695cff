"""Media of the catalogue in a scene: what they absorb, and that it is said where nobody knows.

Right values: what the sources in the data state (losses of optical plastics; absorption of
water by Hale and Querry's k of 1.96e-9 at 550 nm).
"""

from __future__ import annotations

import math
import warnings

import pytest

from raymap.model.events import Event
from tests.tracer.transport.tracing import assert_share, compiled, trace
from tracer.scene.media import MissingAbsorption

DECIBEL = 10.0 / math.log(10.0)
"""An absorption of 1 per unit of length in dB."""

ROD = """
[spectrum]
kind = "spectral"
wavelengths_nm = [550]
[media.m]
{medium}
[bodies.rod]
kind = "cylinder"
radius = 10
length = 1000
medium = "m"
[sources.s]
kind = "collimated"
position = [0, 0, -5]
direction = [0, 0, 1]
diameter = 1
"""


def through_a_metre(name: str, wavelength_nm: int) -> tuple[float, float]:
    """What each end of a rod reflects, and how many of 100,000 rays the rod absorbs."""
    text = ROD.format(medium=f'glass = "{name}"').replace("[550]", f"[{wavelength_nm}]")
    scene = compiled(text)
    n = scene.arrays.medium_f[2, 0]
    found = trace(scene, 100_000)
    return ((n - 1.0) / (n + 1.0)) ** 2, found.endings(Event.VOLUME_ABSORPTION)


@pytest.mark.parametrize(
    ("name", "wavelength_nm", "db_per_m"),
    [
        # Fibres: A. Argyros, ISRN Optics 2013, 785162, table 1
        ("PMMA", 650, 0.15),
        ("PC", 650, 0.5),
        ("PS", 670, 0.11),
        # Bulk glasses by laser calorimetry: 2e-4/cm
        ("PMMA", 500, 2e-2 * DECIBEL),
        ("PS", 500, 2e-2 * DECIBEL),
        # Zeon's table: 3 mm keep 0.998 and 0.999
        ("COP", 460, -math.log(0.998) / 0.003 * DECIBEL),
        ("COP", 480, -math.log(0.999) / 0.003 * DECIBEL),
        # Three digits of it say 1.000: 3 mm keep 0.9995 at least
        ("COP", 550, -math.log(0.99975) / 0.003 * DECIBEL),
    ],
)
def test_a_metre_of_plastic_absorbs_its_published_share(
    name: str, wavelength_nm: int, db_per_m: float
) -> None:
    back, absorbed = through_a_metre(name, wavelength_nm)
    kept = 10.0 ** (-db_per_m / 10.0)
    # Through the front; on each way along the rod a share is absorbed, at each end some turns
    expected = (1.0 - back) * (1.0 - kept) / (1.0 - back * kept)
    assert_share(absorbed, 100_000, expected)


def test_water_absorbs_by_the_measured_extinction() -> None:
    scene = compiled(ROD.format(medium='glass = "water"'))
    expected = 4.0 * math.pi * 1.96e-9 / 550e-6
    assert scene.channel_set.absorption[2][0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", ["NAS-21", "COC", "SAN", "diamond", "MgF2 o"])
def test_a_material_without_data_of_absorption_says_so_once(name: str) -> None:
    with pytest.warns(
        MissingAbsorption, match=f"absorption of 'm' .{name}.*absorption = 0"
    ) as said:
        compiled(ROD.format(medium=f'glass = "{name}"'))
    assert len(said) == 1


@pytest.mark.parametrize(
    "medium", ['glass = "COC"\nabsorption = 0', 'glass = "fused silica"', "index = 1.5"]
)
def test_nothing_is_said_where_the_absorption_is_known(medium: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compiled(ROD.format(medium=medium))
        # Nor of a medium that nothing consists of
        compiled(ROD.format(medium="index = 1.5") + '[media.spare]\nglass = "COC"')
