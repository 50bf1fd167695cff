"""IES LM-63: reading luminous intensities.

The formats of 1986, 1991, 1995, 2002 and 2019 (ANSI/IES LM-63) differ in their keywords; the
numbers behind the TILT line are the same: lamps, lumen per lamp, multiplier, vertical and
horizontal angles, photometric type, unit of length, width, length, height; ballast factor,
ballast-lamp factor, watts; the angles; the candela values, plane by plane. The ballast-lamp factor
is one up to 1991; in 1995 its place was kept for future use, and 2019 states there how the file was
made.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.textfile import plain_number, text_lines
from tracer.light import IntensityGrid, LightFormat
from tracer.photometry.goniometer import Readings, grid_of_type_a, grid_of_type_b
from tracer.photometry.luminous_opening import opening_of_lm63

__all__ = ["read"]

_TYPES = {1.0: "C", 2.0: "B", 3.0: "A"}
_MOST_ANGLES = 100_000
_EDITION = re.compile(r"IES(?:NA)?(?:[:\s]*LM-?63-(\d{2}|\d{4})|(91))(?!\d)", re.IGNORECASE)
_TILT = re.compile(r"\s*TILT\s*=", re.IGNORECASE)


def read(path: Path) -> IntensityGrid:
    """The intensities of a luminaire in candela, all factors of the header included.

    Its flux is the integral of the intensities: lumen of the header are those of the lamps, and
    absolute photometry (lumen -1) states none. Photometry of types A and B is turned into C planes.

    Raises
    ------
    SceneError
        The file is none, ends early, or contradicts itself.
    """
    lines = text_lines(path.read_bytes())
    start = next((k for k, line in enumerate(lines) if _TILT.match(line)), -1)
    if start < 0:
        raise SceneError(f"{path.name}: is not an IES LM-63 file (it has no TILT line)")
    edition = _edition(next(line for line in lines if line.strip()))
    numbers = _numbers(path.name, lines[start + 1 :], start + 2)
    if "INCLUDE" in lines[start].upper().partition("=")[2]:
        # Geometry of the lamp, angles and factors of a lamp that is tilted: the source is not
        count = _count(path.name, numbers, 1, "tilt angles")
        numbers = numbers[2 + 2 * count :]
    if len(numbers) < 13:
        raise SceneError(f"{path.name}: ends before the angles: {len(numbers)} of 13 numbers")
    n_vertical = _count(path.name, numbers, 3, "vertical angles")
    n_horizontal = _count(path.name, numbers, 4, "horizontal angles")
    kind = _TYPES.get(float(numbers[5]))
    if kind is None:
        raise SceneError(
            f"{path.name}: photometric type {numbers[5]:g}; types are 1 (C), 2 (B) and 3 (A)"
        )
    if numbers[6] not in (1, 2):
        raise SceneError(
            f"{path.name}: unit of length {numbers[6]:g}; units are 1 (feet) and 2 (metres)"
        )
    expected = 13 + n_vertical + n_horizontal + n_vertical * n_horizontal
    if len(numbers) != expected:
        raise SceneError(
            f"{path.name}: its header promises {n_vertical} vertical and {n_horizontal} horizontal "
            f"angles, that is {expected} numbers behind TILT; the file has {len(numbers)}"
        )
    ends = [n_vertical, n_vertical + n_horizontal]
    vertical, horizontal, values = np.split(numbers[13:], ends)
    readings = Readings(
        name=path.name,
        vertical_deg=vertical,
        horizontal_deg=horizontal,
        intensity=_factor(path.name, edition, numbers) * values.reshape(n_horizontal, n_vertical).T,
    )
    if kind == "A":
        readings = grid_of_type_a(readings)
    elif kind == "B":
        readings = grid_of_type_b(readings)
    width, length, height = (float(size) for size in numbers[7:10])
    return IntensityGrid(
        gamma_deg=readings.vertical_deg,
        c_deg=readings.horizontal_deg,
        intensity=readings.intensity,
        unit="lm",
        opening=opening_of_lm63(path.name, edition, width, length, height),
        length_unit="ft" if numbers[6] == 1 else "m",
        name=path.name,
    )


def _edition(first: str) -> int:
    """Year of the edition that the first line names; the format of 1986 has no such line."""
    found = _EDITION.match(first.strip())
    if found is None:
        return 1986
    year = int(found[1] or 1991)
    return year if year > 99 else year + (1900 if year > 50 else 2000)


def _factor(name: str, edition: int, numbers: NDArray[np.float64]) -> float:
    """What candela values are multiplied by."""
    multiplier, ballast, third = (float(numbers[index]) for index in (2, 10, 11))
    factor = multiplier * ballast
    if edition < 1995:
        factor *= third or 1.0
    elif edition < 2019 and third not in (0.0, 1.0):
        warnings.warn(
            f"{name}: has {third:g} where LM-63-{edition} keeps a 1 for future use; intensities "
            "are not multiplied by it",
            stacklevel=4,
        )
    if not factor > 0:
        raise SceneError(f"{name}: multiplier {multiplier:g}, ballast factor {ballast:g}")
    return factor


def _numbers(name: str, lines: list[str], first: int) -> NDArray[np.float64]:
    found: list[float] = []
    for number, line in enumerate(lines, first):
        values = [plain_number(word) for word in line.replace(",", " ").split()]
        if None in values:
            raise SceneError(f"{name}: line {number} is not numbers: {line.strip()[:40]!r}")
        found += [value for value in values if value is not None]
    if not np.isfinite(found).all():
        raise SceneError(f"{name}: has a value that is not a finite number")
    return np.array(found)


def _count(name: str, numbers: NDArray[np.float64], index: int, what: str) -> int:
    value = numbers[index] if len(numbers) > index else 0.0
    if not (1 <= value <= _MOST_ANGLES and value == int(value)):
        raise SceneError(f"{name}: {value:g} {what}")
    return int(value)


KINDS = (
    LightFormat(
        suffixes=(".ies",),
        title="luminaires of IES LM-63",
        place=10,
        sniff=lambda head: head.lstrip().startswith(b"IESNA"),
        read=lambda path, flux_from: read(path),
    ),
)
