"""Photometry and colour."""

from __future__ import annotations

import csv
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

import query
import raymap
from raymap.cli import application
from raymap.optics import colorimetry
from tests.validation import Row, check
from tracer import record

GRID = np.arange(360.0, 831.0)

SHEET = """
length_unit = "m"
flux_unit = "{unit}"
[spectrum]
{channels}
[surfaces.sheet]
{surface}
[bodies.sheet]
kind = "rectangle"
size = [2, 2]
position = [0, 0, 0.5]
surface = "sheet"
[sources.s]
kind = "collimated"
diameter = 0.5
direction = [0, 0, 1]
flux = 100
flux_unit = "lm"
spectrum = {{ {spectrum} }}
[detectors.d]
{detector}
"""
"""A source of 100 lm and a sheet in its light."""

BEHIND = """
position = [0, 0, 0.8]
looks = [0, 0, -1]
size = [1, 1]
cells = [1, 1]
"""


def _lumens(rays: int, **fields: str) -> tuple[float, float]:
    """Lumens on the detector, which are lux on 1 m², and their standard error."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(SHEET.format(**fields), encoding="utf-8")
        record(scene, scene.with_suffix(".raymap"), rays=rays, threads=1)
        with raymap.open(scene.with_suffix(".raymap")) as ray_map:
            image = query.detector_image(ray_map, "d")
            if fields["unit"] == "lm":
                found = query.select(ray_map, 'detected("d")').summary()
                return found["flux"], found["flux_se"]
            lux, error = image.quantity("illuminance")[:2]
            return float(lux[0, 0]), float(error[0, 0])


def _row(expected: float, found: tuple[float, float], **fields: Any) -> Row:
    return Row(
        expected=expected, got=found[0], got_error=found[1], tolerance=4.5 * found[1], **fields
    )


@check(
    what="Lines of equal power at 450 and 550 nm, 100 lm on 1 m², one filtered out",
    source="V(450) = 0.038, V(550) = 0.9949501 (CIE 018:2019): 100 lx V / (V(450) + V(550))",
)
def filtered_lines() -> list[Row]:
    rows = []
    for left, value, v in ((550, "0, 0, 1, 1", 0.9949501), (450, "1, 1, 0, 0", 0.038)):
        for unit in ("W", "lm"):
            found = _lumens(
                10_000,
                unit=unit,
                channels='kind = "spectral"\nwavelengths_nm = [450, 550, 610]',
                surface='kind = "filter"\nindex = 1.5\ntransmittance = '
                f"{{ wavelength_nm = [400, 500, 501, 700], value = [{value}] }}",
                spectrum="lines = { wavelength_nm = [450, 550], power = [1, 1] }",
                detector=BEHIND,
            )
            of = f"{left} nm left, map in {unit}"
            rows.append(_row(100.0 * v / 1.0329501, found, unit="lx", of=of))
    return rows


@check(
    what="Diffuse wall of linear sRGB (0.9, 0.2, 0.1) in 100 lm of (0.2, 0.3, 0.5): reflected",
    source="IEC 61966-2-1, by hand: 100 lm Σ c ρ Y / Σ c Y, Y = (0.2126, 0.7152, 0.0722)",
)
def rgb_wall() -> Row:
    found = _lumens(
        20_000,
        unit="lm",
        channels='kind = "rgb"',
        surface='kind = "lambertian"\nreflectance = { rgb = [0.9, 0.2, 0.1] }',
        spectrum="rgb = [0.2, 0.3, 0.5]",
        detector='kind = "far_field"\ncells = [1, 1]',
    )
    expected = 100.0 * (0.2 * 0.9 * 0.2126 + 0.3 * 0.2 * 0.7152 + 0.5 * 0.1 * 0.0722)
    return _row(expected / (0.2 * 0.2126 + 0.3 * 0.7152 + 0.5 * 0.0722), found, unit="lm")


def _illuminants() -> dict[str, tuple[Any, Any]]:
    """By name: over 360 to 830 nm as colour-science has them, and as the product does."""
    import colour

    shape = colour.SpectralShape(360, 830, 1)
    locus = colour.temperature.CCT_to_xy_CIE_D(6500 * 1.4388 / 1.4380)
    daylight = colour.sd_CIE_illuminant_D_series(locus)
    return {
        "A": (colour.sd_CIE_standard_illuminant_A(shape), colorimetry.illuminant_a),
        # CIE 15 interpolates its table of 5 nm linearly
        "D65": (
            daylight.interpolate(shape, interpolator=colour.LinearInterpolator),
            colorimetry.illuminant_d65,
        ),
        "E": (colour.sd_ones(shape), colorimetry.illuminant_e),
    }


@check(
    what="Luminous efficacy of illuminants, 360 to 830 nm",
    source="colour-science, luminous_efficacy",
    packages=("colour-science",),
)
def efficacies() -> list[Row]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour

        return [
            Row(
                expected=float(colour.luminous_efficacy(theirs)),
                got=float(colorimetry.spectrum_luminous_efficacy(GRID, ours(GRID))),
                tolerance=5e-4,
                unit="lm/W",
                of=name,
            )
            for name, (theirs, ours) in _illuminants().items()
        ]


@check(
    what="Chromaticity of D65, 360 to 830 nm",
    source="colour-science, sd_CIE_illuminant_D_series summed with the 2° observer",
    packages=("colour-science",),
)
def daylight() -> list[Row]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour

        observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
        theirs, ours = _illuminants()["D65"]
        expected = colour.XYZ_to_xy(colour.sd_to_XYZ(theirs, observer, method="Integration"))
        got = colorimetry.chromaticity(colorimetry.spectrum_to_xyz(GRID, ours(GRID)))
        return [
            Row(expected=float(e), got=float(g), tolerance=1e-6, of=axis)
            for axis, e, g in zip("xy", expected, got, strict=True)
        ]


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


@check(
    what="`raymap image --kind illuminance -o x.csv` of a map in W, 100 lm of which 450 nm is "
    "filtered out, on 1 m²",
    source="V(550) / (V(450) + V(550)) of CIE 018:2019 × 100 lx",
)
def kind_of_a_table() -> Row:
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        sheet = (
            'kind = "filter"\nindex = 1.5\n'
            "transmittance = { wavelength_nm = [400, 500, 501, 700], value = [0, 0, 1, 1] }"
        )
        scene.write_text(
            SHEET.format(
                unit="W",
                channels='kind = "spectral"\nwavelengths_nm = [450, 550]',
                surface=sheet,
                spectrum="lines = { wavelength_nm = [450, 550], power = [1, 1] }",
                detector=BEHIND,
            ),
            encoding="utf-8",
        )
        record(scene, scene.with_suffix(".raymap"), rays=100_000, threads=1)
        table = Path(folder) / "x.csv"
        command = ["image", str(scene.with_suffix(".raymap")), "d", "-o", str(table)]
        result = CliRunner().invoke(application(), [*command, "--kind", "illuminance"])
        assert result.exit_code == 0, result.output
        with table.open(encoding="utf-8") as lines:
            (read,) = csv.DictReader(lines)
    found = float(read["illuminance [lx]"]), float(read["illuminance_se [lx]"])
    return _row(100.0 * 0.99495010 / (0.038 + 0.99495010), found, unit="lx")
