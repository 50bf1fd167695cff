"""Bare and evenly coated lens faces, many rays at a time.

Most rays of a lens run in a stream: from one face they meet the next one, in the same medium, and
are refracted there. A stream is followed from face to face in columns that stay in the first-level
cache, in loops that the compiler vectorises, with the same arithmetic and the same random numbers
as `interact`. A ray that turns off (reflected, absorbed, on another face) is put back among the
live rays; everything else about it is dealt with there.
"""

from __future__ import annotations

import math

import numpy as np

from raymap.events import Event
from raymap.kernels import inner_kernel, number, unsigned
from tracer.engine.buffers import (
    BUNDLE_CODE,
    BUNDLE_OWN,
    BUNDLE_SLOT,
    CODE,
    COUNTING,
    HIT,
    KEY,
    LAST,
    LEFT_OUT,
    LIVE,
    MEDIUM,
    N_RECORDS,
    NEST,
    OWN,
    RAY,
    RECORDS,
    RNG,
    Buffers,
    T,
)
from tracer.engine.nests import enter_body, leave_body, top_body
from tracer.engine.random import advance, uniform
from tracer.engine.records import whole, write_words
from tracer.geometry.kinds import F64, I64, SPHERE, Integer
from tracer.geometry.nearest import DISTANCE, nearest_on_face
from tracer.geometry.normals import face_normal
from tracer.scene.arrays import (
    B_MEDIUM,
    DEPTH,
    F_AXIS,
    F_EVENT,
    F_INSIDE,
    F_KIND,
    F_OBJECT,
    F_OUTSIDE,
    F_SURFACE,
    F_TRIANGLE,
    I32,
    M_DISPERSIVE,
    S_MODEL,
    SURFACE_ROW,
    WORLD,
    Faces,
)

__all__ = ["DONE", "follow_settled"]

DONE = -2
"""In place of the face that a ray meets: what happened there has been dealt with."""

_FEW = 32
"""A stream of fewer rays is not followed."""

_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_MEDIUM_CHANGED = int(Event.MEDIUM_CHANGED)

# Rows of stream_f: origin 0-2, direction 3-5, distances 6-7 (as in a bundle), then what a meeting
# needs: indices before and beyond, random number, normal, point, direction after, what happens,
# cosine of incidence, ratio of indices, cosine² of refraction, scratch, whether it crosses
_N1, _N2, _U, _NORMAL, _POINT, _AFTER, _OUTCOME = 8, 9, 10, 11, 14, 17, 20
_COSINE, _ETA, _COS2, _SCRATCH, _ALONG = 21, 22, 23, 24, 25
# Rows of stream_i: as in a bundle, then random state, colour code, last record, ray of the block
_RNG, _CODE, _LAST, _RAY = 4, 5, 6, 7
_PACKED = 1  # normals for the record, while the faces met are not needed
_OTHER_SIDE, _CROSSES, _TURNS, _TOTAL = 0.0, 1.0, 2.0, 3.0


@inner_kernel
def follow_settled(
    scene: Faces, b: Buffers, row: Integer, key: int, place: int, face: int, m: int
) -> int:
    """Deal with rays of a bundle whose hit is settled; pack the others and return how many.

    Rays that meet ``face`` in the same medium as the first of them are followed as a stream; of the
    others hit and distance are noted.
    """
    bundle_f, bundle_i, f, g = b.bundle_f, b.bundle_i, b.stream_f, b.stream_i
    live_f, live_i, ray_i = b.live_f, b.live_i, b.ray_i
    settle, n_faces, depth = scene.settle, len(scene.face_i), scene.limits[DEPTH]
    n_channels = b.colors.shape[1]
    mixed = True
    for medium in range(len(scene.medium_i)):
        mixed = mixed and scene.medium_i[medium, M_DISPERSIVE] == 0
    kept, size, deepest = number(0), number(0), number(0)
    nest, medium = number(-1), number(-1)
    for j in range(m):
        hit = bundle_i[BUNDLE_CODE + row, j]
        i = unsigned(bundle_i[BUNDLE_SLOT, j])
        if hit < 0 or settle[key, unsigned(hit)] > place:
            to = unsigned(kept)
            bundle_i[BUNDLE_SLOT, to] = i
            bundle_i[BUNDLE_OWN, to] = bundle_i[BUNDLE_OWN, j]
            bundle_i[BUNDLE_CODE + row, to] = hit
            bundle_f[DISTANCE + row, to] = bundle_f[DISTANCE + row, j]
            for k in range(6):
                bundle_f[k, to] = bundle_f[k, j]
            kept += 1
            continue
        met = hit if hit < n_faces else hit - n_faces
        if size == 0:
            nest, medium = live_i[NEST, i], live_i[MEDIUM, i]
        code, count = live_i[CODE, i], ray_i[N_RECORDS, unsigned(live_i[RAY, i])]
        if (
            met == face
            and live_i[NEST, i] == nest
            and live_i[MEDIUM, i] == medium
            and (code < n_channels or mixed)
            and count < depth
        ):
            to = unsigned(size)
            for k in range(6):
                f[k, to] = bundle_f[k, j]
            f[DISTANCE, to] = bundle_f[DISTANCE + row, j]
            g[BUNDLE_SLOT, to] = i
            g[_RNG, to] = live_i[RNG, i]
            g[_CODE, to] = code
            g[_RAY, to] = live_i[RAY, i]
            g[_LAST, to] = live_i[LAST, i]
            deepest = max(deepest, count)
            size += 1
        else:
            live_f[T, i] = bundle_f[DISTANCE + row, j]
            live_i[HIT, i] = met
    if size > 0:
        _follow(scene, b, face, nest, medium, size, depth - deepest)
    return kept


@inner_kernel
def _follow(
    scene: Faces, b: Buffers, face: int, nest: int, medium: int, size: int, most: int
) -> None:
    """Follow a stream of rays that meet ``face``, for at most ``most`` records."""
    f, g, live_f, live_i, ray_i = b.stream_f, b.stream_i, b.live_f, b.live_i, b.ray_i
    legs, key, row = number(0), number(-1), number(0)
    while True:
        # Find out where the first ray goes if it crosses
        beyond, inward = _cross(
            scene.face_i, scene.face_f, scene.body_i, face, nest,
            f[0, 0] + f[DISTANCE + row, 0] * f[3, 0], f[1, 0] + f[DISTANCE + row, 0] * f[4, 0],
            f[2, 0] + f[DISTANCE + row, 0] * f[5, 0], f[3, 0], f[4, 0], f[5, 0],
        )  # fmt: skip
        room = len(b.words) - b.counters[RECORDS] - b.counters[LIVE]
        if beyond < 0 or legs == most or (legs > 0 and size > room):
            break
        body = top_body(beyond)
        other = scene.body_i[unsigned(body), B_MEDIUM] if body >= 0 else scene.limits[WORLD]
        _look_up(scene.medium_i, scene.medium_f, f, g, b.colors.shape[1], medium, other, size)
        _refract(scene.face_f, face, scene.face_i[face, F_KIND], f, row, size)
        _reflectance(scene.surface_i, scene.surface_f, scene.face_i[face, F_SURFACE], f, size)
        _choose(f, size, inward)
        _turn(f, size)
        size, along = _cross_over(scene, b, face, key, nest, medium, other, beyond, legs, row, size)
        legs += 1
        nest, medium = beyond, other
        key = 2 * face + along
        row = number(0)
        target = scene.target[key]
        if size < _FEW or target < 0:
            break
        # Find the rays that meet the face which most are bound for
        _start(f, g, face, size)
        first = scene.first[key]
        for c in range(first, first + target + 1):
            face = scene.face[c]
            nearest_on_face(
                scene.face_i[face, F_KIND], scene.face_f, face, scene.pool, f, g, row, size
            )
            row = 1 - row
        size = _keep_met(
            scene.settle, f, g, live_f, live_i, ray_i, face, key, target, nest, medium, legs, row,
            size,
        )  # fmt: skip
        if size < _FEW:
            break
    for j in range(size):
        _put_back(f, g, live_f, live_i, ray_i, j, face, key, nest, medium, legs, row)


@inner_kernel
def _cross(
    face_i: I64, face_f: F64, body_i: I64, face: int, nest: int, x: float, y: float, z: float,
    dx: float, dy: float, dz: float,
) -> tuple[int, bool]:  # fmt: skip
    """Nest beyond a face, -1 where that needs a closer look; whether the ray is on its way in."""
    nx, ny, nz = face_normal(face_i[face, F_KIND], face_f, face, x, y, z)
    inward = dx * nx + dy * ny + dz * nz < 0.0
    inside, outside = face_i[face, F_INSIDE], face_i[face, F_OUTSIDE]
    beyond = nest
    if inside < 0:
        return -1, inward
    if inward:
        if outside >= 0:
            beyond = leave_body(beyond, outside)
        if beyond >= 0:
            beyond = enter_body(beyond, inside, body_i)
    else:
        beyond = leave_body(beyond, inside)
        if beyond >= 0 and outside >= 0:
            beyond = enter_body(beyond, outside, body_i)
    if beyond >= 0 and top_body(beyond) == top_body(nest):
        beyond = -1
    return beyond, inward


@inner_kernel
def _look_up(
    medium_i: I64,
    medium_f: F64,
    f: F64,
    g: I64,
    n_channels: int,
    medium: int,
    other: int,
    size: int,
) -> None:
    """Indices on both sides and the next random number of each ray."""
    if medium_i[medium, M_DISPERSIVE] == 0 and medium_i[other, M_DISPERSIVE] == 0:
        n1, n2 = medium_f[medium, 0], medium_f[other, 0]
        for j in range(size):
            f[_N1, j] = n1
        for j in range(size):
            f[_N2, j] = n2
    else:
        for j in range(size):
            code = g[_CODE, j]
            channel = unsigned(code if code < n_channels else 0)
            f[_N1, j] = medium_f[medium, channel]
            f[_N2, j] = medium_f[other, channel]
    for j in range(size):
        f[_U, j] = uniform(advance(np.uint64(g[_RNG, j])))


@inner_kernel
def _refract(table: F64, face: int, kind: int, f: F64, row: Integer, size: int) -> None:
    """Points on the face, normals and angles there, as `tracer.engine.surfaces` has them.

    Every loop writes one row: the compiler vectorises what it can prove not to overlap.
    """
    for k in range(3):
        for j in range(size):
            f[_POINT + k, j] = f[k, j] + f[DISTANCE + row, j] * f[3 + k, j]
    if kind == SPHERE:
        scale, radius = table[face, 8], table[face, 6]
        for k in range(3):
            vertex, offset = table[face, k], radius * table[face, 3 + k]
            for j in range(size):
                f[_NORMAL + k, j] = scale * (f[_POINT + k, j] - vertex - offset)
    else:
        for k in range(3):
            component = table[face, 3 + k]
            for j in range(size):
                f[_NORMAL + k, j] = component
    for j in range(size):
        f[_COSINE, j] = f[3, j] * f[_NORMAL, j] + f[4, j] * f[_NORMAL + 1, j] + f[5, j] * f[_NORMAL + 2, j]  # noqa: E501  # fmt: skip
    for j in range(size):
        f[_ETA, j] = f[_N1, j] / f[_N2, j]
    for j in range(size):
        eta, cos_i = f[_ETA, j], min(1.0, abs(f[_COSINE, j]))
        f[_COS2, j] = 1.0 - eta * eta * (1.0 - cos_i * cos_i)


@inner_kernel
def _turn(f: F64, size: int) -> None:
    """Turn the directions and keep them of unit length."""
    for k in range(3):
        for j in range(size):
            f[_AFTER + k, j] = f[_SCRATCH, j] * f[3 + k, j] + f[_ALONG, j] * f[_NORMAL + k, j]
    for j in range(size):
        ex, ey, ez = f[_AFTER, j], f[_AFTER + 1, j], f[_AFTER + 2, j]
        f[_SCRATCH, j] = 1.5 - 0.5 * (ex * ex + ey * ey + ez * ez)
    for k in range(3):
        for j in range(size):
            f[_AFTER + k, j] *= f[_SCRATCH, j]


@inner_kernel
def _reflectance(surface_i: I64, surface_f: F64, surface: int, f: F64, size: int) -> None:
    if surface_i[surface, S_MODEL] != 0:
        even = surface_f[surface, SURFACE_ROW]
        for j in range(size):
            f[_SCRATCH, j] = even
        return
    for j in range(size):
        n1, n2 = f[_N1, j], f[_N2, j]
        cos_i, cos_t = min(1.0, abs(f[_COSINE, j])), math.sqrt(max(f[_COS2, j], 0.0))
        a, b = n1 * cos_i, n2 * cos_t
        c, d = n2 * cos_i, n1 * cos_t
        s, p = (a - b) * (c + d), (c - d) * (a + b)
        below = (a + b) * (c + d)
        f[_SCRATCH, j] = 0.5 * (s * s + p * p) / (below * below)


@inner_kernel
def _choose(f: F64, size: int, inward: bool) -> None:
    """Refraction or reflection, and the factors of direction and normal in the new direction."""
    for j in range(size):
        crosses = (f[_COS2, j] > 0.0) & (f[_U, j] >= f[_SCRATCH, j])
        outcome = _CROSSES if crosses else (_TURNS if f[_COS2, j] > 0.0 else _TOTAL)
        f[_OUTCOME, j] = outcome if (f[_COSINE, j] < 0.0) == inward else _OTHER_SIDE
    for j in range(size):
        cosine = f[_COSINE, j]
        cos_i = min(1.0, abs(cosine))
        through = f[_ETA, j] * cos_i - math.sqrt(max(f[_COS2, j], 0.0))
        along = through if f[_OUTCOME, j] == _CROSSES else 2.0 * cos_i
        f[_ALONG, j] = -along if cosine > 0.0 else along
    for j in range(size):
        f[_SCRATCH, j] = f[_ETA, j] if f[_OUTCOME, j] == _CROSSES else 1.0


@inner_kernel
def _cross_over(
    scene: Faces, b: Buffers, face: int, key: int, nest: int, medium: int, other: int,
    beyond: int, legs: int, row: Integer, size: int,
) -> tuple[int, int]:  # fmt: skip
    """Move the rays onto the face; keep those that cross and put back the others.

    Returns how many go on, and whether along the main axis of the face.
    """
    f, g, live_f, live_i, ray_i = b.stream_f, b.stream_i, b.live_f, b.live_i, b.ray_i
    for j in range(size - 1, -1, -1):
        if f[_OUTCOME, j] == _OTHER_SIDE:
            _put_back(f, g, live_f, live_i, ray_i, j, face, key, nest, medium, legs, row)
            size -= 1
            _fill(f, g, j, size, number(_OUTCOME))
    if b.counters[COUNTING] == 0:
        _record(scene, b, face, medium, other, size)
    else:
        # Its last record stands for all of a ray's way through the lens
        b.counters[LEFT_OUT] += size
    # Let the rays stand on the face
    for k in range(3):
        for j in range(size):
            f[k, j] = f[_POINT + k, j]
    for k in range(3):
        for j in range(size):
            f[3 + k, j] = f[_AFTER + k, j]
    for j in range(size):
        drawn = np.uint64(g[_RNG, j])
        g[_RNG, j] = np.int64(drawn if f[_OUTCOME, j] == _TOTAL else advance(drawn))
    # Keep those on the other side that go the same way
    axis = 3 + scene.face_i[face, F_AXIS]
    sense = 0
    for j in range(size):
        if f[_OUTCOME, j] == _CROSSES:
            sense = 1 if f[axis, j] >= 0.0 else 0
            break
    for j in range(size - 1, -1, -1):
        along = 1 if f[axis, j] >= 0.0 else 0
        crosses = f[_OUTCOME, j] == _CROSSES
        if not crosses or along != sense:
            _put_back(
                f, g, live_f, live_i, ray_i, j, face, 2 * face + along, beyond if crosses else nest,
                other if crosses else medium, legs + 1, row,
            )  # fmt: skip
            size -= 1
            _fill(f, g, j, size, number(5))
    return size, sense


@inner_kernel
def _record(
    scene: Faces, b: Buffers, face: int, medium: int, other: int, size: int
) -> None:  # fmt: skip
    """Write a record for every ray of a stream."""
    f, g, words, real, owners, exact = b.stream_f, b.stream_i, b.words, b.real, b.owners, b.exact
    obj, triangle = scene.face_i[face, F_OBJECT], scene.face_i[face, F_TRIANGLE]
    mark = scene.face_i[face, F_EVENT]
    crossed = mark | _REFRACTED | (_MEDIUM_CHANGED if other != medium else 0)
    for j in range(size):
        g[_PACKED, j] = (whole(f[_NORMAL, j]) & 0xFFFF) | (whole(f[_NORMAL + 1, j]) << 16)
    for j in range(size):
        g[_PACKED + 1, j] = whole(f[_NORMAL + 2, j]) & 0xFFFF
    r = b.counters[RECORDS]
    for j in range(size):
        outcome = f[_OUTCOME, j]
        event, inside = crossed, other
        if outcome != _CROSSES:
            event, inside = mark | (_REFLECTED if outcome == _TURNS else _TIR), medium
        write_words(
            words, real, owners, r + j, f[_POINT, j], f[_POINT + 1, j], f[_POINT + 2, j],
            g[_PACKED, j], g[_PACKED + 1, j] | obj << 16, triangle, event, inside, g[_CODE, j],
            g[_RAY, j],
        )  # fmt: skip
    if len(exact) > 0:
        for j in range(size):
            for k in range(3):
                exact[r + j, k] = f[_POINT + k, j]
    b.counters[RECORDS] = r + size
    for j in range(size):
        g[_LAST, j] = r + j


@inner_kernel
def _fill(f: F64, g: I64, j: int, last: int, rows: int) -> None:
    """Move the last ray of a stream to a place that became free."""
    if j != last:
        for k in range(rows + 1):
            f[k, j] = f[k, last]
        for k in range(BUNDLE_SLOT, _RAY + 1):
            g[k, j] = g[k, last]


@inner_kernel
def _start(f: F64, g: I64, face: int, size: int) -> None:
    """Nothing is met yet."""
    for j in range(size):
        f[DISTANCE, j] = math.inf
    for j in range(size):
        g[BUNDLE_CODE, j] = -1
    for j in range(size):
        g[BUNDLE_OWN, j] = face


@inner_kernel
def _keep_met(
    settle: I32, f: F64, g: I64, live_f: F64, live_i: I64, ray_i: I32, face: int, key: int,
    place: int, nest: int, medium: int, legs: int, row: Integer, size: int,
) -> int:  # fmt: skip
    """Keep the rays whose hit on ``face`` is settled, put back the others."""
    leaving = face + settle.shape[1] // 2
    near, far = settle[key, face] <= place, settle[key, leaving] <= place
    for j in range(size - 1, -1, -1):
        hit = g[BUNDLE_CODE + row, j]
        if not ((hit == face and near) or (hit == leaving and far)):
            _put_back(f, g, live_f, live_i, ray_i, j, face, key, nest, medium, legs, row)
            size -= 1
            _fill(f, g, j, size, number(DISTANCE + 1))
    return size


@inner_kernel
def _put_back(
    f: F64,
    g: I64,
    live_f: F64,
    live_i: I64,
    ray_i: I32,
    j: int,
    face: int,
    key: int,
    nest: int,
    medium: int,
    legs: int,
    row: Integer,
) -> None:
    """Bring a ray up to date that is no longer followed.

    A ray of which no record is written yet stands where it was: it is about to meet ``face``.
    """
    i = unsigned(g[BUNDLE_SLOT, j])
    if legs == 0:
        live_f[T, i] = f[DISTANCE + row, j]
        live_i[HIT, i] = face
        return
    for k in range(6):
        live_f[k, i] = f[k, j]
    live_i[OWN, i], live_i[KEY, i] = key >> 1, key
    live_i[NEST, i], live_i[MEDIUM, i] = nest, medium
    live_i[RNG, i], live_i[LAST, i] = g[_RNG, j], g[_LAST, j]
    live_i[HIT, i] = DONE
    ray_i[N_RECORDS, unsigned(g[_RAY, j])] += legs
