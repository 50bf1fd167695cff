"""Photometry and colour."""

from __future__ import annotations

import numpy as np

from raymap import colorimetry
from tests.validation import Row, check

GRID = np.arange(360.0, 831.0)


@check(
    what="Chromaticity of illuminants, 2° observer",
    source="CIE 015:2018, tables of illuminants A, D65 and E",
)
def chromaticities() -> list[Row]:
    rows = []
    for name, illuminant, xy in (
        ("A", colorimetry.illuminant_a, (0.44758, 0.40745)),
        ("D65", colorimetry.illuminant_d65, (0.31272, 0.32903)),
        ("E", colorimetry.illuminant_e, (0.33331, 0.33329)),
    ):
        found = colorimetry.chromaticity(colorimetry.spectrum_to_xyz(GRID, illuminant(GRID)))
        rows += [
            Row(expected=e, got=float(g), tolerance=2e-5, of=f"{name}, {axis}")
            for axis, e, g in zip("xy", xy, found, strict=True)
        ]
    return rows


@check(
    what="V(λ)",
    source="CIE 018:2019, 2° photopic observer",
)
def photopic() -> list[Row]:
    table = {450.0: 0.038, 510.0: 0.503, 555.0: 1.0, 600.0: 0.631}
    return [
        Row(expected=v, got=float(colorimetry.photopic(nm)), tolerance=1e-12, of=f"{nm:g} nm")
        for nm, v in table.items()
    ]


@check(
    what="Efficacy of the equal-energy spectrum, 360 to 830 nm",
    source="683 lm/W × 106.857 nm/470 nm (CIE 015:2018)",
)
def equal_energy() -> Row:
    got = colorimetry.spectrum_luminous_efficacy(GRID, colorimetry.illuminant_e(GRID))
    return Row(expected=683.0 * 106.857 / 470.0, got=got, tolerance=0.02, unit="lm/W")


@check(
    what="Transfer function of sRGB",
    source="IEC 61966-2-1",
)
def transfer_function() -> list[Row]:
    table = {0.0031308: 0.0404482, 0.18: 0.4613561, 0.2140411: 0.5}
    return [
        Row(
            expected=code,
            got=float(colorimetry.encode_srgb([value])[0]),
            tolerance=2e-5,
            of=f"{value:g}",
        )
        for value, code in table.items()
    ]
