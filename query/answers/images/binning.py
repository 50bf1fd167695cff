"""Coarser cells: blocks of a detector's cells as one, for pictures of few rays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Detector
from raymap.model.errors import RayMapError

__all__ = ["block_sums", "coarser", "fitting_blocks"]


def fitting_blocks(detector: Detector) -> list[int]:
    """Sides of square blocks, above 1, that the cells divide into without remainder."""
    if detector.parameters.get("mapping") == "triangles":
        return []
    common = math.gcd(*detector.cells)
    return [side for side in range(2, common + 1) if common % side == 0]


def coarser(detector: Detector, side: int) -> Detector:
    """The detector with blocks of ``side`` x ``side`` cells joined.

    Raises
    ------
    RayMapError
        the cells do not divide into such blocks
    """
    if side == 1:
        return detector
    fitting = fitting_blocks(detector)
    if side not in fitting:
        width, height = detector.cells
        known = ", ".join(str(block) for block in fitting) or "none"
        raise RayMapError(
            f"the {width} x {height} cells of detector {detector.name!r} do not divide into blocks "
            f"of {side} x {side}; sides that fit: {known}"
        )
    changed: dict[str, Any] = {"cells": (detector.cells[0] // side, detector.cells[1] // side)}
    areas = np.asarray(detector.parameters.get("cell_area", ()), np.float64)
    if areas.size == 1:
        changed["parameters"] = detector.parameters | {"cell_area": areas.item() * side**2}
    elif areas.size == detector.cells[1]:
        rows = areas.reshape(-1, side).sum(axis=1) * side
        changed["parameters"] = detector.parameters | {"cell_area": rows.tolist()}
    elif areas.size:
        joined = block_sums(areas.reshape(detector.cells[::-1]), side)
        changed["parameters"] = detector.parameters | {"cell_area": joined.ravel().tolist()}
    return detector.model_copy(update=changed)


def block_sums(values: NDArray[Any], side: int) -> NDArray[Any]:
    """(rows, columns, …) values added up over blocks of ``side`` x ``side``."""
    rows, columns = values.shape[0] // side, values.shape[1] // side
    blocks = values.reshape(rows, side, columns, side, *values.shape[2:])
    result: NDArray[Any] = blocks.sum(axis=(1, 3))
    return result
