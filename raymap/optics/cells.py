"""What a detector's cells measure: areas, solid angles, étendues.

Flux per cell divided by the cell's measure is what the detector is read for:

============ ========================== =======================================
kind         measure of a cell          flux / measure
============ ========================== =======================================
plane        area                       irradiance [W/m²], illuminance [lx]
surface      area                       the same, on a face of a body
far_field    solid angle                intensity [W/sr], [cd]
camera       étendue: solid angle seen  radiance [W/(m² sr)], luminance [cd/m²]
             times area of the lens
============ ========================== =======================================
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Detector
from raymap.model.units import METRES
from raymap.optics.cellsizes import CellSizes, FaceSizes, TabledSizes
from raymap.optics.seenfaces import seen_face

__all__ = ["CellMeasure", "cell_measure", "cells_by_angle", "is_pinhole"]

Floats = NDArray[np.float64]
Quantity = Literal["area", "solid_angle", "etendue"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)

_BAND = 2**16
"""Pixels whose Gauss points are looked at together: what is kept of each takes a kilobyte."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CellMeasure:
    """Size of each cell.

    Attributes
    ----------
    quantity : what ``sizes`` are
    sizes : area [m²], solid angle [sr] or étendue [m² sr]; 0 where a cell lies beside the face
    """

    quantity: Quantity
    sizes: CellSizes

    @cached_property
    def values(self) -> Floats:
        """(cells_v, cells_u) all sizes; one number in memory where cells are alike."""
        return self.sizes.part(*map(range, self.sizes.shape))

    def density_unit(self, flux_unit: str) -> str:
        """Unit of flux per measure, for a flux in W or lm."""
        radiant = {"area": "W/m²", "solid_angle": "W/sr", "etendue": "W/(m² sr)"}
        luminous = {"area": "lx", "solid_angle": "cd", "etendue": "cd/m²"}
        return (luminous if flux_unit == "lm" else radiant)[self.quantity]


def is_pinhole(detector: Detector) -> bool:
    """Whether its picture is summed up while tracing: no ray of the map meets it."""
    return detector.kind == "camera" and detector.parameters.get("lens") == "pinhole"


def cells_by_angle(detector: Detector) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Cells per degree, and the cell at 0°, of C and of gamma; None where they are not known.

    C and gamma are those of charts and tables: C from 0 on, gamma from its first row.
    """
    angles = detector.parameters.get("gamma_deg")
    if detector.kind != "far_field" or angles is None:
        return None
    low, high = float(angles[0]), float(angles[1])
    per_gamma = detector.cells[1] / (high - low)
    return (detector.cells[0] / 360.0, 0.0), (per_gamma, -low * per_gamma)


def cell_measure(detector: Detector, length_unit: str) -> CellMeasure | None:
    """Size of the cells of a detector; None where the directory does not tell.

    Parameters
    ----------
    length_unit : of the map
    """
    shape = detector.cells[1], detector.cells[0]
    metre = METRES.get(length_unit)
    if detector.kind == "far_field":
        angles = detector.parameters.get("gamma_deg")
        if angles is None:
            return None
        edges = np.radians(np.linspace(angles[0], angles[1], shape[0] + 1))
        bands = 2.0 * np.pi / shape[1] * (np.cos(edges[:-1]) - np.cos(edges[1:]))
        return _tabled("solid_angle", np.broadcast_to(bands[:, None], shape))
    if metre is None:
        return None
    if detector.kind == "plane":
        unit = METRES.get(str(detector.parameters.get("size_unit", length_unit)))
        if unit is None:
            return None
        area = detector.size[0] / shape[1] * detector.size[1] / shape[0] * unit**2
        return _tabled("area", np.broadcast_to(area, shape))
    if detector.kind == "camera":
        return _camera(detector, shape, metre)
    if (face := seen_face(detector.parameters)) is not None:
        law = FaceSizes(face=face, size=detector.size, cells=shape, unit=metre)
        return CellMeasure(quantity="area", sizes=law)
    areas = np.asarray(detector.parameters.get("cell_area", ()), np.float64)
    if areas.size not in (1, shape[0], shape[0] * shape[1]):
        return None
    areas = areas * metre**2
    if areas.size < shape[0] * shape[1]:
        return _tabled("area", np.broadcast_to(areas.reshape(-1, 1), shape))
    return _tabled("area", areas.reshape(shape))


def _tabled(quantity: Quantity, values: Floats) -> CellMeasure:
    return CellMeasure(quantity=quantity, sizes=TabledSizes(values))


def _camera(detector: Detector, shape: tuple[int, int], metre: float) -> CellMeasure | None:
    """Étendue of the pixels of an ideal lens, or of a pinhole of unit area that faces each pixel.

    A pixel of a lens sees a rectangle in the plane of focus; the lens takes in F π dA of each of
    its elements dA, with the configuration factor F from an element to a parallel disc (J. R.
    Howell, A catalog of radiation heat transfer configuration factors, B-13).
    """
    tangents = detector.parameters.get("half_field")
    if tangents is None:
        return None
    values = np.empty(shape)
    high = max(1, _BAND // shape[1])
    for first in range(0, shape[0], high):
        rows = range(first, min(first + high, shape[0]))
        x, y, element = _places(float(tangents[0]), float(tangents[1]), shape, rows)
        taken = _taken(detector, x * x + y * y, element)
        values[rows.start : rows.stop] = _summed(taken) * metre**2
    return _tabled("etendue", values)


def _taken(detector: Detector, r2: Floats, element: Floats) -> Floats:
    """Étendue at places of a picture, whose tangents squared are ``r2`` [length unit² sr]."""
    if is_pinhole(detector):
        solid: Floats = element / (1.0 + r2) ** 1.5
        return solid
    radius = detector.parameters.get("aperture_diameter", 0.0) / 2.0
    distance = detector.parameters.get("focus_distance")
    taken: Floats
    if distance is None:
        taken = np.pi * radius**2 * element / (1.0 + r2) ** 2
    else:
        # In units of the distance of focus
        lens = (radius / distance) ** 2
        z = r2 + 1.0 - lens
        q = np.hypot(z, 2.0 * np.sqrt(lens))
        # Of two forms of the factor the one that loses no digits, of lenses wider than they are far
        far = np.abs(z)
        factor = np.where(z < 0.0, 0.5 * (q + far) / q, 2.0 * lens / (q * (q + far)))
        taken = np.pi * factor * element * distance**2
    return taken


def _places(
    half_u: float, half_v: float, shape: tuple[int, int], rows: range
) -> tuple[Floats, Floats, Floats]:
    """Gauss points of the pixels of some rows, (rows 3, columns 3), and the size of their elements.

    ``shape`` is that of all pixels.
    """
    sides = []
    for half, n, part in ((half_u, shape[1], range(shape[1])), (half_v, shape[0], rows)):
        middle = (np.arange(part.start, part.stop) + 0.5) / n * 2.0 - 1.0
        sides.append(half * (middle[:, None] + _NODES / n).ravel())
    x, y = np.meshgrid(sides[0], sides[1])
    weights = np.outer(np.tile(_WEIGHTS, len(rows)), np.tile(_WEIGHTS, shape[1]))
    return x, y, weights * (half_u / shape[1]) * (half_v / shape[0])


def _summed(values: Floats) -> Floats:
    """Sums over the nine Gauss points of each pixel."""
    high, wide = values.shape[0] // 3, values.shape[1] // 3
    blocks: Floats = values.reshape(high, 3, wide, 3).sum(axis=(1, 3))
    return blocks
