"""Where recorded light crosses places that no detector stood at.

A segment crosses a plane where the signs of its ends differ, 0 being one of the positive numbers:
light that comes to a plane and goes on counts once, wherever its points lie. Light that leaves the
scene goes on beyond its last point, in the direction that its last two points show.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.file.stored import StoredPortion
from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.model.directory import Detector
from raymap.model.errors import FormatError, RayMapError
from raymap.model.events import Event
from raymap.model.rows import offsets_of
from raymap.model.schema import NORMAL_SCALE, UV_SCALE

__all__ = ["Crossings", "Place", "Segments", "crossings_of_rays", "may_be_placed"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
_PLANE, _SPHERE, _FAR_FIELD = range(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """A detector that was not there when the map was recorded.

    Attributes
    ----------
    detector : its entry: a plane, a far field, or a sphere (kind ``surface`` whose parameter
        ``sphere_radius`` is there, about ``center``)
    both_sides : it registers light from both sides, not only light that goes against its normal
    least_cosine : of light that it registers, with its normal
    """

    detector: Detector
    both_sides: bool = True
    least_cosine: float = 0.0

    def registers(self, cosine: F64) -> NDArray[np.bool_]:
        """Which crossings (n,) count, by the cosine with the direction that the detector looks."""
        facing = np.abs(cosine) if self.both_sides else cosine
        found: NDArray[np.bool_] = (facing > 0.0) & (facing >= self.least_cosine)
        return found

    @property
    def numbers(self) -> tuple[int, F64]:
        """Its kind, and what compiled loops need: center, axes, then sizes."""
        d = self.detector
        u, v = np.asarray(d.axis_u, np.float64), np.asarray(d.axis_v, np.float64)
        frame = [*d.center, *u, *v, *np.cross(u, v)]
        if d.kind == "far_field":
            # C may run the other way round, so that u x v is not the axis
            frame[9:] = d.parameters["axis"]
            low, high = d.parameters["gamma_deg"]
            return _FAR_FIELD, np.array([*frame, math.radians(low), math.radians(high)])
        if d.kind == "surface":
            return _SPHERE, np.array([*frame, float(d.parameters["sphere_radius"]), 0.0])
        return _PLANE, np.array([*frame, *d.size])


def may_be_placed(detector: Detector) -> bool:
    """Whether it is of a kind that light can be found to cross."""
    return (
        detector.kind in ("plane", "far_field")
        and (detector.kind == "plane" or {"gamma_deg", "axis"} <= set(detector.parameters))
    ) or (detector.kind == "surface" and "sphere_radius" in detector.parameters)


class Crossings(NamedTuple):
    """Crossings in the order of the records.

    Attributes
    ----------
    record : (n,) that the crossed segment starts at
    reach : (n,) where along it, 0 to 1, or beyond where light left the scene
    uv : (n, 2) place, 0 to 1
    cosine : (n,) with the direction that the detector looks, as descriptors have it
    """

    record: I64
    reach: F64
    uv: F64
    cosine: F64

    def stored(self, cells: tuple[int, int]) -> tuple[NDArray[np.uint16], ...]:
        """Cells (n, 2) and places (n, 2) as maps store them."""
        grid = np.asarray(cells)
        cell = np.minimum(grid - 1, (self.uv * grid).astype(np.int64))
        return cell.astype(np.uint16), np.floor(self.uv * UV_SCALE + 0.5).astype(np.uint16)

    def stored_cosine(self) -> NDArray[np.int16]:
        """(n,) as maps store it."""
        return np.floor(self.cosine * NORMAL_SCALE + 0.5).astype(np.int16)


class Segments:
    """The segments of a portion's rays, read once for all places."""

    def __init__(self, portion: StoredPortion) -> None:
        self._offsets = portion.record_offsets()
        self._position = portion.column("position")
        event = portion.column("event")
        self._ends = self._offsets[1:] - 1
        self._end_event = event[self._ends]
        goes_on = np.ones(len(event), np.bool_)
        goes_on[self._ends] = False
        leaves = np.zeros(len(event), np.bool_)
        left = self._ends[(self._end_event & int(Event.LEFT_SCENE)) != 0] - 1
        leaves[left[left >= 0]] = True
        self._begin = np.flatnonzero(goes_on)
        self._leaves = leaves[self._begin]

    def cross(self, place: Place) -> Crossings:
        """Where they cross a place."""
        return _found(place, self._position, self._begin, self._leaves, beyond=False)

    def ended_before(self, place: Place) -> I64:
        """(n,) rays that ended on a surface, and would have crossed a place had they gone on."""
        ended = (self._end_event & int(Event.SURFACE_ABSORPTION)) != 0
        rays = np.flatnonzero(ended & (np.diff(self._offsets) > 1))
        begin = self._ends[rays] - 1
        everywhere = np.ones(len(begin), np.bool_)
        met = _found(place, self._position, begin, everywhere, beyond=True)
        chosen = met.record[place.registers(met.cosine)]
        return rays[np.isin(begin, chosen)]


def crossings_of_rays(
    place: Place, position: Any, starts: I64, counts: I64, left: NDArray[np.bool_]
) -> I64:
    """(n_rays,) how often each of some rays registers at a place.

    Parameters
    ----------
    position : (n_records, 3) of a portion
    starts, counts : (n_rays,) first record of each ray, ascending, and how many it has
    left : (n_rays,) whether it left the scene
    """
    pieces = np.maximum(counts - 1, 0)
    offsets = offsets_of(pieces)
    owner = np.repeat(np.arange(len(starts)), pieces)
    begin = starts[owner] + np.arange(int(offsets[-1])) - offsets[:-1][owner]
    leaves = np.zeros(len(begin), np.bool_)
    leaves[offsets[1:][left & (pieces > 0)] - 1] = True
    found = _found(place, position, begin, leaves, beyond=False)
    chosen = found.record[place.registers(found.cosine)]
    rays = owner[np.searchsorted(begin, chosen)]
    return np.bincount(rays, minlength=len(starts))


def _found(
    place: Place, position: Any, begin: I64, leaves: NDArray[np.bool_], *, beyond: bool
) -> Crossings:
    if position.shape[1:] != (3,):
        raise FormatError(f"positions {position.shape} are no places")
    if len(begin) and not 0 <= int(begin.min()) <= int(begin.max()) + 1 < len(position):
        raise FormatError("a segment has no end in its portion")
    kind, numbers = place.numbers
    if not np.isfinite(numbers).all():
        raise RayMapError(f"{place.detector.name}: its place and size are no numbers")
    # A sphere is crossed twice by some segments
    room = len(begin) * (2 if kind == _SPHERE else 1)
    record, found = np.empty(room, np.int64), np.empty((room, 4))
    n = _cross(kind, numbers, position, begin, leaves, beyond, record, found)
    record, found = record[:n].copy(), found[:n].copy()
    return Crossings(record, found[:, 0], found[:, 1:3], found[:, 3])


@lean_kernel
def _cross(
    kind: int, f: F64, position: NDArray[np.float32], begin: I64, leaves: NDArray[np.bool_],
    beyond: bool, record: I64, found: F64,
) -> int:  # fmt: skip
    """Write what crosses; ``beyond``: only behind the end of each segment."""
    n = 0
    for k in range(len(begin)):
        i = begin[k]
        dx = np.float64(position[i + 1, 0]) - np.float64(position[i, 0])
        dy = np.float64(position[i + 1, 1]) - np.float64(position[i, 1])
        dz = np.float64(position[i + 1, 2]) - np.float64(position[i, 2])
        first = i + 1 if beyond else i
        # In the frame of the detector
        px = np.float64(position[first, 0]) - f[0]
        py = np.float64(position[first, 1]) - f[1]
        pz = np.float64(position[first, 2]) - f[2]
        way = math.sqrt(dx * dx + dy * dy + dz * dz)
        if not way > 0.0:
            continue
        d_n = dx * f[9] + dy * f[10] + dz * f[11]
        if kind == _FAR_FIELD:
            if leaves[k]:
                d_u = dx * f[3] + dy * f[4] + dz * f[5]
                d_v = dx * f[6] + dy * f[7] + dz * f[8]
                u = math.atan2(d_v, d_u) / (2.0 * math.pi)
                u = u + 1.0 if u < 0.0 else u
                gamma = math.atan2(math.sqrt(d_u * d_u + d_v * d_v), d_n)
                n = _note(i, 1.0, u, (gamma - f[12]) / (f[13] - f[12]), 1.0, n, record, found)
            continue
        if kind == _SPHERE:
            n = _cross_sphere(f, i, px, py, pz, dx, dy, dz, leaves[k], n, record, found)
            continue
        height = px * f[9] + py * f[10] + pz * f[11]
        other = height + d_n
        if leaves[k]:
            other = d_n * math.inf if d_n != 0.0 else height
        if (height < 0.0) == (other < 0.0):
            continue
        t = -height / d_n
        qx, qy, qz = px + t * dx, py + t * dy, pz + t * dz
        u = (qx * f[3] + qy * f[4] + qz * f[5]) / f[12] + 0.5
        v = (qx * f[6] + qy * f[7] + qz * f[8]) / f[13] + 0.5
        n = _note(i, t, u, v, -d_n / way, n, record, found)
    return n


@inner_kernel
def _note(
    i: int, t: float, u: float, v: float, cosine: float, n: int, record: I64, found: F64
) -> int:
    if not (0.0 <= u <= 1.0 and 0.0 <= v <= 1.0):
        return n
    record[n] = i
    found[n, 0], found[n, 1], found[n, 2], found[n, 3] = t, u, v, cosine
    return n + 1


@inner_kernel
def _cross_sphere(
    f: F64, i: int, px: float, py: float, pz: float, dx: float, dy: float, dz: float, leaves: bool,
    n: int, record: I64, found: F64,
) -> int:  # fmt: skip
    """The places where a segment meets a sphere, nearest first; u around the axis, v along it."""
    radius = f[12]
    a = dx * dx + dy * dy + dz * dz
    b = px * dx + py * dy + pz * dz
    start = px * px + py * py + pz * pz - radius * radius
    ex, ey, ez = px + dx, py + dy, pz + dz
    end = ex * ex + ey * ey + ez * ez - radius * radius
    if leaves:
        end = math.inf
    square = b * b - a * start
    if square <= 0.0:
        return n
    root = math.sqrt(square)
    outside, ends_outside = start >= 0.0, end >= 0.0
    for side in range(2):
        # In at the first root, out at the second
        if (side == 0 and not outside) or (side == 1 and not ends_outside):
            continue
        t = (-b - root) / a if side == 0 else (-b + root) / a
        if outside and ends_outside and not (t > 0.0 and (t < 1.0 or leaves)):
            continue
        qx, qy, qz = px + t * dx, py + t * dy, pz + t * dz
        q_u = qx * f[3] + qy * f[4] + qz * f[5]
        q_v = qx * f[6] + qy * f[7] + qz * f[8]
        q_n = qx * f[9] + qy * f[10] + qz * f[11]
        u = math.atan2(q_v, q_u) / (2.0 * math.pi)
        u = u + 1.0 if u < 0.0 else u
        v = min(1.0, max(0.0, 0.5 + 0.5 * q_n / radius))
        along = (qx * dx + qy * dy + qz * dz) / (radius * math.sqrt(a))
        n = _note(i, t, u, v, -along, n, record, found)
    return n
