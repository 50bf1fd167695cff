"""The encodings of shapes' positions and of crossings, which maps of earlier writers hold.

Readers take them; `raymap` itself no longer writes them, since they cost more time than they save
bytes. Here they are written so that tests can read them back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import raymap
from raymap.bytes.streams import Scope, StreamSet
from raymap.encoding import geometrystreams
from raymap.encoding.detector_crossings import _cell_of, _crossing, compile_detectors
from raymap.encoding.encoder import PortionEncoder
from raymap.encoding.portionmeta import DESCRIPTOR_STREAMS, Encoding
from raymap.encoding.positions import _ordered, _root, _solved_axis
from raymap.encoding.shapes import ShapeTable
from raymap.jit.kernels import inner_kernel, kernel, lean_kernel
from raymap.model.portion import Portion

__all__ = ["CompactEncoder", "write_compactly"]

_NEAR = 256
_FEW_CROSSINGS = 64


def write_compactly(writer: raymap.RayMapWriter) -> raymap.RayMapWriter:
    """Let a writer leave out what shapes imply of positions and of places on detectors."""
    writer._encoder = CompactEncoder(writer.directory)
    return writer


class CompactEncoder(PortionEncoder):
    """`PortionEncoder` with flags 16, 32, 128 and 256 of the format, where they pay."""

    def _add_geometry(self, streams: StreamSet, rays: geometrystreams.PathsTaken) -> tuple:
        codes = geometrystreams._shape_codes(rays, self.shapes)
        portion = geometrystreams.with_normals(rays.portion, codes, self.shapes)
        chosen = add_positions(streams, portion, codes, self.shapes)
        normals = geometrystreams._add_normals(streams, portion, rays.offsets, codes, self.shapes)
        return chosen | normals, None

    def _add_descriptors(self, streams: StreamSet, portion: Portion) -> int:
        return add_crossings(streams, portion, compile_detectors(self.directory))


def add_crossings(streams: StreamSet, portion: Portion, table: tuple) -> int:
    """Store the crossings beyond what the paths and positions say; returns the encodings chosen."""
    d = portion.descriptors
    n = len(d.detector)
    if not n:
        return 0
    plain = (d.cell[:, 0], d.cell[:, 1], d.cosine, d.uv[:, 0], d.uv[:, 1])
    folded = np.empty((5, n), np.uint16)

    def missed(counts: NDArray[np.uint16], reverse: bool) -> int:
        return encode_crossings(
            counts, d.detector, d.cell, d.cosine, d.uv, portion.position, *table, reverse, folded
        )

    # Let the first crossings say against which direction cosines are positive
    so_far = np.cumsum(portion.descriptor_count, dtype=np.int64)
    few = portion.descriptor_count[: np.searchsorted(so_far, _FEW_CROSSINGS) + 1]
    reverse = missed(few, True) < missed(few, False)
    worse = missed(portion.descriptor_count, reverse) > sum(map(np.count_nonzero, plain))
    for name, column in zip(DESCRIPTOR_STREAMS, plain if worse else folded, strict=True):
        streams.add(name, column, Scope.DESCRIPTOR)
    if worse:
        return 0
    return int(Encoding.CROSSINGS | (Encoding.REVERSED if reverse else Encoding(0)))


def add_positions(
    streams: StreamSet, portion: Portion, codes: NDArray[np.int32], shapes: ShapeTable
) -> int:
    """Store positions without the coordinates that shapes imply; returns the encodings chosen."""
    n = portion.n_records
    position = np.ascontiguousarray(portion.position)
    bits = position.view(np.int32)
    # One more row, into which the pass writes ahead before it knows whether the value counts
    xs, ys, zs = (np.empty(n + 1, np.int32) for axis in "xyz")
    solved = np.empty(n + 1, np.int32)
    residual = np.empty(n, np.uint32)
    roots = np.empty(n, np.uint8)
    faces, sphere = True, True
    while True:
        nx, ny, nz, k = gather_coordinates(
            codes, shapes.axis, faces, sphere, bits, xs, ys, zs, solved
        )
        records = solved[:k]
        position_residuals(
            records, codes, shapes.solve, shapes.axis, position, bits, residual, roots
        )
        # Give up a kind of shape that saves less than a byte per coordinate
        bad_faces, bad_sphere = _far_off(codes, records, residual)
        if not bad_faces and not bad_sphere:
            break
        faces, sphere = faces and not bad_faces, sphere and not bad_sphere
    for name, values in (("x", xs[:nx]), ("y", ys[:ny]), ("z", zs[:nz])):
        streams.add(f"position.{name}", values.view(np.float32))
    if k:
        streams.add("position.residual", residual[:k])
        streams.add("position.root", roots[:k])
    chosen = Encoding(0)
    if k and faces:
        chosen |= Encoding.SOLVED_FACES
    if k and sphere:
        chosen |= Encoding.SOLVED_SPHERE
    return int(chosen)


def _far_off(
    codes: NDArray[np.int32], records: NDArray[np.int32], residual: NDArray[np.uint32]
) -> tuple[bool, bool]:
    """Whether most points are far off their faces, and most ends far off the bounding sphere."""
    far = np.flatnonzero(residual[: len(records)] >= 2**24)
    if len(far) == 0:
        return False, False
    on_sphere = codes[records] < 0
    far_on_sphere = int(on_sphere[far].sum())
    n_sphere = int(on_sphere.sum())
    far_on_faces = len(far) - far_on_sphere
    return 2 * far_on_faces > len(records) - n_sphere, 2 * far_on_sphere > n_sphere


@lean_kernel
def gather_coordinates(
    codes: NDArray[np.int32],
    axis: NDArray[np.int8],
    solve_faces: bool,
    solve_sphere: bool,
    bits: NDArray[np.int32],
    xs: NDArray[np.int32],
    ys: NDArray[np.int32],
    zs: NDArray[np.int32],
    solved: NDArray[np.int32],
) -> tuple[int, int, int, int]:
    """Coordinates to be stored, axis by axis, and the records that have one to be solved for.

    Returns
    -------
    n_x, n_y, n_z, n_solved : how much of ``xs``, ``ys``, ``zs`` and ``solved`` is filled
    """
    nx, ny, nz, n = 0, 0, 0, 0
    for i in range(codes.size):
        a = _solved_axis(codes[i], axis, solve_faces, solve_sphere)
        xs[nx] = bits[i, 0]
        ys[ny] = bits[i, 1]
        zs[nz] = bits[i, 2]
        solved[n] = i
        nx += a != 0
        ny += a != 1
        nz += a != 2
        n += a >= 0
    return nx, ny, nz, n


@kernel
def position_residuals(
    solved: NDArray[np.int32],
    codes: NDArray[np.int32],
    solve: NDArray[np.float64],
    axis: NDArray[np.int8],
    position: NDArray[np.float32],
    bits: NDArray[np.int32],
    residual: NDArray[np.uint32],
    roots: NDArray[np.uint8],
) -> None:
    """Solved coordinates as zigzag of (stored - root) in float32 steps.

    Parameters
    ----------
    solved : (n,) records
    residual, roots : (n,) out; the root is 0 or 1, exclusive or the quadric's last one
    """
    last_root = np.zeros(axis.size, np.uint8)
    for k in range(solved.size):
        i = solved[k]
        q = codes[i] if codes[i] >= 0 else axis.size - 1
        a = axis[q]
        u = np.float64(position[i, 1 if a == 0 else 0])
        v = np.float64(position[i, 1 if a == 2 else 2])
        here = _ordered(bits[i, a])
        last = last_root[q]
        t = np.float32(_root(solve, q, u, v, last))
        r = np.int32(here - _ordered(t.view(np.int32)))
        code = np.uint32((r << 1) ^ (r >> 31))
        roots[k] = 0
        if code >= _NEAR:
            # Try the other root where this one is far
            t = np.float32(_root(solve, q, u, v, 1 - last))
            r = np.int32(here - _ordered(t.view(np.int32)))
            other = np.uint32((r << 1) ^ (r >> 31))
            if other < code:
                code = other
                roots[k] = 1
                last_root[q] = 1 - last
        residual[k] = code


@inner_kernel
def _fold(value: int, predicted: int) -> np.uint16:
    """Zigzag of the difference modulo 2^16."""
    r = np.uint16(value - predicted)
    sign = np.uint16(np.uint16(0) - np.uint16(r >> np.uint16(15)))
    return np.uint16(np.uint16(r << np.uint16(1)) ^ sign)


@lean_kernel
def encode_crossings(
    counts: NDArray[np.uint16],
    detector: NDArray[np.int16],
    cell: NDArray[np.uint16],
    cosine: NDArray[np.int16],
    uv: NDArray[np.uint16],
    position: NDArray[np.float32],
    frames: NDArray[np.float64],
    flat: NDArray[np.uint8],
    cells: NDArray[np.int64],
    reverse: bool,
    out: NDArray[np.uint16],
) -> int:
    """Residuals (5, n) of cell u, cell v, cosine, u, v; returns how many are not zero."""
    k = 0
    missed = 0
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
            out[0, k] = _fold(int(cell[k, 0]), _cell_of(int(uv[k, 0]), cells[d, 0]))
            out[1, k] = _fold(int(cell[k, 1]), _cell_of(int(uv[k, 1]), cells[d, 1]))
            out[2, k] = _fold(int(cosine[k]), c)
            out[3, k] = _fold(int(uv[k, 0]), u)
            out[4, k] = _fold(int(uv[k, 1]), v)
            for m in range(5):
                missed += out[m, k] != 0
            k += 1
    return missed
