"""Which bodies a ray is in beyond a face, also where faces of several bodies coincide.

At a place where faces lie on one another light meets one interface. An open surface counts before
solids (paint on glass), a detector before other open surfaces; of solids the one of higher priority
gives name and surface, of equal ones, as of open surfaces, the one that the scene names first. The
ray leaves and enters all of them at once.
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64, I64
from tracer.compiled import B_PRIORITY, F_DETECTOR, F_INSIDE, F_KIND, F_OUTSIDE, CoincidentFaces
from tracer.geometry.kinds import ANNULUS, CONE, CONIC, CYLINDER, RECTANGLE, SPHERE
from tracer.geometry.normals import face_normal
from tracer.transport.medium_stack import enter_body, leave_body

__all__ = ["cross_face", "left_together", "any_coincident"]


@inline_kernel
def cross_face(
    coincident: CoincidentFaces | None, face_i: I64, face_f: F64, pool: F64 | None, body_i: I64,
    face: int, stack: int, cosine: float, x: float, y: float, z: float,
) -> tuple[int, int]:  # fmt: skip
    """Medium stack beyond a face hit at (x, y, z), -1 if none; the face that counts."""
    if coincident is None:
        return _cross(face_i, body_i, face, stack, cosine), face
    if coincident.first[face] == coincident.first[face + 1]:
        return _cross(face_i, body_i, face, stack, cosine), face
    return _cross_all(coincident, face_i, face_f, pool, body_i, face, stack, cosine, x, y, z)


@inline_kernel
def any_coincident(coincident: CoincidentFaces | None) -> bool:
    """Whether any faces of the scene may coincide."""
    return coincident is not None


@inline_kernel
def left_together(coincident: CoincidentFaces | None, face_i: I64, own: int, face: int) -> bool:
    """Whether an open surface lies on the one that the ray leaves: only rounding parts them.

    Solids need no such question: the ray is in none of those that it would leave again.
    """
    if coincident is None:
        return False
    if own < 0 or face_i[own, F_INSIDE] >= 0 or face_i[face, F_INSIDE] >= 0:
        return False
    for k in range(coincident.first[own], coincident.first[own + 1]):
        if coincident.face[k] == face:
            return True
    return False


@inline_kernel
def _cross(face_i: I64, body_i: I64, face: int, stack: int, cosine: float) -> int:
    inside, outside = face_i[face, F_INSIDE], face_i[face, F_OUTSIDE]
    beyond = stack
    if inside >= 0:
        if cosine < 0.0:
            if outside >= 0:
                beyond = leave_body(beyond, outside, body_i)
            if beyond >= 0:
                beyond = enter_body(beyond, inside, body_i)
        else:
            beyond = leave_body(beyond, inside, body_i)
            if beyond >= 0 and outside >= 0:
                beyond = enter_body(beyond, outside, body_i)
    return beyond


@inner_kernel
def _cross_all(
    coincident: CoincidentFaces, face_i: I64, face_f: F64, pool: F64 | None, body_i: I64, face: int,
    stack: int, cosine: float, x: float, y: float, z: float,
) -> tuple[int, int]:  # fmt: skip
    """Cross a face and all that coincide with it at a place: leave bodies first, then enter."""
    first, last = coincident.first[face], coincident.first[face + 1]
    counting, beyond = face, stack
    nx, ny, nz = face_normal(face_i[face, F_KIND], face_f, face, pool, x, y, z)
    for entering in range(2):
        for k in range(first - 1, last):
            other = face if k < first else int(coincident.face[k])
            turned = cosine
            if k >= first:
                if not _covers(face_i, face_f, pool, other, x, y, z):
                    continue
                ox, oy, oz = face_normal(face_i[other, F_KIND], face_f, other, pool, x, y, z)
                turned = cosine if nx * ox + ny * oy + nz * oz > 0.0 else -cosine
            if (turned < 0.0) != (entering == 1):
                continue
            if _counts_before(face_i, body_i, other, counting):
                counting = other
            went = _cross(face_i, body_i, other, beyond, turned)
            if went >= 0:
                beyond = went
            elif k < first:
                return -1, face
    return beyond, counting


@inner_kernel
def _counts_before(face_i: I64, body_i: I64, a: int, b: int) -> bool:
    one, two = face_i[a, F_INSIDE], face_i[b, F_INSIDE]
    if one < 0 or two < 0:
        if one != two:
            return bool(one < two)
        seen = face_i[a, F_DETECTOR] >= 0
        return seen if seen != (face_i[b, F_DETECTOR] >= 0) else a < b
    if body_i[one, B_PRIORITY] != body_i[two, B_PRIORITY]:
        return bool(body_i[one, B_PRIORITY] > body_i[two, B_PRIORITY])
    return a < b


@inner_kernel
def _covers(
    face_i: I64, face_f: F64, pool: F64 | None, face: int, x: float, y: float, z: float
) -> bool:
    """Whether a place on the surface that a face is part of lies on the face."""
    s = face_f[face]
    px, py, pz = x - s[0], y - s[1], z - s[2]
    kind = face_i[face, F_KIND]
    if kind >= SPHERE:
        height = px * s[3] + py * s[4] + pz * s[5]
        if kind == SPHERE:
            return bool(height <= s[7])
        if kind == CYLINDER:
            return bool(s[7] <= height <= s[8])
        if kind == CONE:
            return bool(s[8] <= height <= s[9])
        across = px * px + py * py + pz * pz - height * height
        if kind == CONIC and (across < s[10] or s[6] * s[7] * height >= 1.0):
            return False
        return bool(across <= s[8])
    if kind == RECTANGLE:
        u = abs(px * s[6] + py * s[7] + pz * s[8])
        v = abs(px * s[9] + py * s[10] + pz * s[11])
        return bool(u <= s[12] and v <= s[13])
    if kind == ANNULUS:
        square = px * px + py * py + pz * pz
        return bool(s[6] <= square <= s[7])
    return _in_polygon(pool, s, x, y, z)


@inline_kernel
def _in_polygon(pool: F64 | None, s: F64, x: float, y: float, z: float) -> bool:
    if pool is None:
        return False
    first = np.int64(s[6])
    for k in range(4 * first, 4 * (first + np.int64(s[7])), 4):
        if pool[k] * x + pool[k + 1] * y + pool[k + 2] * z > pool[k + 3]:
            return False
    return True
