"""Descriptors against the positions: where a segment crosses a flat detector is not stored."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.model.directory import Directory
from raymap.model.errors import FormatError
from raymap.model.schema import NORMAL_SCALE, UV_SCALE

__all__ = [
    "CheckedCrossings",
    "DetectorTable",
    "FoldedCrossings",
    "compile_detectors",
]

_SCALE = float(NORMAL_SCALE)
_UV = float(UV_SCALE)


class DetectorTable(NamedTuple):
    """Detectors of a directory.

    Attributes
    ----------
    frames : (n, 11) center, axis u, axis v, width, height
    flat : (n,) uint8, 1 where the place of a crossing is where the segment crosses the rectangle
    cells : (n, 2) int64
    """

    frames: NDArray[np.float64]
    flat: NDArray[np.uint8]
    cells: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class CheckedCrossings:
    """Crossings in cells that their detectors have; `check` alone makes them.

    Attributes
    ----------
    detector : (n,) rows of the table
    cell : (n, 2)
    """

    detector: NDArray[np.int16]
    cell: NDArray[np.uint16]

    @staticmethod
    def check(
        detector: NDArray[np.int16], cell: NDArray[np.uint16], table: DetectorTable
    ) -> CheckedCrossings:
        """Crossings that compiled loops may count.

        Raises
        ------
        FormatError
            A crossing is of a detector, or in a cell, that there is not.
        """
        n = len(detector)
        if cell.shape != (n, 2):
            raise FormatError(f"cells {cell.shape} of {n} crossings")
        if n and not 0 <= int(detector.min()) <= int(detector.max()) < len(table.cells):
            raise FormatError("a crossing is of a detector that the directory does not have")
        if not _cells_fit(detector, cell, table.cells):
            raise FormatError("a crossing is in a cell that its detector does not have")
        return CheckedCrossings(detector, cell)


@dataclass(frozen=True, slots=True, eq=False)
class FoldedCrossings:
    """Crossings of which is stored how far they are off where the segments cross; `check` alone.

    Attributes
    ----------
    counts : (n_records,) crossings of the segment that starts at each record
    detector : (n,) rows of the table
    position : (n_records, 3)
    folded : (5, n) residuals
    table : the detectors
    """

    counts: NDArray[np.uint16]
    detector: NDArray[np.int16]
    position: NDArray[np.float32]
    folded: NDArray[np.uint16]
    table: DetectorTable

    @staticmethod
    def check(
        counts: NDArray[np.uint16],
        detector: NDArray[np.int16],
        position: NDArray[np.float32],
        folded: NDArray[np.uint16],
        table: DetectorTable,
    ) -> FoldedCrossings:
        """Crossings that compiled loops may unfold.

        Raises
        ------
        FormatError
            Columns are not as long as each other, or a detector is not in the table.
        """
        n = len(detector)
        if folded.shape != (5, n) or int(counts.sum(dtype=np.int64)) != n:
            raise FormatError(f"residuals {folded.shape} of {n} crossings")
        if position.shape != (len(counts), 3):
            raise FormatError(f"positions {position.shape} of {len(counts)} records")
        if n and not 0 <= int(detector.min()) <= int(detector.max()) < len(table.flat):
            raise FormatError("a crossing is of a detector that the directory does not have")
        return FoldedCrossings(counts, detector, position, folded, table)

    def unfold(
        self, *, reverse: bool
    ) -> tuple[NDArray[np.uint16], NDArray[np.int16], NDArray[np.uint16]]:
        """Cells (n, 2), cosines (n,) and places (n, 2); ``reverse`` : cosines of the other sign."""
        n = len(self.detector)
        cell, uv = np.empty((n, 2), np.uint16), np.empty((n, 2), np.uint16)
        cosine = np.empty(n, np.int16)
        _decode_crossings(
            self.counts, self.detector, self.position, *self.table, reverse, self.folded,
            cell, cosine, uv,
        )  # fmt: skip
        return cell, cosine, uv


def compile_detectors(directory: Directory) -> DetectorTable:
    """The detectors of a directory."""
    detectors = directory.detectors
    frames = [(*d.center, *d.axis_u, *d.axis_v, *d.size) for d in detectors]
    flat = [d.kind == "plane" and d.uv_meaning == "crossing" and min(d.size) > 0 for d in detectors]
    return DetectorTable(
        frames=np.array(frames, np.float64).reshape(-1, 11),
        flat=np.array(flat, np.uint8),
        cells=np.array([d.cells for d in detectors], np.int64).reshape(-1, 2),
    )


@inner_kernel
def _crossing(
    f: NDArray[np.float64], i: int, position: NDArray[np.float32]
) -> tuple[int, int, int]:
    """(u, v, cosine) as stored, of the segment that starts at record i."""
    px = np.float64(position[i, 0])
    py = np.float64(position[i, 1])
    pz = np.float64(position[i, 2])
    dx = np.float64(position[i + 1, 0]) - px
    dy = np.float64(position[i + 1, 1]) - py
    dz = np.float64(position[i + 1, 2]) - pz
    # Compute the direction of the detector: axis u x axis v
    nx = f[4] * f[8] - f[5] * f[7]
    ny = f[5] * f[6] - f[3] * f[8]
    nz = f[3] * f[7] - f[4] * f[6]
    # Intersect the segment's line with the plane
    dn = (dx * nx + dy * ny) + dz * nz
    t = (((f[0] - px) * nx + (f[1] - py) * ny) + (f[2] - pz) * nz) / dn
    qx = (px + t * dx) - f[0]
    qy = (py + t * dy) - f[1]
    qz = (pz + t * dz) - f[2]
    u = ((qx * f[3] + qy * f[4]) + qz * f[5]) / f[9] + 0.5
    v = ((qx * f[6] + qy * f[7]) + qz * f[8]) / f[10] + 0.5
    cosine = dn / math.sqrt((dx * dx + dy * dy) + dz * dz)
    return (
        _rounded(u * _UV, 0.0, _UV),
        _rounded(v * _UV, 0.0, _UV),
        _rounded(cosine * _SCALE, -_SCALE, _SCALE),
    )


@inner_kernel
def _rounded(value: float, low: float, high: float) -> int:
    """Round half up into the range; 0 for what is no number."""
    if not (value >= low):
        return int(low) if value < low else 0
    if value > high:
        return int(high)
    return math.floor(value + 0.5)


@inner_kernel
def _cell_of(index: int, cells: int) -> int:
    cell = (index * cells) // UV_SCALE
    return cell if cell < cells else cells - 1


@inner_kernel
def _unfold(code: np.uint16, predicted: int) -> int:
    """Predicted + unzigzag modulo 2^16, as an unsigned 16-bit number."""
    sign = np.uint16(np.uint16(0) - np.uint16(code & np.uint16(1)))
    r = np.uint16(np.uint16(code >> np.uint16(1)) ^ sign)
    return (int(r) + predicted) & 0xFFFF


@lean_kernel
def _decode_crossings(
    counts: NDArray[np.uint16],
    detector: NDArray[np.int16],
    position: NDArray[np.float32],
    frames: NDArray[np.float64],
    flat: NDArray[np.uint8],
    cells: NDArray[np.int64],
    reverse: bool,
    folded: NDArray[np.uint16],
    cell: NDArray[np.uint16],
    cosine: NDArray[np.int16],
    uv: NDArray[np.uint16],
) -> None:
    """Crossings from their residuals against where segments cross flat detectors."""
    k = 0
    for i in range(counts.size):
        for _ in range(counts[i]):
            d = detector[k]
            u = 0
            v = 0
            c = 0
            if flat[d] and i + 1 < counts.size:
                u, v, c = _crossing(frames[d], i, position)
                if reverse:
                    c = -c
            uv[k, 0] = _unfold(folded[3, k], u)
            uv[k, 1] = _unfold(folded[4, k], v)
            cell[k, 0] = _unfold(folded[0, k], _cell_of(int(uv[k, 0]), cells[d, 0]))
            cell[k, 1] = _unfold(folded[1, k], _cell_of(int(uv[k, 1]), cells[d, 1]))
            cosine[k] = np.int16(_unfold(folded[2, k], c))
            k += 1


@lean_kernel
def _cells_fit(
    detector: NDArray[np.int16], cell: NDArray[np.uint16], cells: NDArray[np.int64]
) -> bool:
    """Whether every crossing is in a cell of its detector; detectors are within the table."""
    for k in range(detector.size):
        d = detector[k]
        if cell[k, 0] >= cells[d, 0] or cell[k, 1] >= cells[d, 1]:
            return False
    return True
