"""Compiled passes over the itineraries of rays: faces, hashes, grouping, rebuilding of columns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import kernel

__all__ = [
    "Itineraries",
    "assign_faces",
    "expand_points",
    "explicit_triangles",
    "face_triangles",
    "fill_table",
    "gather_meetings",
    "gather_points",
    "group_rays",
    "hash_rays",
    "merge_paths",
    "sum_colors",
    "sum_weighted_colors",
]

_P1 = np.uint64(0x9E3779B97F4A7C15)
_P2 = np.uint64(0xC2B2AE3D27D4EB4F)


@kernel
def _mix(h: np.uint64, key: np.uint64) -> np.uint64:
    h = (h ^ (key * _P1)) * _P2
    return h ^ (h >> np.uint64(29))


@kernel
def assign_faces(
    objects: NDArray[np.int16],
    triangles: NDArray[np.int32],
    first_face: NDArray[np.int32],
    first_primitive: NDArray[np.int32],
    primitive_count: NDArray[np.int32],
    faces: NDArray[np.int32],
) -> int:
    """Face index of each record, -1 without one; returns the first contradictory record or -1."""
    n_objects = first_face.size - 1
    for i in range(objects.size):
        item = objects[i]
        triangle = triangles[i]
        face = np.int32(-1)
        if item < 0:
            if item != -1 or triangle != -1:
                return i
        elif item >= n_objects or triangle < -1:
            return i
        elif triangle >= 0:
            # Find the last face of the object that starts at or before the primitive
            low = first_face[np.uint16(item)]
            high = first_face[np.uint32(item) + np.uint32(1)]
            if low < high:
                while high - low > 1:
                    middle = np.int32((low + high) >> 1)
                    if first_primitive[np.uint32(middle)] <= triangle:
                        low = middle
                    else:
                        high = middle
                at = np.uint32(low)
                if triangle - first_primitive[at] >= primitive_count[at]:
                    return i
                face = low
        faces[i] = face
    return -1


class Itineraries(NamedTuple):
    """The columns of which paths are made, ray after ray or path after path.

    Attributes
    ----------
    source : (n,) int16
    offsets : (n + 1,) int64, points of ray (or path) i are rows offsets[i]:offsets[i + 1]
    object, face, event, medium : (n_points,)
    meeting_offsets : (n_points + 1,) int64
    detector, registered : (n_meetings,)
    """

    source: NDArray[np.int16]
    offsets: NDArray[np.int64]
    object: NDArray[np.int16]
    face: NDArray[np.int32]
    event: NDArray[np.int32]
    medium: NDArray[np.int16]
    meeting_offsets: NDArray[np.int64]
    detector: NDArray[np.int16]
    registered: NDArray[np.bool_]


@kernel
def hash_rays(rays: Itineraries, hashes: NDArray[np.uint64]) -> None:
    """Hash of each ray's itinerary; equal itineraries have equal hashes, others hardly ever."""
    for ray in range(rays.source.size):
        h = np.uint64(np.uint16(rays.source[ray])) + _P1
        meeting = rays.meeting_offsets[np.uint64(rays.offsets[ray])]
        for place in range(rays.offsets[ray], rays.offsets[ray + 1]):
            i = np.uint64(place)
            low = np.uint64(np.uint16(rays.object[i])) | (
                np.uint64(np.uint16(rays.medium[i])) << np.uint64(16)
            )
            high = np.uint64(np.uint32(rays.face[i])) | (
                np.uint64(np.uint32(rays.event[i])) << np.uint64(32)
            )
            h = _mix(h, high ^ (low * _P2))
            end = rays.meeting_offsets[i + np.uint64(1)]
            while meeting < end:
                k = np.uint64(meeting)
                detector = np.uint64(np.uint16(rays.detector[k])) << np.uint64(1)
                h = _mix(h, detector | np.uint64(rays.registered[k]) | np.uint64(1 << 40))
                meeting += 1
        hashes[ray] = h


@kernel
def _same(a: Itineraries, ray_a: int | np.integer, b: Itineraries, ray_b: int | np.integer) -> bool:
    """Compare two itineraries in full."""
    one = np.uint64(1)
    at_a, at_b = np.uint64(ray_a), np.uint64(ray_b)
    n = a.offsets[at_a + one] - a.offsets[at_a]
    if b.offsets[at_b + one] - b.offsets[at_b] != n or a.source[at_a] != b.source[at_b]:
        return False
    first_a, first_b = np.uint64(a.offsets[at_a]), np.uint64(b.offsets[at_b])
    end_a, end_b = a.meeting_offsets[first_a], b.meeting_offsets[first_b]
    # Compare all points without a branch, then the few meetings
    different = np.int64(0)
    shift = end_b - end_a
    for k in range(n):
        i = first_a + np.uint64(k)
        j = first_b + np.uint64(k)
        different |= (
            (a.object[i] ^ b.object[j])
            | (a.face[i] ^ b.face[j])
            | (a.event[i] ^ b.event[j])
            | (a.medium[i] ^ b.medium[j])
            | (a.meeting_offsets[i + one] + shift - b.meeting_offsets[j + one])
        )
    if different != 0:
        return False
    for m in range(a.meeting_offsets[first_a + np.uint64(n)] - end_a):
        p, q = np.uint64(end_a + m), np.uint64(end_b + m)
        if a.detector[p] != b.detector[q] or a.registered[p] != b.registered[q]:
            return False
    return True


@kernel
def group_rays(
    rays: Itineraries,
    hashes: NDArray[np.uint64],
    table: NDArray[np.int32],
    group: NDArray[np.int32],
    representative: NDArray[np.int32],
    counts: NDArray[np.int64],
) -> int:
    """Number the different itineraries in order of first appearance.

    Parameters
    ----------
    table : (power of two,) filled with -1, open addressing, longer than ``representative``
    group : (n_rays,) out, number of each ray's itinerary
    representative, counts : (limit,) out, first ray of each itinerary and how many rays took it

    Returns
    -------
    n : how many different itineraries, -1 if they are more than the limit
    """
    mask = np.uint64(table.size - 1)
    n_groups = 0
    for ray in range(rays.source.size):
        h = hashes[ray]
        slot = (h >> np.uint64(20)) & mask
        while True:
            found = table[slot]
            if found < 0:
                if n_groups == representative.size:
                    return -1
                table[slot] = n_groups
                representative[n_groups] = ray
                counts[n_groups] = 1
                group[ray] = n_groups
                n_groups += 1
                break
            other = np.uint32(representative[np.uint32(found)])
            if hashes[other] == h and _same(rays, ray, rays, other):
                counts[np.uint32(found)] += 1
                group[ray] = found
                break
            slot = (slot + np.uint64(1)) & mask
    return n_groups


@kernel
def merge_paths(
    paths: Itineraries,
    hashes: NDArray[np.uint64],
    merged: Itineraries,
    merged_hashes: NDArray[np.uint64],
    table: NDArray[np.int32],
    n_merged: int,
    numbers: NDArray[np.int32],
) -> int:
    """Find each path among the merged ones, append the new ones; returns how many there are then.

    The arrays of ``merged`` have room for everything that could be appended.
    """
    mask = np.uint64(table.size - 1)
    for path in range(paths.source.size):
        h = hashes[path]
        slot = (h >> np.uint64(20)) & mask
        while True:
            found = table[slot]
            if found < 0:
                table[slot] = n_merged
                merged_hashes[n_merged] = h
                _append_path(paths, path, merged, n_merged)
                numbers[path] = n_merged
                n_merged += 1
                break
            if merged_hashes[found] == h and _same(paths, path, merged, found):
                numbers[path] = found
                break
            slot = (slot + np.uint64(1)) & mask
    return n_merged


@kernel
def _append_path(paths: Itineraries, path: int, merged: Itineraries, place: int) -> None:
    merged.source[place] = paths.source[path]
    row = merged.offsets[place]
    for i in range(paths.offsets[path], paths.offsets[path + 1]):
        merged.object[row] = paths.object[i]
        merged.face[row] = paths.face[i]
        merged.event[row] = paths.event[i]
        merged.medium[row] = paths.medium[i]
        meeting = merged.meeting_offsets[row]
        for k in range(paths.meeting_offsets[i], paths.meeting_offsets[i + 1]):
            merged.detector[meeting] = paths.detector[k]
            merged.registered[meeting] = paths.registered[k]
            meeting += 1
        row += 1
        merged.meeting_offsets[row] = meeting
    merged.offsets[place + 1] = row


@kernel
def gather_points(
    rays: NDArray[np.int32],
    offsets: NDArray[np.int64],
    new_offsets: NDArray[np.int64],
    column: NDArray[Any],
    out: NDArray[Any],
) -> None:
    """Copy the rows of the given rays, one after the other."""
    for k in range(rays.size):
        start = offsets[rays[k]]
        target = new_offsets[k]
        for i in range(new_offsets[k + 1] - target):
            out[target + i] = column[start + i]


@kernel
def gather_meetings(
    rays: NDArray[np.int32],
    offsets: NDArray[np.int64],
    meeting_offsets: NDArray[np.int64],
    new_meeting_offsets: NDArray[np.int64],
    new_offsets: NDArray[np.int64],
    detectors: NDArray[np.int16],
    registered: NDArray[np.bool_],
    new_detectors: NDArray[np.int16],
    new_registered: NDArray[np.bool_],
) -> None:
    """Copy the meetings of the given rays, one after the other."""
    for k in range(rays.size):
        start = meeting_offsets[offsets[rays[k]]]
        target = new_meeting_offsets[new_offsets[k]]
        for i in range(new_meeting_offsets[new_offsets[k + 1]] - target):
            new_detectors[target + i] = detectors[start + i]
            new_registered[target + i] = registered[start + i]


@kernel
def expand_points(
    path_numbers: NDArray[np.uint32],
    path_offsets: NDArray[np.int64],
    record_offsets: NDArray[np.int64],
    column: NDArray[Any],
    out: NDArray[Any],
) -> None:
    """Give each record the value of its path's point."""
    for ray in range(path_numbers.size):
        start = np.uint64(path_offsets[path_numbers[ray]])
        target = np.uint64(record_offsets[ray])
        for k in range(record_offsets[ray + 1] - record_offsets[ray]):
            i = np.uint64(k)
            out[target + i] = column[start + i]


@kernel
def face_triangles(
    faces: NDArray[np.int32],
    first_primitive: NDArray[np.int32],
    primitive_count: NDArray[np.int32],
    objects: NDArray[np.int16],
    explicit: NDArray[np.int32],
    triangles: NDArray[np.int32],
) -> bool:
    """Rebuild primitives: implied where the face has one, else face start + next explicit value.

    False where an explicit value is not in its face, or there are too few or too many.
    """
    used = 0
    for i in range(faces.size):
        face = faces[i]
        triangle = -1
        if face >= 0:
            triangle = first_primitive[face]
            if primitive_count[face] != 1:
                if used == explicit.size or not 0 <= explicit[used] < primitive_count[face]:
                    return False
                triangle += explicit[used]
                used += 1
        elif objects[i] >= 0:
            if used == explicit.size or explicit[used] < -1:
                return False
            triangle = explicit[used]
            used += 1
        triangles[i] = triangle
    return used == explicit.size


@kernel
def fill_table(table: NDArray[np.int32], hashes: NDArray[np.uint64]) -> None:
    """Enter all hashes into an empty table."""
    mask = np.uint64(table.size - 1)
    for path in range(hashes.size):
        slot = (hashes[path] >> np.uint64(20)) & mask
        while table[slot] >= 0:
            slot = (slot + np.uint64(1)) & mask
        table[slot] = path


@kernel
def sum_colors(
    codes: NDArray[np.int32],
    color_table: NDArray[np.uint16],
    numbers: NDArray[np.uint32],
    sums: NDArray[np.uint64],
) -> None:
    """Add each ray's colour to its path, in units of 1/65535."""
    n_channels = sums.shape[1]
    for ray in range(codes.size):
        code = codes[ray]
        path = numbers[ray]
        if code < n_channels:
            sums[path, code] += np.uint64(65535)
        else:
            for channel in range(n_channels):
                sums[path, channel] += np.uint64(color_table[code - n_channels, channel])


@kernel
def sum_weighted_colors(
    codes: NDArray[np.int32],
    color_table: NDArray[np.uint16],
    numbers: NDArray[np.uint32],
    weight: NDArray[np.float32],
    scale: float,
    sums: NDArray[np.float64],
) -> None:
    """Add each ray's weight x colour to its path."""
    n_channels = sums.shape[1]
    for ray in range(codes.size):
        code = codes[ray]
        path = numbers[ray]
        w = np.float64(weight[ray])
        if code < n_channels:
            sums[path, code] += w
        else:
            for channel in range(n_channels):
                sums[path, channel] += w * (scale * color_table[code - n_channels, channel])


@kernel
def explicit_triangles(
    faces: NDArray[np.int32],
    first_primitive: NDArray[np.int32],
    primitive_count: NDArray[np.int32],
    objects: NDArray[np.int16],
    triangles: NDArray[np.int32],
    explicit: NDArray[np.int32],
) -> int:
    """Collect the primitives that the faces do not imply, counted from the start of the face."""
    n = 0
    for i in range(faces.size):
        face = faces[i]
        if face >= 0:
            at = np.uint32(face)
            if primitive_count[at] != 1:
                explicit[np.uint64(n)] = triangles[i] - first_primitive[at]
                n += 1
        elif objects[i] >= 0:
            explicit[np.uint64(n)] = triangles[i]
            n += 1
    return n
