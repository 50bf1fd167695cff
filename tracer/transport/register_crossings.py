"""Crossings of segments and detectors: planes, faces, far fields, cameras."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64, I32, I64
from raymap.model.events import Event
from tracer.compiled import (
    CAMERA,
    D_CELLS_U,
    D_CELLS_V,
    D_REGISTER,
    D_VIRTUAL,
    FAR_FIELD,
    FLAT_MAP,
    NO_VIEW,
    ROUND_MAP,
    VIEW_BY_KIND,
    Views,
)
from tracer.detectors.detector import REGISTER
from tracer.transport.buffers import (
    CHAIN,
    COUNT,
    D_CELL,
    D_COSINE,
    D_DETECTOR,
    D_PREVIOUS,
    D_RECORD,
    D_REGISTERED,
    D_UV,
    DESCRIPTORS,
    EVENT,
)

__all__ = [
    "Descriptors",
    "Detectors",
    "Segment",
    "near_planes",
    "pass_planes",
    "pass_views",
    "register_on_face",
]

_register = REGISTER.call

CROSSED = int(Event.DETECTOR_CROSSED)
REGISTERED = int(Event.DETECTOR_REGISTERED)


@inline_kernel
def near_planes(
    sphere: F64, x: float, y: float, z: float, dx: float, dy: float, dz: float, t: float
) -> bool:
    """Whether the box of a segment and that of all virtual planes overlap."""
    ex, ey, ez = x + t * dx, y + t * dy, z + t * dz
    below = (x < sphere[4]) & (ex < sphere[4])
    below |= (y < sphere[5]) & (ey < sphere[5])
    below |= (z < sphere[6]) & (ez < sphere[6])
    above = (x > sphere[7]) & (ex > sphere[7])
    above |= (y > sphere[8]) & (ey > sphere[8])
    above |= (z > sphere[9]) & (ez > sphere[9])
    return not (below | above)


class Detectors(NamedTuple):
    """The detectors of a scene, as in `tracer.compiled.CompiledScene`."""

    detector_i: I64
    detector_f: F64


class Descriptors(NamedTuple):
    """Where descriptors are written, columns of `tracer.transport.buffers.Buffers`."""

    words: I32
    crossings: I32
    crossing_t: F64
    counters: I64


class Segment(NamedTuple):
    """A straight piece of a ray: its record, where it starts, its unit direction and length."""

    record: int
    x: float
    y: float
    z: float
    dx: float
    dy: float
    dz: float
    t: float


@inner_kernel
def pass_planes(
    detectors: Detectors, segment: Segment, reach: float, descriptors: Descriptors
) -> None:
    """Note the virtual planes that a segment crosses, or on which it ends.

    What is within ``reach`` of a plane lies on it: light that meets a face in the plane of a
    detector is counted as it arrives, and not again as it goes on.
    """
    x, y, z, t_end = segment.x, segment.y, segment.z, segment.t
    dx, dy, dz = segment.dx, segment.dy, segment.dz
    for d in range(len(detectors.detector_i)):
        if detectors.detector_i[d, D_VIRTUAL] == 0:
            continue
        s = detectors.detector_f[d]
        d_n = dx * s[9] + dy * s[10] + dz * s[11]
        height = (x - s[0]) * s[9] + (y - s[1]) * s[10] + (z - s[2]) * s[11]
        if abs(height) <= reach:
            continue
        t = -height / d_n
        if not (t > 0.0 and (t <= t_end or abs(height + t_end * d_n) <= reach)):
            continue
        t = min(t, t_end)
        px, py, pz = x + t * dx - s[0], y + t * dy - s[1], z + t * dz - s[2]
        p_u = px * s[3] + py * s[4] + pz * s[5]
        p_v = px * s[6] + py * s[7] + pz * s[8]
        # Most planes are far off: that takes no division
        if abs(p_u) > s[12] or abs(p_v) > s[13]:
            continue
        u, v = p_u / s[12] + 0.5, p_v / s[13] + 0.5
        if u < 0.0 or u > 1.0 or v < 0.0 or v > 1.0:
            continue
        _describe(detectors, d, segment.record, u, v, -d_n, t, descriptors)


@inline_kernel
def pass_views(
    views: Views | None, detectors: Detectors, segment: Segment, left: bool,
    descriptors: Descriptors,
) -> None:  # fmt: skip
    """Note the cameras that a segment passes and, where it leaves the scene, the far fields."""
    if views is not None:
        _pass_views(views, detectors, segment, left, descriptors)


@inner_kernel
def _pass_views(
    views: Views, detectors: Detectors, segment: Segment, left: bool, descriptors: Descriptors
) -> None:
    kinds, numbers = views.kind, views.numbers
    x, y, z = segment.x, segment.y, segment.z
    dx, dy, dz = segment.dx, segment.dy, segment.dz
    for d in range(len(kinds)):
        kind = kinds[d]
        if kind == VIEW_BY_KIND:
            _ask_kind(detectors, numbers, d, segment, left, descriptors)
            continue
        if kind != CAMERA and not (left and kind == FAR_FIELD):
            continue
        s = numbers[d]
        d_u = dx * s[3] + dy * s[4] + dz * s[5]
        d_v = dx * s[6] + dy * s[7] + dz * s[8]
        d_n = dx * s[9] + dy * s[10] + dz * s[11]
        if kind == FAR_FIELD:
            u = math.atan2(d_v, d_u) / (2.0 * math.pi)
            u = u + 1.0 if u < 0.0 else u
            gamma = math.atan2(math.sqrt(d_u * d_u + d_v * d_v), d_n)
            v = (gamma - s[12]) / (s[13] - s[12])
            if v < 0.0 or v > 1.0:
                continue
            _describe(detectors, d, segment.record, u, v, 1.0, segment.t, descriptors)
            continue
        # Cross the lens from the front
        if d_n >= 0.0:
            continue
        t = ((s[0] - x) * s[9] + (s[1] - y) * s[10] + (s[2] - z) * s[11]) / d_n
        if not 0.0 < t <= segment.t:
            continue
        px, py, pz = x + t * dx - s[0], y + t * dy - s[1], z + t * dz - s[2]
        if px * px + py * py + pz * pz > s[12] * s[12]:
            continue
        # Go back to the plane of focus: the lens images every point there to one place
        u = (px * s[3] + py * s[4] + pz * s[5]) * s[13] + d_u / d_n
        v = (px * s[6] + py * s[7] + pz * s[8]) * s[13] + d_v / d_n
        u = 0.5 + 0.5 * u / s[14]
        v = 0.5 + 0.5 * v / s[15]
        if u < 0.0 or u > 1.0 or v < 0.0 or v > 1.0:
            continue
        _describe(detectors, d, segment.record, u, v, -d_n, t, descriptors)


@inner_kernel
def _ask_kind(
    detectors: Detectors, numbers: F64, d: int, segment: Segment, left: bool,
    descriptors: Descriptors,
) -> None:  # fmt: skip
    """Ask a kind of another distribution whether light registers on a segment."""
    s = numbers[d]
    x, y, z = segment.x - s[0], segment.y - s[1], segment.z - s[2]
    dx, dy, dz = segment.dx, segment.dy, segment.dz
    t, u, v, cosine = _register(
        detectors.detector_i[d, D_REGISTER],
        (
            s[12:],
            x * s[3] + y * s[4] + z * s[5],
            x * s[6] + y * s[7] + z * s[8],
            x * s[9] + y * s[10] + z * s[11],
            dx * s[3] + dy * s[4] + dz * s[5],
            dx * s[6] + dy * s[7] + dz * s[8],
            dx * s[9] + dy * s[10] + dz * s[11],
            segment.t,
            left,
        ),
    )
    if 0.0 <= t <= segment.t and 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0:
        _describe(detectors, d, segment.record, u, v, cosine, t, descriptors)


@inline_kernel
def register_on_face(
    views: Views | None, detectors: Detectors, d: int, segment: Segment, x: float, y: float,
    z: float, cosine: float, triangle: int, descriptors: Descriptors,
) -> int:  # fmt: skip
    """Register light that meets the face of a detector at (x, y, z); event bits of that point.

    ``cosine`` is that of the ray with the outward normal of the face.
    """
    # Two questions, not one: the compiler leaves the branch out where there are no views
    if views is not None:  # noqa: SIM102
        if views.kind[d] != NO_VIEW:
            _map_on_face(views, detectors, d, segment, x, y, z, cosine, triangle, descriptors)
            return 0
    return _register_on_plane(detectors, d, segment, x, y, z, descriptors)


@inner_kernel
def _map_on_face(
    views: Views, detectors: Detectors, d: int, segment: Segment, x: float, y: float, z: float,
    cosine: float, triangle: int, descriptors: Descriptors,
) -> None:  # fmt: skip
    """Register light that arrives on a face in the map of that face."""
    s = views.numbers[d]
    px, py, pz = x - s[0], y - s[1], z - s[2]
    p_u = px * s[3] + py * s[4] + pz * s[5]
    p_v = px * s[6] + py * s[7] + pz * s[8]
    kind = views.kind[d]
    if kind == FLAT_MAP:
        u, v = p_u / s[12] + 0.5, p_v / s[13] + 0.5
    elif kind == ROUND_MAP:
        u = math.atan2(p_v, p_u) / (2.0 * math.pi)
        u = u + 1.0 if u < 0.0 else u
        v = (px * s[9] + py * s[10] + pz * s[11] - s[12]) / (s[13] - s[12])
    else:
        cell = triangle - np.int64(s[12])
        n_u, n_v = detectors.detector_i[d, D_CELLS_U], detectors.detector_i[d, D_CELLS_V]
        u, v = (cell % n_u + 0.5) / n_u, (cell // n_u + 0.5) / n_v
    u, v = min(1.0, max(0.0, u)), min(1.0, max(0.0, v))
    _describe(detectors, d, segment.record, u, v, -cosine * s[14], segment.t, descriptors)


@inner_kernel
def _register_on_plane(
    detectors: Detectors, d: int, segment: Segment, x: float, y: float, z: float,
    descriptors: Descriptors,
) -> int:  # fmt: skip
    """Register a crossing of a blocking plane; event bits of that point."""
    s = detectors.detector_f[d]
    px, py, pz = x - s[0], y - s[1], z - s[2]
    u = min(1.0, max(0.0, (px * s[3] + py * s[4] + pz * s[5]) / s[12] + 0.5))
    v = min(1.0, max(0.0, (px * s[6] + py * s[7] + pz * s[8]) / s[13] + 0.5))
    cosine = -(segment.dx * s[9] + segment.dy * s[10] + segment.dz * s[11])
    if _describe(detectors, d, segment.record, u, v, cosine, segment.t, descriptors):
        return REGISTERED
    return 0


@inner_kernel
def _describe(
    detectors: Detectors, d: int, record: int, u: float, v: float, cosine: float, t: float,
    descriptors: Descriptors,
) -> bool:  # fmt: skip
    """Write a descriptor and sum it up in the record of its segment; True if it registers."""
    words, crossings = descriptors.words, descriptors.crossings
    facing = abs(cosine) if detectors.detector_f[d, 15] > 0.0 else cosine
    registered = facing > 0.0 and facing >= detectors.detector_f[d, 14]
    n_u, n_v = detectors.detector_i[d, D_CELLS_U], detectors.detector_i[d, D_CELLS_V]
    cell_u = min(n_u - 1, np.int64(u * n_u))
    cell_v = min(n_v - 1, np.int64(v * n_v))
    k = descriptors.counters[DESCRIPTORS]
    crossings[k, D_DETECTOR] = d
    crossings[k, D_CELL] = cell_u | (cell_v << 16)
    crossings[k, D_UV] = np.int64(u * 65535.0 + 0.5) | (np.int64(v * 65535.0 + 0.5) << 16)
    crossings[k, D_COSINE] = np.int64(math.floor(cosine * 32767.0 + 0.5))
    crossings[k, D_REGISTERED] = registered
    crossings[k, D_PREVIOUS] = words[record, CHAIN]
    crossings[k, D_RECORD] = record
    descriptors.crossing_t[k] = t
    descriptors.counters[DESCRIPTORS] = k + 1
    words[record, CHAIN] = k
    words[record, COUNT] += 1
    words[record, EVENT] |= CROSSED | (REGISTERED if registered else 0)
    return registered
