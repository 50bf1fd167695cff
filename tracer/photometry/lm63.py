"""IES LM-63: reading luminous intensities.

The formats of 1986, 1991, 1995, 2002 and 2019 (ANSI/IES LM-63) differ in their keywords; the
numbers behind the TILT line are the same: lamps, lumen per lamp, multiplier, vertical and
horizontal angles, photometric type, unit of length, width, length, height; ballast factor,
ballast-lamp factor, watts; the angles; the candela values, plane by plane.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.errors import SceneError
from tracer.light import IntensityGrid

__all__ = ["read"]

_TYPES = {1: "C", 2: "B", 3: "A"}
_MOST_ANGLES = 100_000


def read(path: Path) -> IntensityGrid:
    """The intensities of a luminaire in candela, all factors of the header included.

    Its flux is the integral of the intensities: lumen of the header are those of the lamps, and
    absolute photometry (lumen -1) states none.

    Raises
    ------
    SceneError
        The file is none, ends early, contradicts itself, or is of photometric type A or B.
    """
    lines = path.read_text(encoding="latin-1").splitlines()
    start = next((k for k, line in enumerate(lines) if line.strip().upper().startswith("TILT")), -1)
    if start < 0:
        raise SceneError(f"{path.name}: is not an IES LM-63 file (it has no TILT line)")
    numbers = _numbers(path.name, lines[start + 1 :], start + 2)
    if "INCLUDE" in lines[start].upper().partition("=")[2]:
        # Geometry of the lamp, angles and factors of a lamp that is tilted: the source is not
        count = _count(path.name, numbers, 1, "tilt angles")
        numbers = numbers[2 + 2 * count :]
    if len(numbers) < 13:
        raise SceneError(f"{path.name}: ends before the angles: {len(numbers)} of 13 numbers")
    n_gamma = _count(path.name, numbers, 3, "vertical angles")
    n_planes = _count(path.name, numbers, 4, "horizontal angles")
    kind = int(numbers[5])
    if kind != 1:
        raise SceneError(
            f"{path.name}: photometric type {_TYPES.get(kind, str(kind))}; only type C (1) is "
            "read: convert it in a photometric program"
        )
    expected = 13 + n_gamma + n_planes + n_gamma * n_planes
    if len(numbers) != expected:
        raise SceneError(
            f"{path.name}: its header promises {n_gamma} vertical and {n_planes} horizontal "
            f"angles, that is {expected} numbers behind TILT; the file has {len(numbers)}"
        )
    gamma, planes, values = np.split(numbers[13:], [n_gamma, n_gamma + n_planes])
    factor = numbers[2] * numbers[10] * (numbers[11] or 1.0)
    if not factor > 0:
        raise SceneError(f"{path.name}: multiplier {numbers[2]:g}, ballast factor {numbers[10]:g}")
    return IntensityGrid(
        gamma_deg=gamma,
        c_deg=planes,
        intensity=factor * values.reshape(n_planes, n_gamma).T,
        unit="lm",
        opening=_opening(*(float(size) for size in numbers[7:9])),
        length_unit="ft" if numbers[6] == 1 else "m",
        name=path.name,
    )


def _numbers(name: str, lines: list[str], first: int) -> NDArray[np.float64]:
    found: list[float] = []
    for number, line in enumerate(lines, first):
        try:
            found += [float(word) for word in line.replace(",", " ").split()]
        except ValueError:
            raise SceneError(
                f"{name}: line {number} is not numbers: {line.strip()[:40]!r}"
            ) from None
    if not np.isfinite(found).all():
        raise SceneError(f"{name}: has a value that is not a finite number")
    return np.array(found)


def _count(name: str, numbers: NDArray[np.float64], place: int, what: str) -> int:
    value = numbers[place] if len(numbers) > place else 0.0
    if not (1 <= value <= _MOST_ANGLES and value == int(value)):
        raise SceneError(f"{name}: {value:g} {what}")
    return int(value)


def _opening(width: float, length: float) -> float | tuple[float, float] | None:
    """Diameter, or size along C0 (the length) and C90 (the width); negative sizes are round."""
    if width < 0 or length < 0:
        return max(abs(width), abs(length))
    if width == 0 and length == 0:
        return None
    if width == 0 or length == 0:
        return (max(length, 1e-6), max(width, 1e-6))
    return (length, width)
