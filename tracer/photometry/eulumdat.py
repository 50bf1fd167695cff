"""EULUMDAT: reading luminous intensities.

One value per line, by line number (A. Stockmar, "EULUMDAT - ein Leuchtendatenformat für den
europäischen Beleuchtungsplaner", Licht '90, 641-644). Intensities stand in candela per 1000 lumen
of the lamps; the planes that a symmetry implies are left out.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.textfile import plain_number, text_lines
from tracer.light import IntensityGrid, LightFormat
from tracer.photometry.luminous_opening import opening_of_eulumdat

__all__ = ["read"]

_MOST_ANGLES = 100_000
_DIFFERENCE = 0.05
_STEP_ROUNDING_DEG = 0.05


class _Lines:
    """Values by line; messages name the line and what stands there."""

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self.lines = text_lines(path.read_bytes())
        self.place = 0

    def text(self) -> str:
        if self.place >= len(self.lines):
            raise SceneError(f"{self.name}: ends at line {self.place}, before its values do")
        self.place += 1
        return self.lines[self.place - 1].strip()

    def skip(self, count: int) -> None:
        self.place += count

    def number(self, what: str) -> float:
        text = self.text().replace(",", ".")
        value = plain_number(text or "0")
        if value is None or not math.isfinite(value):
            raise SceneError(
                f"{self.name}: line {self.place} is {text[:40]!r}, where {what} stands in EULUMDAT"
            )
        return value

    def count(self, what: str, least: int) -> int:
        value = self.number(what)
        if not (least <= value <= _MOST_ANGLES and value == int(value)):
            raise SceneError(f"{self.name}: line {self.place}: {what} is {value:g}")
        return int(value)

    def numbers(self, n: int, what: str) -> NDArray[np.float64]:
        """n numbers, one per line; blank lines are skipped, some programs write several a line."""
        found: list[float] = []
        while len(found) < n:
            words = self.text().replace(",", ".").split()
            for word in words:
                value = plain_number(word)
                if value is None or not math.isfinite(value):
                    raise SceneError(
                        f"{self.name}: line {self.place} is {' '.join(words)[:40]!r}, where {what} "
                        "stand in EULUMDAT"
                    )
                found.append(value)
        if len(found) > n:
            raise SceneError(f"{self.name}: line {self.place}: more {what} than the {n} promised")
        return np.array(found)

    def end(self) -> None:
        """Refuse numbers behind the last one."""
        rest = [line for line in self.lines[self.place :] if line.strip()]
        if rest:
            raise SceneError(
                f"{self.name}: {len(rest)} lines more than its planes, angles and symmetry promise"
            )


def read(path: Path) -> IntensityGrid:
    """The intensities of a luminaire in candela: those of the file times the flux of its lamps.

    Where the flux of the lamps times the light output ratio of the header differs from the integral
    of the intensities by more than 5 %, a warning names both.

    Raises
    ------
    SceneError
        The file ends early, a line is not what stands there, or planes do not fit the symmetry.
    """
    lines = _Lines(path)
    lines.skip(2)
    symmetry = lines.count("the symmetry (0 to 4)", 0)
    n_planes = lines.count("the number of C planes", 1)
    c_step = lines.number("the step between C planes")
    n_gamma = lines.count("the number of gamma angles", 2)
    gamma_step = lines.number("the step between gamma angles")
    lines.skip(8)
    length, width = lines.number("a length"), lines.number("a width")
    heights = tuple(lines.number("the height of a luminous side") for _ in range(4))
    lines.skip(1)
    ratio = lines.number("the light output ratio") / 100.0
    conversion = lines.number("the conversion factor") or 1.0
    tilt = lines.number("the tilt when it was measured")
    sets = max(1, lines.count("the number of lamp sets", 0))
    lines.skip(2)
    lamp_flux = lines.number("the flux of the lamps")
    lines.skip(3 + 6 * (sets - 1) + 10)
    planes = lines.numbers(n_planes, "C angles")
    gamma = lines.numbers(n_gamma, "gamma angles")
    used = _planes(lines.name, symmetry, planes)
    values = lines.numbers(len(used) * n_gamma, "intensities").reshape(-1, n_gamma)
    lines.end()
    if not (lamp_flux > 0 and conversion > 0):
        raise SceneError(
            f"{path.name}: lamps of {lamp_flux:g} lm and a conversion factor of {conversion:g} "
            "make no light"
        )
    grid = IntensityGrid(
        gamma_deg=gamma,
        c_deg=used,
        intensity=values.T * (conversion * lamp_flux / 1000.0),
        unit="lm",
        opening=opening_of_eulumdat(path.name, length, width, heights),
        length_unit="mm",
        name=path.name,
    )
    _warn(path.name, grid.flux, lamp_flux * ratio, sets, tilt)
    _warn_of_steps(path.name, "C planes", c_step, planes)
    _warn_of_steps(path.name, "gamma angles", gamma_step, gamma)
    return grid


def _warn(name: str, found: float, stated: float, sets: int, tilt: float) -> None:
    """Name what the header says otherwise, and what is left out."""
    if sets > 1:
        warnings.warn(f"{name}: has {sets} sets of lamps; the first is used", stacklevel=4)
    if tilt != 0.0:
        warnings.warn(
            f"{name}: was measured tilted by {tilt:g} degrees; the source is not turned by it",
            stacklevel=4,
        )
    if abs(found - stated) > _DIFFERENCE * max(stated, 0.0):
        warnings.warn(
            f"{name}: its intensities make {found:.6g} lm; the light output ratio of its header "
            f"would make {stated:.6g} lm (flux = {stated:.6g} in the scene takes that)",
            stacklevel=4,
        )


def _warn_of_steps(name: str, what: str, stated: float, angles: NDArray[np.float64]) -> None:
    """Name a stated step that the list of angles does not have; 0 states unequal steps."""
    steps = np.diff(angles)
    if stated == 0.0 or not len(steps) or np.all(np.abs(steps - stated) <= _STEP_ROUNDING_DEG):
        return
    low, high = float(steps.min()), float(steps.max())
    found = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    warnings.warn(
        f"{name}: states {what} {stated:g} degrees apart, and lists them {found} degrees apart; "
        "the list is taken",
        stacklevel=4,
    )


def _planes(name: str, symmetry: int, planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles of the planes whose intensities are in the file, rising."""
    n = len(planes)
    if symmetry == 0:
        return planes
    if symmetry == 1:
        return planes[:1]
    if symmetry == 3:
        # From C270 over C0 to C90
        start = 3 * n // 4
        used = np.concatenate([planes[start:] - 360.0, planes[: n // 2 + 1 - (n - start)]])
        ends = (-90.0, 90.0)
    elif symmetry == 2:
        used, ends = planes[: n // 2 + 1], (0.0, 180.0)
    elif symmetry == 4:
        used, ends = planes[: n // 4 + 1], (0.0, 90.0)
    else:
        raise SceneError(f"{name}: line 3: symmetry {symmetry}; it is 0 to 4")
    if not (len(used) > 1 and np.allclose(used[[0, -1]], ends)):
        raise SceneError(
            f"{name}: its {n} C planes do not fit symmetry {symmetry}: they would run from "
            f"C{used[0] % 360:g} to C{used[-1] % 360:g}"
        )
    return np.asarray(used)


KINDS = (
    LightFormat(
        suffixes=(".ldt",),
        title="luminaires of EULUMDAT",
        place=20,
        read=lambda path, flux_from: read(path),
    ),
)
