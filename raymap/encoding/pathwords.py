"""Itineraries packed into 64-bit words: equal itineraries are equal runs of words.

::

    source | records << 16                                                    once
    object | medium << 16 | face << 32,   event | crossings << 32              per record
    detector | registered << 16                                               per crossing

One pass over the records of a portion packs, hashes and numbers its rays: the words of a ray are
written behind those of the paths known so far and stay there if they are new.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, inner_kernel, lean_kernel
from raymap.model.directory import FaceTable

__all__ = [
    "FaceColumns",
    "PathWords",
    "RayColumns",
    "enter_hashes",
    "face_columns",
    "name_faces",
    "number_rays",
    "words_needed",
    "write_paths",
]

_P1 = np.uint64(0x9E3779B97F4A7C15)
_P2 = np.uint64(0xC2B2AE3D27D4EB4F)
_P3 = np.uint64(0xD6E8FEB86659FD93)
_S16, _S20, _S29, _S32 = np.uint64(16), np.uint64(20), np.uint64(29), np.uint64(32)
_ONE = np.uint64(1)
_MOST = 65_536
_MOST_TOGETHER = 2**24
"""Primitives of an object, and of all objects, up to which each has a code of its own."""
_FOREIGN = -(2**31)


class RayColumns(NamedTuple):
    """Columns of rays (or of paths), contiguous.

    Attributes
    ----------
    source, counts : (n,) and the records of each
    object, primitive, event, medium, crossings : (n_records,)
    detector, registered : (n_crossings,)
    """

    source: NDArray[np.int16]
    counts: NDArray[np.int32]
    object: NDArray[np.int16]
    primitive: NDArray[np.int32]
    event: NDArray[np.int32]
    medium: NDArray[np.int16]
    crossings: NDArray[np.uint16]
    detector: NDArray[np.int16]
    registered: NDArray[np.uint8]


class FaceColumns(NamedTuple):
    """Which face each primitive belongs to.

    Attributes
    ----------
    begin : (n_objects + 2,) where the primitives of each object stand in ``codes``, beginning with
        no primitive (-1); the first row is that of no object. Empty: primitives are faces already
    codes : per primitive 2 face + 1 where the face does not imply the primitive, else 2 face
    first_face, first_primitive, primitive_count : as in `raymap.model.directory.FaceTable`; objects
    of
        very many primitives, or of any number, are searched there and have no ``codes``
    """

    begin: NDArray[np.int32]
    codes: NDArray[np.int32]
    first_face: NDArray[np.int32]
    first_primitive: NDArray[np.int32]
    primitive_count: NDArray[np.int32]


class PathWords(NamedTuple):
    """Different paths as words, with room for more.

    Attributes
    ----------
    words : path p is ``words[starts[p]:starts[p + 1]]``
    starts, hashes : per path
    table : (power of two,) numbers of paths by hash, -1 free; at least twice as long as the paths
    """

    words: NDArray[np.uint64]
    starts: NDArray[np.int64]
    hashes: NDArray[np.uint64]
    table: NDArray[np.int32]


def face_columns(faces: FaceTable) -> FaceColumns:
    """The faces of a directory, for `number_rays`."""
    objects = np.diff(faces.first_face)
    counts = faces.primitive_count.astype(np.int64)
    ends = np.concatenate(([0], np.cumsum(counts)))
    totals = np.diff(ends[faces.first_face])
    # Number the primitives of small objects one by one, as long as there are not too many
    listed = (totals > 0) & (totals <= _MOST)
    listed &= np.cumsum(np.where(listed, totals + 1, 0)) <= _MOST_TOGETHER
    begin = np.concatenate(([0, 1], 1 + np.cumsum(np.where(listed, totals + 1, 0))))
    codes = np.full(begin[-1], -1, np.int32)
    codes[0] = -2
    numbers = np.flatnonzero(np.repeat(listed, objects))
    owner = np.repeat(np.arange(len(objects)), objects)[numbers]
    first = begin[1:-1][owner] + 1 + ends[numbers] - ends[faces.first_face[owner]]
    places = np.repeat(first - _starts(counts[numbers]), counts[numbers])
    codes[places + np.arange(len(places))] = np.repeat(
        2 * numbers + (counts[numbers] != 1), counts[numbers]
    )
    return FaceColumns(
        begin.astype(np.int32),
        codes,
        faces.first_face,
        faces.first_primitive,
        faces.primitive_count,
    )


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sum of the counts before each."""
    return np.cumsum(counts) - counts


def words_needed(n_rays: int, n_records: int, n_crossings: int) -> int:
    """Words that so many rays have at most."""
    return n_rays + 2 * n_records + n_crossings


@inner_kernel
def _face_code(faces: FaceColumns, item: np.uint64, primitive: np.int32) -> np.int32:
    """Code of a primitive of an object without codes."""
    low = faces.first_face[item]
    high = faces.first_face[item + _ONE]
    if primitive < -1:
        return np.int32(_FOREIGN)
    if low == high or primitive < 0:
        return np.int32(-1)
    # Find the last face that starts at or before the primitive
    while high - low > 1:
        middle = np.int32((low + high) >> 1)
        if faces.first_primitive[np.uint32(middle)] <= primitive:
            low = middle
        else:
            high = middle
    room = faces.primitive_count[np.uint32(low)]
    if primitive - faces.first_primitive[np.uint32(low)] >= room:
        return np.int32(_FOREIGN)
    return np.int32(2 * low + (room != 1))


@inline_kernel
def _code_of(faces: FaceColumns, item: np.int64, primitive: np.int32) -> np.int32:
    """Code of a primitive of an object, of foreign ones a number of its own."""
    row = np.uint64(item + 1)
    if row > np.uint64(faces.first_face.size - 1):
        return np.int32(_FOREIGN)
    first = faces.begin[row]
    size = faces.begin[row + _ONE] - first
    index = np.uint32(primitive + 1)
    if index < np.uint32(size):
        return np.int32(faces.codes[np.uint32(first) + index])
    if size == 0:
        return _face_code(faces, row - _ONE, primitive)
    return np.int32(_FOREIGN)


@lean_kernel
def name_faces(
    objects: NDArray[np.int16],
    primitives: NDArray[np.int32],
    faces: FaceColumns,
    named: NDArray[np.int32],
    explicit: NDArray[np.int32],
    found: NDArray[np.int64],
) -> None:
    """Face of each record, -1 without one, and the primitives that the faces do not imply.

    Parameters
    ----------
    faces : of the directory
    named : (n_records,) out; explicit : out, counted from the start of the face
    found : (3,) out: 0; explicit primitives; first record that names an object or a primitive that
        is none, or -1
    """
    n_explicit = np.uint64(0)
    found[0], found[2] = 0, -1
    for record in range(objects.size):
        primitive = primitives[record]
        code = _code_of(faces, np.int64(objects[record]), primitive)
        if code == _FOREIGN:
            found[2] = record
            return
        face = code >> 1
        named[record] = face
        if code & 1:
            start = faces.first_primitive[np.uint32(face)] if face >= 0 else np.int32(0)
            explicit[n_explicit] = primitive - start
            n_explicit += _ONE
    found[1] = n_explicit


@lean_kernel
def number_rays(
    rays: RayColumns,
    faces: FaceColumns,
    paths: PathWords,
    n_paths: int,
    limit: int,
    spread: np.uint64,
    numbers: NDArray[np.uint32],
    explicit: NDArray[np.int32],
    found: NDArray[np.int64],
) -> None:
    """Number the itineraries of rays, the new ones on from ``n_paths`` as they turn up.

    Parameters
    ----------
    faces : of the directory
    limit : stop where there are more paths
    spread : odd factor of hashes; 0 makes all equal
    numbers : (n_rays,) out
    explicit : out, primitives that the faces do not imply, counted from the start of the face
    found : (3,) out: paths, -1 for more than the limit; explicit primitives; first record that
        names an object or a primitive that is none, or -1
    """
    words, starts, hashes, table = paths.words, paths.starts, paths.hashes, paths.table
    mask = np.uint64(table.size - 1)
    given = faces.begin.size == 0
    begin = np.uint64(starts[n_paths])
    record, crossing, n_explicit = np.uint64(0), np.uint64(0), np.uint64(0)
    found[2] = -1
    for ray in range(rays.source.size):
        # Pack the points behind the paths known so far
        count = rays.counts[ray]
        end = begin
        h = np.uint64(np.uint16(rays.source[ray])) | (np.uint64(count) << _S16)
        words[end] = h
        end += _ONE
        met = 0
        for _ in range(count):
            item = np.int64(rays.object[record])
            primitive = rays.primitive[record]
            face = primitive
            if not given:
                code = _code_of(faces, item, primitive)
                if code == _FOREIGN:
                    found[2] = record
                    return
                face = code >> 1
                if code & 1:
                    start = faces.first_primitive[np.uint32(face)] if face >= 0 else np.int32(0)
                    explicit[n_explicit] = primitive - start
                    n_explicit += _ONE
            crossings = rays.crossings[record]
            met += crossings
            a = (
                np.uint64(np.uint16(item))
                | (np.uint64(np.uint16(rays.medium[record])) << _S16)
                | (np.uint64(np.uint32(face)) << _S32)
            )
            b = np.uint64(np.uint32(rays.event[record])) | (np.uint64(crossings) << _S32)
            words[end] = a
            words[end + _ONE] = b
            end += _ONE + _ONE
            h = h * _P3 + ((a * _P1) ^ (b * _P2))
            record += _ONE
        for _ in range(met):
            word = np.uint64(np.uint16(rays.detector[crossing])) | (
                np.uint64(rays.registered[crossing]) << _S16
            )
            words[end] = word
            end += _ONE
            h = h * _P3 + word * _P1
            crossing += _ONE
        h = (h ^ (h >> _S32)) * _P1
        h = (h ^ (h >> _S29)) * spread
        # Look the words up; the hash only finds candidates
        slot = (h >> _S20) & mask
        while True:
            known = table[slot]
            if known < 0:
                if n_paths == limit:
                    found[0] = -1
                    return
                table[slot] = n_paths
                hashes[n_paths] = h
                numbers[ray] = n_paths
                n_paths += 1
                starts[n_paths] = end
                begin = end
                break
            other = np.uint64(starts[known])
            if hashes[known] == h and np.uint64(starts[known + 1]) - other == end - begin:
                different = np.uint64(0)
                for k in range(end - begin):
                    different |= words[other + np.uint64(k)] ^ words[begin + np.uint64(k)]
                if different == 0:
                    numbers[ray] = known
                    break
            slot = (slot + _ONE) & mask
    found[0] = n_paths
    found[1] = n_explicit


@lean_kernel
def enter_hashes(table: NDArray[np.int32], hashes: NDArray[np.uint64]) -> None:
    """Enter the hashes of all paths into an empty table."""
    mask = np.uint64(table.size - 1)
    for path in range(hashes.size):
        slot = (hashes[path] >> _S20) & mask
        while table[slot] >= 0:
            slot = (slot + _ONE) & mask
        table[slot] = path


@lean_kernel
def write_paths(
    order: NDArray[np.int64],
    paths: PathWords,
    offsets: NDArray[np.int64],
    columns: RayColumns,
) -> None:
    """Unpack the paths of the given numbers, one after the other.

    Parameters
    ----------
    offsets : (n + 1,) their points
    columns : out; the primitives are faces
    """
    words = paths.words
    crossing = 0
    for k in range(order.size):
        at = np.uint64(paths.starts[order[k]])
        columns.source[k] = np.int16(words[at])
        columns.counts[k] = offsets[k + 1] - offsets[k]
        at += _ONE
        first = crossing
        for i in range(offsets[k], offsets[k + 1]):
            a, b = words[at], words[at + _ONE]
            at += _ONE + _ONE
            columns.object[i] = np.int16(a)
            columns.medium[i] = np.int16(a >> _S16)
            columns.primitive[i] = np.int32(a >> _S32)
            columns.event[i] = np.int32(b)
            columns.crossings[i] = b >> _S32
            crossing += np.int64(b >> _S32)  # type: ignore[assignment]
        for m in range(first, crossing):
            columns.detector[m] = np.int16(words[at])
            columns.registered[m] = words[at] >> _S16
            at += _ONE
