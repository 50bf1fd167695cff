"""Regions of detectors in cells, and whether a crossing lies inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.engine.bind import Misfit
from query.engine.kleene import Bools
from query.expression.arguments import Region
from query.expression.units import ANGLES, degrees, length_factor
from raymap.model.directory import Detector
from raymap.model.errors import CriterionError
from raymap.model.schema import UV_SCALE
from raymap.optics.cells import cells_by_angle

__all__ = ["BoundRegion", "bind_region"]

Four = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundRegion:
    """A region of one detector in cells: ``rect`` half-open, ``ellipse`` closed."""

    shape: str
    numbers: Four
    cells: tuple[int, int]

    def holds(self, uv: NDArray[np.float64]) -> Bools:
        """Whether places on the detector, (n, 2) as maps store them, lie inside."""
        x = uv[:, 0] * self.cells[0] / UV_SCALE
        y = uv[:, 1] * self.cells[1] / UV_SCALE
        first, second, third, fourth = self.numbers
        inside: Bools
        if self.shape == "rect":
            inside = (first <= x) & (x < third) & (second <= y) & (y < fourth)
        else:
            # Of radii near zero places are as far away as no number says, which is outside
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
                inside = ((x - first) / third) ** 2 + ((y - second) / fourth) ** 2 <= 1
        return inside

    @property
    def is_outside(self) -> bool:
        """Whether no cell of the detector can lie inside."""
        first, second, third, fourth = self.numbers
        width, height = self.cells
        if self.shape == "rect":
            empty = third <= first or fourth <= second
            return empty or third <= 0 or fourth <= 0 or first > width or second > height
        return (
            first + third < 0
            or second + fourth < 0
            or first - third > width
            or (second - fourth > height)
        )


def bind_region(region: Region, detector: Detector, length_unit: str) -> BoundRegion:
    """A region in cells from the lower left corner of a detector.

    Raises
    ------
    Misfit
        Its unit does not fit the detector.
    """
    numbers = region.numbers
    if region.unit:
        numbers = _in_cells(region, detector, length_unit)
    return BoundRegion(shape=region.shape, numbers=numbers, cells=detector.cells)


def _in_cells(region: Region, detector: Detector, length_unit: str) -> Four:
    if detector.kind == "camera" and region.unit in ANGLES:
        return _field_in_cells(region, detector)
    scale = _scale(region.unit, detector, length_unit)
    angles = cells_by_angle(detector)
    if angles is not None:
        per_unit = [scale * per_degree for per_degree, _ in angles]
        zero = [at_zero for _, at_zero in angles]
    else:
        per_unit = [scale * detector.cells[axis] / detector.size[axis] for axis in (0, 1)]
        zero = [detector.cells[0] / 2, detector.cells[1] / 2]
    zero += [0.0, 0.0] if region.shape == "ellipse" else zero
    cells = [n * per_unit[index % 2] + zero[index] for index, n in enumerate(region.numbers)]
    return cells[0], cells[1], cells[2], cells[3]


def _field_in_cells(region: Region, detector: Detector) -> Four:
    """Field angles of a camera, across and up; its picture is even in their tangents."""
    angles = [number * degrees(region.unit) for number in region.numbers]
    half = detector.parameters.get("half_field") or [size / 2 for size in detector.size]
    problem = ""
    if region.shape == "ellipse":
        problem = "an ellipse in angles is none in the picture of a camera; write cells"
    elif max(abs(angle) for angle in angles) >= 90.0:
        problem = "field angles of a camera are less than 90° from its axis"
    if problem:
        message = f"region of detector {detector.name!r}: {problem}"
        raise Misfit(CriterionError(message), region.unit)
    cells = [
        (np.tan(np.radians(angle)) / half[index % 2] + 1.0) * detector.cells[index % 2] / 2
        for index, angle in enumerate(angles)
    ]
    return float(cells[0]), float(cells[1]), float(cells[2]), float(cells[3])


def _scale(unit: str, detector: Detector, length_unit: str) -> float:
    own = detector.parameters.get("size_unit")
    try:
        if own in ANGLES:
            per_unit = degrees(unit, "an angle of incidence")
            return per_unit if own == "deg" else float(np.radians(per_unit))
        return length_factor(unit, own or length_unit)
    except CriterionError as error:
        message = f"region of detector {detector.name!r}: {error}"
        raise Misfit(CriterionError(message), unit) from None
