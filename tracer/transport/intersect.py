"""Nearest analytic face of all live rays.

Rays are put in bundles that start from one place (a *start bin*: a face and a sense along its main
axis, a source, a medium). For each start bin the scene lists the faces that can be met, by a lower
bound of their distance; neighbours may share a list. A bundle goes down
its list and stops once every ray has met something nearer than all that follows; stragglers are
packed together so that they do not hold up the rest.
"""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inner_kernel, lean_kernel, number, unsigned
from raymap.jit.types import F64, I32, I64, Integer
from tracer.compiled import F_KIND, Faces
from tracer.geometry.nearest import DISTANCE, OWN, nearest_on_face
from tracer.transport.buffers import BUNDLE, HIT, KEY, Buffers, T
from tracer.transport.buffers import OWN as LIVE_OWN
from tracer.transport.streams import follow_decided

__all__ = ["nearest_hits"]

_SLOT = 3


@inner_kernel
def sort_by_start_bin(live_i: I64, list_of: I64, order: I64, n: int, bins: I64) -> None:
    """Order the slots of ``n`` rays by list; ``bins[k]`` becomes the end of list k."""
    for k in range(len(bins)):
        bins[k] = 0
    for i in range(n):
        bins[unsigned(list_of[unsigned(live_i[KEY, i])] + 1)] += 1
    for k in range(1, len(bins)):
        bins[k] += bins[k - 1]
    for i in range(n):
        key = unsigned(list_of[unsigned(live_i[KEY, i])])
        index = bins[key]
        order[unsigned(index)] = i
        bins[key] = index + 1


@lean_kernel
def nearest_hits(scene: Faces, b: Buffers, n: int, refract: bool) -> None:
    """Set distance and face met next of ``n`` rays (inf and -1 where nothing is met).

    With ``refract`` rays that meet a plain lens face are dealt with at once.
    """
    live_f, live_i, bundle_f, bundle_i, bins = b.live_f, b.live_i, b.bundle_f, b.bundle_i, b.bins
    face_i, face_f, pool = scene.face_i, scene.face_f, scene.pool
    first, face, distance = scene.first, scene.face, scene.distance
    decided, decides, n_faces = scene.decided, scene.decides, len(scene.face_i)
    sort_by_start_bin(live_i, scene.list_of, b.order, n, bins)
    start = number(0)
    for listed in range(len(bins) - 1):
        stop = bins[listed]
        while start < stop:
            m = min(BUNDLE, stop - start)
            _gather(live_f, live_i, b.order, start, m, bundle_f, bundle_i)
            start += m
            # Go down the list of candidates
            row = np.int64(0)
            reached = 0.0
            for c in range(first[listed], first[listed + 1]):
                bound = distance[c]
                if bound > reached:
                    reached = bound
                    waiting = _count_beyond(bundle_f, row, bound, m)
                    if waiting == 0:
                        break
                    if 4 * waiting <= m:
                        m = _keep_beyond(live_f, live_i, bundle_f, bundle_i, row, bound, n_faces, m)
                f = face[c]
                nearest_on_face(face_i[f, F_KIND], face_f, f, pool, bundle_f, bundle_i, row, m)
                row = 1 - row
                if decides[c] != 0:
                    if refract and scene.plain[f] != 0:
                        m = follow_decided(scene, b, row, listed, c - first[listed], f, m)
                    else:
                        m = _keep_undecided(
                            live_f, live_i, bundle_f, bundle_i, row, decided, listed,
                            c - first[listed], n_faces, m,
                        )  # fmt: skip
                    if m == 0:
                        break
            for j in range(m):
                i = unsigned(bundle_i[_SLOT, j])
                live_f[T, i] = bundle_f[DISTANCE + row, j]
                code = bundle_i[1 + row, j]
                live_i[HIT, i] = code if code < n_faces else code - n_faces


@inner_kernel
def _gather(
    live_f: F64, live_i: I64, order: I64, start: int, m: int, bundle_f: F64, bundle_i: I64
) -> None:
    for j in range(m):
        i = unsigned(order[unsigned(start + j)])
        bundle_i[_SLOT, j] = i
        bundle_i[OWN, j] = live_i[LIVE_OWN, i]
        bundle_i[1, j] = -1
        bundle_f[DISTANCE, j] = math.inf
        bundle_f[0, j] = live_f[0, i]
        bundle_f[1, j] = live_f[1, i]
        bundle_f[2, j] = live_f[2, i]
        bundle_f[3, j] = live_f[3, i]
        bundle_f[4, j] = live_f[4, i]
        bundle_f[5, j] = live_f[5, i]


@inner_kernel
def _count_beyond(bundle_f: F64, row: Integer, bound: float, m: int) -> int:
    count = 0
    for j in range(m):
        count += bundle_f[DISTANCE + row, j] > bound
    return count


@inner_kernel
def _keep_beyond(
    live_f: F64, live_i: I64, bundle_f: F64, bundle_i: I64, row: Integer, bound: float,
    n_faces: int, m: int,
) -> int:  # fmt: skip
    """Hand back the rays that are decided, pack the others."""
    kept = 0
    for j in range(m):
        t = bundle_f[DISTANCE + row, j]
        i = unsigned(bundle_i[_SLOT, j])
        if t > bound:
            to = unsigned(kept)
            bundle_i[_SLOT, to] = i
            bundle_i[OWN, to] = bundle_i[OWN, j]
            bundle_i[1 + row, to] = bundle_i[1 + row, j]
            bundle_f[DISTANCE + row, to] = t
            for k in range(6):
                bundle_f[k, to] = bundle_f[k, j]
            kept += 1
        else:
            live_f[T, i] = t
            code = bundle_i[1 + row, j]
            live_i[HIT, i] = code if code < n_faces else code - n_faces
    return kept


@inner_kernel
def _keep_undecided(
    live_f: F64, live_i: I64, bundle_f: F64, bundle_i: I64, row: Integer, decided: I32, listed: int,
    index: int, n_faces: int, m: int,
) -> int:  # fmt: skip
    """Hand back the rays whose hit is decided at a place of the list, pack the others."""
    kept = 0
    for j in range(m):
        code = bundle_i[1 + row, j]
        i = unsigned(bundle_i[_SLOT, j])
        if code >= 0 and decided[listed, unsigned(code)] <= index:
            live_f[T, i] = bundle_f[DISTANCE + row, j]
            live_i[HIT, i] = code if code < n_faces else code - n_faces
        else:
            to = unsigned(kept)
            bundle_i[_SLOT, to] = i
            bundle_i[OWN, to] = bundle_i[OWN, j]
            bundle_i[1 + row, to] = code
            bundle_f[DISTANCE + row, to] = bundle_f[DISTANCE + row, j]
            for k in range(6):
                bundle_f[k, to] = bundle_f[k, j]
            kept += 1
    return kept
