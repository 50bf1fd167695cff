"""Compiled passes over the itineraries of rays: faces, primitives, rebuilding of columns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel

__all__ = [
    "assign_faces",
    "expand_points",
    "face_triangles",
]


@lean_kernel
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


@lean_kernel
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


@lean_kernel
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
