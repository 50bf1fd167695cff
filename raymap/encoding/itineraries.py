"""Compiled passes over the itineraries of rays: faces, primitives, rebuilding of columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.pathstreams import offsets_from_counts
from raymap.jit.kernels import lean_kernel
from raymap.model.errors import FormatError

__all__ = ["PathRuns", "assign_faces", "face_triangles"]


@dataclass(frozen=True, slots=True, eq=False)
class PathRuns:
    """Rays that repeat the rows of their paths; `check` alone makes them.

    Attributes
    ----------
    path_offsets : (n_paths + 1,) rows of each path
    numbers : (n_rays,) path of each ray
    offsets : (n_rays + 1,) rows of each ray, as many as its path has
    """

    path_offsets: NDArray[np.int64]
    numbers: NDArray[np.uint32]
    offsets: NDArray[np.int64]

    @staticmethod
    def check(
        path_offsets: NDArray[np.int64], numbers: NDArray[np.uint32], total: int, what: str
    ) -> PathRuns:
        """Rays that compiled loops may walk along.

        Parameters
        ----------
        total : rows of all rays
        what : these rows are, for messages

        Raises
        ------
        FormatError
            A ray takes a path that there is not, or the rows of the rays are another number.
        """
        lengths = np.diff(path_offsets)
        if path_offsets[0] != 0 or (len(lengths) and int(lengths.min()) < 0):
            raise FormatError("paths do not follow one another")
        if len(numbers) and not 0 <= int(numbers.min()) <= int(numbers.max()) < len(lengths):
            raise FormatError("a ray's path is not in the dictionary")
        return PathRuns(path_offsets, numbers, offsets_from_counts(lengths[numbers], total, what))

    def expand(self, column: NDArray[Any]) -> NDArray[Any]:
        """Give each row of a ray the value that the row of its path has.

        Raises
        ------
        FormatError
            The column does not have a value for each row of the paths.
        """
        if len(column) != self.path_offsets[-1]:
            raise FormatError(f"{len(column)} values of {self.path_offsets[-1]} points of paths")
        out = np.empty(int(self.offsets[-1]), column.dtype)
        _expand_points(self.numbers, self.path_offsets, self.offsets, column, out)
        return out


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
def _expand_points(
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

    False where there is no such face, an explicit value is not in it, or there are too few or too
    many.
    """
    used = 0
    for i in range(faces.size):
        face = faces[i]
        triangle = -1
        if face >= primitive_count.size:
            return False
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
