"""Compiled passes over the itineraries of rays: faces, hashes, grouping, rebuilding of columns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import kernel

__all__ = [
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
    "point_rows",
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
        face = -1
        if item < 0:
            if item != -1 or triangle != -1:
                return i
        elif item >= n_objects or triangle < -1:
            return i
        elif triangle >= 0:
            # Find the last face of the object that starts at or before the primitive
            low = first_face[item]
            high = first_face[item + 1]
            if low < high:
                while high - low > 1:
                    middle = (low + high) >> 1
                    if first_primitive[middle] <= triangle:
                        low = middle
                    else:
                        high = middle
                if triangle - first_primitive[low] >= primitive_count[low]:
                    return i
                face = low
        faces[i] = face
    return -1


@kernel
def hash_rays(
    source: NDArray[np.int16],
    offsets: NDArray[np.int64],
    objects: NDArray[np.int16],
    faces: NDArray[np.int32],
    events: NDArray[np.int32],
    media: NDArray[np.int16],
    meeting_offsets: NDArray[np.int64],
    detectors: NDArray[np.int16],
    registered: NDArray[np.bool_],
    hashes: NDArray[np.uint64],
) -> None:
    """Hash of each ray's itinerary; equal itineraries have equal hashes, others hardly ever."""
    for ray in range(source.size):
        h = np.uint64(np.uint16(source[ray])) + _P1
        for i in range(offsets[ray], offsets[ray + 1]):
            low = np.uint64(np.uint16(objects[i])) | (
                np.uint64(np.uint16(media[i])) << np.uint64(16)
            )
            high = np.uint64(np.uint32(faces[i])) | (
                np.uint64(np.uint32(events[i])) << np.uint64(32)
            )
            h = _mix(h, high ^ (low * _P2))
            for k in range(meeting_offsets[i], meeting_offsets[i + 1]):
                h = _mix(
                    h,
                    (np.uint64(np.uint16(detectors[k])) << np.uint64(1))
                    | np.uint64(registered[k])
                    | np.uint64(1 << 40),
                )
        hashes[ray] = h


@kernel
def _same(
    a: int,
    n: int,
    objects_a: NDArray[np.int16],
    faces_a: NDArray[np.int32],
    events_a: NDArray[np.int32],
    media_a: NDArray[np.int16],
    meetings_a: NDArray[np.int64],
    detectors_a: NDArray[np.int16],
    registered_a: NDArray[np.bool_],
    b: int,
    objects_b: NDArray[np.int16],
    faces_b: NDArray[np.int32],
    events_b: NDArray[np.int32],
    media_b: NDArray[np.int16],
    meetings_b: NDArray[np.int64],
    detectors_b: NDArray[np.int16],
    registered_b: NDArray[np.bool_],
) -> bool:
    """Compare n points from row a of one table and from row b of another in full."""
    for k in range(n):
        i = a + k
        j = b + k
        if (
            objects_a[i] != objects_b[j]
            or faces_a[i] != faces_b[j]
            or events_a[i] != events_b[j]
            or media_a[i] != media_b[j]
        ):
            return False
        count = meetings_a[i + 1] - meetings_a[i]
        if count != meetings_b[j + 1] - meetings_b[j]:
            return False
        for m in range(count):
            p = meetings_a[i] + m
            q = meetings_b[j] + m
            if detectors_a[p] != detectors_b[q] or registered_a[p] != registered_b[q]:
                return False
    return True


@kernel
def group_rays(
    source: NDArray[np.int16],
    offsets: NDArray[np.int64],
    objects: NDArray[np.int16],
    faces: NDArray[np.int32],
    events: NDArray[np.int32],
    media: NDArray[np.int16],
    meeting_offsets: NDArray[np.int64],
    detectors: NDArray[np.int16],
    registered: NDArray[np.bool_],
    hashes: NDArray[np.uint64],
    limit: int,
    table: NDArray[np.int32],
    group: NDArray[np.int32],
    representative: NDArray[np.int32],
    counts: NDArray[np.int64],
) -> int:
    """Number the different itineraries in order of first appearance.

    Parameters
    ----------
    limit : give up, returning -1, when there are more different itineraries
    table : (power of two > 2 limit,) filled with -1, open addressing
    group : (n_rays,) out, number of each ray's itinerary
    representative, counts : (limit,) out, first ray of each itinerary and how many rays took it
    """
    mask = np.uint64(table.size - 1)
    n_groups = 0
    for ray in range(source.size):
        h = hashes[ray]
        n = offsets[ray + 1] - offsets[ray]
        slot = (h >> np.uint64(20)) & mask
        while True:
            found = table[slot]
            if found < 0:
                if n_groups == limit:
                    return -1
                table[slot] = n_groups
                representative[n_groups] = ray
                counts[n_groups] = 1
                group[ray] = n_groups
                n_groups += 1
                break
            other = representative[found]
            if (
                hashes[other] == h
                and source[other] == source[ray]
                and offsets[other + 1] - offsets[other] == n
                and _same(
                    offsets[ray],
                    n,
                    objects,
                    faces,
                    events,
                    media,
                    meeting_offsets,
                    detectors,
                    registered,
                    offsets[other],
                    objects,
                    faces,
                    events,
                    media,
                    meeting_offsets,
                    detectors,
                    registered,
                )
            ):
                counts[found] += 1
                group[ray] = found
                break
            slot = (slot + np.uint64(1)) & mask
    return n_groups


@kernel
def merge_paths(
    source: NDArray[np.int16],
    offsets: NDArray[np.int64],
    objects: NDArray[np.int16],
    faces: NDArray[np.int32],
    events: NDArray[np.int32],
    media: NDArray[np.int16],
    meeting_offsets: NDArray[np.int64],
    detectors: NDArray[np.int16],
    registered: NDArray[np.bool_],
    hashes: NDArray[np.uint64],
    g_source: NDArray[np.int16],
    g_offsets: NDArray[np.int64],
    g_objects: NDArray[np.int16],
    g_faces: NDArray[np.int32],
    g_events: NDArray[np.int32],
    g_media: NDArray[np.int16],
    g_meeting_offsets: NDArray[np.int64],
    g_detectors: NDArray[np.int16],
    g_registered: NDArray[np.bool_],
    g_hashes: NDArray[np.uint64],
    table: NDArray[np.int32],
    n_global: int,
    local_to_global: NDArray[np.int32],
) -> int:
    """Find each local path among the global ones, append the new ones; returns how many there are.

    The global arrays have room for everything that could be appended.
    """
    mask = np.uint64(table.size - 1)
    for path in range(source.size):
        h = hashes[path]
        n = offsets[path + 1] - offsets[path]
        slot = (h >> np.uint64(20)) & mask
        while True:
            found = table[slot]
            if found < 0:
                # Append the path behind the others
                table[slot] = n_global
                g_hashes[n_global] = h
                g_source[n_global] = source[path]
                row = g_offsets[n_global]
                for i in range(offsets[path], offsets[path + 1]):
                    g_objects[row] = objects[i]
                    g_faces[row] = faces[i]
                    g_events[row] = events[i]
                    g_media[row] = media[i]
                    meeting = g_meeting_offsets[row]
                    for k in range(meeting_offsets[i], meeting_offsets[i + 1]):
                        g_detectors[meeting] = detectors[k]
                        g_registered[meeting] = registered[k]
                        meeting += 1
                    row += 1
                    g_meeting_offsets[row] = meeting
                local_to_global[path] = n_global
                n_global += 1
                g_offsets[n_global] = row
                break
            if (
                g_hashes[found] == h
                and g_source[found] == source[path]
                and g_offsets[found + 1] - g_offsets[found] == n
                and _same(
                    offsets[path],
                    n,
                    objects,
                    faces,
                    events,
                    media,
                    meeting_offsets,
                    detectors,
                    registered,
                    g_offsets[found],
                    g_objects,
                    g_faces,
                    g_events,
                    g_media,
                    g_meeting_offsets,
                    g_detectors,
                    g_registered,
                )
            ):
                local_to_global[path] = found
                break
            slot = (slot + np.uint64(1)) & mask
    return n_global


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
        start = path_offsets[path_numbers[ray]]
        target = record_offsets[ray]
        for i in range(record_offsets[ray + 1] - target):
            out[target + i] = column[start + i]


@kernel
def point_rows(
    path_numbers: NDArray[np.uint32],
    path_offsets: NDArray[np.int64],
    record_offsets: NDArray[np.int64],
    out: NDArray[np.int64],
) -> None:
    """Row of the path dictionary's points that each record belongs to."""
    for ray in range(path_numbers.size):
        start = path_offsets[path_numbers[ray]]
        target = record_offsets[ray]
        for i in range(record_offsets[ray + 1] - target):
            out[target + i] = start + i


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
            if primitive_count[face] != 1:
                explicit[n] = triangles[i] - first_primitive[face]
                n += 1
        elif objects[i] >= 0:
            explicit[n] = triangles[i]
            n += 1
    return n
