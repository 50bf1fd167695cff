"""Streams of rays through bare and evenly coated lens faces.

Most rays of a lens run in a stream: from one face they meet the next one, in the same medium, and
are refracted there. A stream is followed from face to face in columns that stay in the first-level
cache, in loops that the compiler vectorises, with the same arithmetic and the same random numbers
as `interact`. A ray that turns off (reflected, absorbed, on another face) is put back among the
live rays; everything else about it is dealt with there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from raymap.jit.kernels import inner_kernel, number, unsigned
from raymap.jit.types import F64, I32, I64, Integer
from raymap.model.events import Event
from tracer.compiled import (
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
    M_DISPERSIVE,
    WORLD,
    Faces,
)
from tracer.geometry.nearest import DISTANCE, nearest_on_face
from tracer.geometry.normals import face_normal
from tracer.rays.random import advance
from tracer.transport.buffers import (
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
    OWN,
    RAY,
    RECORDS,
    RNG,
    STACK,
    Buffers,
    T,
)
from tracer.transport.medium_stack import enter_body, leave_body, top_body
from tracer.transport.records import RecordColumns, whole, write_words
from tracer.transport.refraction import (
    AFTER,
    CROSSES,
    NORMAL,
    OTHER_SIDE,
    OUTCOME,
    POINT,
    STREAM_CODE,
    STREAM_RNG,
    TOTAL,
    TURNS,
    choose,
    look_up,
    meet_face,
    reflectance,
    turn,
)

__all__ = ["DONE", "follow_decided"]

DONE = -2
"""In place of the face that a ray meets: what happened there has been dealt with."""

_FEW = 32
"""A stream of fewer rays is not followed."""

_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_MEDIUM_CHANGED = int(Event.MEDIUM_CHANGED)

# Rows of stream_i: as in a bundle, then random state, colour code, last record, ray of the block
_LAST, _RAY = 6, 7
_PACKED = 1  # normals for the record, while the faces met are not needed


class _Columns(NamedTuple):
    """Columns of a stream, and of the rays that it was taken from."""

    f: F64
    g: I64
    live_f: F64
    live_i: I64
    ray_i: I32


class _Leg(NamedTuple):
    """How far a stream is: the face it meets or stands on, its start bin, stack and medium, records
    written of each ray, row of the distances."""

    face: int
    key: int
    stack: int
    medium: int
    legs: int
    row: Integer


@inner_kernel
def follow_decided(
    scene: Faces, b: Buffers, row: Integer, listed: int, index: int, face: int, m: int
) -> int:
    """Deal with rays of a bundle whose hit is decided; pack the others and return how many.

    Rays that meet ``face`` in the same medium as the first of them are followed as a stream; of the
    others hit and distance are noted.
    """
    bundle_f, bundle_i, f, g = b.bundle_f, b.bundle_i, b.stream_f, b.stream_i
    live_f, live_i, ray_i = b.live_f, b.live_i, b.ray_i
    decided, n_faces, depth = scene.decided, len(scene.face_i), scene.limits[DEPTH]
    n_channels = b.colors.shape[1]
    mixed = True
    for medium in range(len(scene.medium_i)):
        mixed = mixed and scene.medium_i[medium, M_DISPERSIVE] == 0
    kept, size, deepest = number(0), number(0), number(0)
    stack, medium = number(-1), number(-1)
    for j in range(m):
        hit = bundle_i[BUNDLE_CODE + row, j]
        i = unsigned(bundle_i[BUNDLE_SLOT, j])
        if hit < 0 or decided[listed, unsigned(hit)] > index:
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
            stack, medium = live_i[STACK, i], live_i[MEDIUM, i]
        code, count = live_i[CODE, i], ray_i[N_RECORDS, unsigned(live_i[RAY, i])]
        if (
            met == face
            and live_i[STACK, i] == stack
            and live_i[MEDIUM, i] == medium
            and (code < n_channels or mixed)
            and count < depth
        ):
            to = unsigned(size)
            for k in range(6):
                f[k, to] = bundle_f[k, j]
            f[DISTANCE, to] = bundle_f[DISTANCE + row, j]
            g[BUNDLE_SLOT, to] = i
            g[STREAM_RNG, to] = live_i[RNG, i]
            g[STREAM_CODE, to] = code
            g[_RAY, to] = live_i[RAY, i]
            g[_LAST, to] = live_i[LAST, i]
            deepest = max(deepest, count)
            size += 1
        else:
            live_f[T, i] = bundle_f[DISTANCE + row, j]
            live_i[HIT, i] = met
    if size > 0:
        _follow(scene, b, face, stack, medium, size, depth - deepest)
    return kept


@inner_kernel
def _follow(
    scene: Faces, b: Buffers, face: int, stack: int, medium: int, size: int, most: int
) -> None:
    """Follow a stream of rays that meet ``face``, for at most ``most`` records."""
    f, g = b.stream_f, b.stream_i
    columns = _Columns(f, g, b.live_f, b.live_i, b.ray_i)
    legs, key, row = number(0), number(-1), number(0)
    while True:
        # Find out where the first ray goes if it crosses
        beyond, inward = _cross(
            scene.face_i, scene.face_f, scene.body_i, face, stack,
            f[0, 0] + f[DISTANCE + row, 0] * f[3, 0], f[1, 0] + f[DISTANCE + row, 0] * f[4, 0],
            f[2, 0] + f[DISTANCE + row, 0] * f[5, 0], f[3, 0], f[4, 0], f[5, 0],
        )  # fmt: skip
        room = len(b.words) - b.counters[RECORDS] - b.counters[LIVE]
        if beyond < 0 or legs == most or (legs > 0 and size > room):
            break
        body = top_body(beyond, scene.body_i)
        other = scene.body_i[unsigned(body), B_MEDIUM] if body >= 0 else scene.limits[WORLD]
        look_up(scene.medium_i, scene.medium_f, f, g, b.colors.shape[1], medium, other, size)
        meet_face(scene.face_f, face, scene.face_i[face, F_KIND], f, row, size)
        reflectance(scene.surface_i, scene.surface_f, scene.face_i[face, F_SURFACE], f, size)
        choose(f, size, inward)
        turn(f, size)
        size, along = _cross_over(
            scene, b, face, key, stack, medium, other, beyond, legs, row, size
        )
        legs += 1
        stack, medium = beyond, other
        key = 2 * face + along
        row = number(0)
        listed = scene.list_of[key]
        target = scene.target[listed]
        if size < _FEW or target < 0:
            break
        # Find the rays that meet the face which most are bound for
        _start(f, g, face, size)
        first = scene.first[listed]
        for c in range(first, first + target + 1):
            face = scene.face[c]
            nearest_on_face(
                scene.face_i[face, F_KIND], scene.face_f, face, scene.pool, f, g, row, size
            )
            row = 1 - row
        leg = _Leg(face, key, stack, medium, legs, row)
        size = _keep_met(scene.decided, columns, leg, listed, target, size)
        if size < _FEW:
            break
    leg = _Leg(face, key, stack, medium, legs, row)
    for j in range(size):
        _put_back(columns, j, leg)


@inner_kernel
def _cross(
    face_i: I64, face_f: F64, body_i: I64, face: int, stack: int, x: float, y: float, z: float,
    dx: float, dy: float, dz: float,
) -> tuple[int, bool]:  # fmt: skip
    """Medium stack beyond a face, -1 if that needs a closer look; whether the ray enters."""
    nx, ny, nz = face_normal(face_i[face, F_KIND], face_f, face, None, x, y, z)
    inward = dx * nx + dy * ny + dz * nz < 0.0
    inside, outside = face_i[face, F_INSIDE], face_i[face, F_OUTSIDE]
    beyond = stack
    if inside < 0:
        return -1, inward
    if inward:
        if outside >= 0:
            beyond = leave_body(beyond, outside, body_i)
        if beyond >= 0:
            beyond = enter_body(beyond, inside, body_i)
    else:
        beyond = leave_body(beyond, inside, body_i)
        if beyond >= 0 and outside >= 0:
            beyond = enter_body(beyond, outside, body_i)
    if beyond >= 0 and top_body(beyond, body_i) == top_body(stack, body_i):
        beyond = -1
    return beyond, inward


@inner_kernel
def _cross_over(
    scene: Faces, b: Buffers, face: int, key: int, stack: int, medium: int, other: int,
    beyond: int, legs: int, row: Integer, size: int,
) -> tuple[int, int]:  # fmt: skip
    """Move the rays onto the face; keep those that cross and put back the others.

    Returns how many go on, and whether along the main axis of the face.
    """
    f, g = b.stream_f, b.stream_i
    columns = _Columns(f, g, b.live_f, b.live_i, b.ray_i)
    for j in range(size - 1, -1, -1):
        if f[OUTCOME, j] == OTHER_SIDE:
            _put_back(columns, j, _Leg(face, key, stack, medium, legs, row))
            size -= 1
            _fill(f, g, j, size, number(OUTCOME))
    if b.counters[COUNTING] == 0:
        _record(scene, b, face, medium, other, size)
    else:
        # Its last record stands for all of a ray's way through the lens
        b.counters[LEFT_OUT] += size
    # Let the rays stand on the face
    for k in range(3):
        for j in range(size):
            f[k, j] = f[POINT + k, j]
    for k in range(3):
        for j in range(size):
            f[3 + k, j] = f[AFTER + k, j]
    for j in range(size):
        drawn = np.uint64(g[STREAM_RNG, j])
        g[STREAM_RNG, j] = np.int64(drawn if f[OUTCOME, j] == TOTAL else advance(drawn))
    # Keep those on the other side that go the same way
    axis = 3 + scene.face_i[face, F_AXIS]
    sense = 0
    for j in range(size):
        if f[OUTCOME, j] == CROSSES:
            sense = 1 if f[axis, j] >= 0.0 else 0
            break
    for j in range(size - 1, -1, -1):
        along = 1 if f[axis, j] >= 0.0 else 0
        crosses = f[OUTCOME, j] == CROSSES
        if not crosses or along != sense:
            leg = _Leg(
                face, 2 * face + along, beyond if crosses else stack, other if crosses else medium,
                legs + 1, row,
            )  # fmt: skip
            _put_back(columns, j, leg)
            size -= 1
            _fill(f, g, j, size, number(5))
    return size, sense


@inner_kernel
def _record(
    scene: Faces, b: Buffers, face: int, medium: int, other: int, size: int
) -> None:  # fmt: skip
    """Write a record for every ray of a stream."""
    f, g, exact, columns = b.stream_f, b.stream_i, b.exact, RecordColumns(b.words, b.real, b.owners)
    obj, triangle = scene.face_i[face, F_OBJECT], scene.face_i[face, F_TRIANGLE]
    mark = scene.face_i[face, F_EVENT]
    crossed = mark | _REFRACTED | (_MEDIUM_CHANGED if other != medium else 0)
    for j in range(size):
        g[_PACKED, j] = (whole(f[NORMAL, j]) & 0xFFFF) | (whole(f[NORMAL + 1, j]) << 16)
    for j in range(size):
        g[_PACKED + 1, j] = whole(f[NORMAL + 2, j]) & 0xFFFF
    r = b.counters[RECORDS]
    for j in range(size):
        outcome = f[OUTCOME, j]
        event, inside = crossed, other
        if outcome != CROSSES:
            event, inside = mark | (_REFLECTED if outcome == TURNS else _TIR), medium
        write_words(
            columns, r + j, f[POINT, j], f[POINT + 1, j], f[POINT + 2, j],
            g[_PACKED, j], g[_PACKED + 1, j] | obj << 16, triangle, event, inside,
            g[STREAM_CODE, j], g[_RAY, j],
        )  # fmt: skip
    if len(exact) > 0:
        for j in range(size):
            for k in range(3):
                exact[r + j, k] = f[POINT + k, j]
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
    decided: I32, columns: _Columns, leg: _Leg, listed: int, index: int, size: int
) -> int:
    """Keep the rays whose hit on the face is decided, put back the others."""
    f, g, face = columns.f, columns.g, leg.face
    leaving = face + decided.shape[1] // 2
    near, far = decided[listed, face] <= index, decided[listed, leaving] <= index
    for j in range(size - 1, -1, -1):
        hit = g[BUNDLE_CODE + leg.row, j]
        if not ((hit == face and near) or (hit == leaving and far)):
            _put_back(columns, j, leg)
            size -= 1
            _fill(f, g, j, size, number(DISTANCE + 1))
    return size


@inner_kernel
def _put_back(columns: _Columns, j: int, leg: _Leg) -> None:
    """Bring a ray up to date that is no longer followed.

    A ray of which no record is written yet stands where it was: it is about to meet the face.
    """
    f, g, live_f, live_i = columns.f, columns.g, columns.live_f, columns.live_i
    i = unsigned(g[BUNDLE_SLOT, j])
    if leg.legs == 0:
        live_f[T, i] = f[DISTANCE + leg.row, j]
        live_i[HIT, i] = leg.face
        return
    for k in range(6):
        live_f[k, i] = f[k, j]
    live_i[OWN, i], live_i[KEY, i] = leg.key >> 1, leg.key
    live_i[STACK, i], live_i[MEDIUM, i] = leg.stack, leg.medium
    live_i[RNG, i], live_i[LAST, i] = g[STREAM_RNG, j], g[_LAST, j]
    live_i[HIT, i] = DONE
    columns.ray_i[N_RECORDS, unsigned(g[_RAY, j])] += leg.legs
