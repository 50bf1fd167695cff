"""What a chart says."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import query
import raymap
from query.answers.images.beams import beam_of
from query.answers.images.readings import readings
from tests.validation import Row, check
from tracer import record

Array = NDArray[np.float64]

LAMP = """
length_unit = "m"
flux_unit = "lm"
[sources.lamp]
kind = "intensity"
axis = [0, 0, -1]
flux = {flux}
intensity = {{ gamma_deg = {gamma}, c_deg = [0], value = {value} }}
[detectors.far]
kind = "far_field"
axis = [0, 0, -1]
c0 = [1, 0, 0]
gamma_deg = [0, {last}]
cells = [36, 90]
"""

WALL = """
length_unit = "m"
flux_unit = "lm"
[sources.beam]
kind = "collimated"
direction = [0, 0, 1]
size = [1.2, 1.2]
flux = 1440
[detectors.wall]
position = [0, 0, 1]
looks = [0, 0, -1]
size = [1, 1]
cells = [60, 60]
"""


def _image(text: str, detector: str, rays: int) -> query.DetectorImage:
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(text, encoding="utf-8")
        record(scene, scene.with_suffix(".raymap"), rays=rays, threads=1, no_rays=True)
        with raymap.open(scene.with_suffix(".raymap")) as ray_map:
            return query.detector_image(ray_map, detector)


def _row(expected: float, found: tuple[float, float] | None, **fields: Any) -> Row:
    assert found is not None
    value, error = found
    return Row(expected=expected, got=value, got_error=error, tolerance=4.5 * error, **fields)


def _lamp(shape: Callable[[Array], Array], last: float, half_deg: float, of: str) -> list[Row]:
    """Peak and beam angle of a lamp of 1,000 cd on its axis, from 200,000 rays."""
    fine = np.radians(np.linspace(0.0, last, 200_001))
    flux = 1000.0 * 2.0 * np.pi * np.trapezoid(shape(fine) * np.sin(fine), fine)
    gamma = np.linspace(0.0, last, 181)
    text = LAMP.format(
        flux=flux,
        last=last,
        gamma=gamma.tolist(),
        value=[[value] for value in shape(np.radians(gamma)).tolist()],
    )
    image = _image(text, "far", 200_000)
    beam = beam_of(image, "candela")
    return [
        _row(1000.0, beam.peak, unit="cd", of=f"{of}, peak"),
        _row(2.0 * half_deg, beam.planes[0].beam_deg, unit="°", of=f"{of}, beam angle"),
    ]


@check(
    what="Lamps of 1,000 cd on the axis in 36 × 90 cells, 200,000 rays",
    source="The intensity itself: cos γ; 2^−(2γ/FWHM)²",
)
def lamps() -> list[Row]:
    rows = _lamp(np.cos, 90.0, 60.0, "cosine")
    for fwhm, last in ((3.0, 9.0), (30.0, 90.0)):

        def gaussian(gamma: Array, fwhm: float = fwhm) -> Array:
            return np.exp2(-((2.0 * np.degrees(gamma) / fwhm) ** 2))

        rows += _lamp(gaussian, last, 0.5 * fwhm, f"Gaussian of {fwhm:g}°")
    return rows


@check(
    what="Evenly lit wall of 60 × 60 cells, 14 rays each",
    source="1,440 lm on 1.2 m × 1.2 m: 1,000 lx, min/mean = 1",
)
def wall() -> list[Row]:
    image = _image(WALL, "wall", 72_000)
    numbers = readings(image)
    return [
        _row(expected, (numbers[name], numbers[f"{name}_se"]), unit=unit, of=of)
        for name, expected, unit, of in (
            ("mean", 1000.0, "lx", "mean"),
            ("peak", 1000.0, "lx", "peak"),
            ("min_over_mean", 1.0, "", "min/mean"),
        )
    ]
