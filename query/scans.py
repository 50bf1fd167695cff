"""Compiled scans over rays and their points: a handful of loops that serve every criterion.

Rays are runs of points: points of ray r are rows ``offsets[r]:offsets[r + 1]``. Nothing is compiled
per criterion; names come as tables over indices whose last entry answers for index -1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import kernel

__all__ = [
    "any_before_last",
    "any_of_ray",
    "count_of_ray",
    "expand_rows",
    "look_up",
    "mark_events",
    "match_path",
    "match_sequence",
    "number_rays",
    "ray_offsets",
]

Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]


@kernel
def look_up(table: Bools, index: Ints) -> Bools:
    """Table entry of each index; -1 is the last entry."""
    out = np.empty(len(index), np.bool_)
    last = len(table) - 1
    for i in range(len(index)):
        value = index[i]
        out[i] = table[value] if value >= 0 else table[last]
    return out


@kernel
def mark_events(event: Ints, mask: int) -> Bools:
    """Points at which any of the events of ``mask`` happened."""
    out = np.empty(len(event), np.bool_)
    for i in range(len(event)):
        out[i] = (event[i] & mask) != 0
    return out


@kernel
def any_of_ray(mask: Bools, offsets: Ints) -> Bools:
    """Whether a ray has a marked point."""
    n = len(offsets) - 1
    out = np.zeros(n, np.bool_)
    for ray in range(n):
        for row in range(offsets[ray], offsets[ray + 1]):
            if mask[row]:
                out[ray] = True
                break
    return out


@kernel
def any_before_last(mask: Bools, offsets: Ints) -> Bools:
    """Whether a ray has a marked point before its last one."""
    n = len(offsets) - 1
    out = np.zeros(n, np.bool_)
    for ray in range(n):
        for row in range(offsets[ray], offsets[ray + 1] - 1):
            if mask[row]:
                out[ray] = True
                break
    return out


@kernel
def count_of_ray(mask: Bools, offsets: Ints) -> NDArray[np.int32]:
    """How many marked points a ray has."""
    n = len(offsets) - 1
    out = np.zeros(n, np.int32)
    for ray in range(n):
        found = 0
        for row in range(offsets[ray], offsets[ray + 1]):
            found += mask[row]
        out[ray] = found
    return out


@kernel
def ray_offsets(offsets: Ints, paths: Ints) -> NDArray[np.int64]:
    """Offsets of rays that take these paths, one ray after the other."""
    out = np.zeros(len(paths) + 1, np.int64)
    for ray in range(len(paths)):
        path = paths[ray]
        out[ray + 1] = out[ray] + offsets[path + 1] - offsets[path]
    return out


@kernel
def expand_rows(starts: Ints, offsets: Ints) -> NDArray[np.int64]:
    """Rows of runs that begin at ``starts`` and are as long as the offsets say."""
    out = np.empty(offsets[len(offsets) - 1], np.int64)
    for run in range(len(starts)):
        begin = offsets[run]
        start = starts[run]
        for row in range(begin, offsets[run + 1]):
            out[row] = start + row - begin
    return out


@kernel
def number_rays(bits: NDArray[np.uint8], first: int, out: NDArray[np.int64]) -> None:
    """Numbers, from ``first``, of the rays whose bit is set; bits as `np.packbits` has them."""
    place = 0
    for byte in range(len(bits)):
        value = bits[byte]
        if value == 0:
            continue
        for bit in range(8):
            if value & (128 >> bit):
                out[place] = first + byte * 8 + bit
                place += 1


@kernel
def match_sequence(
    offsets: Ints,
    is_detector: Bools,
    masks: Bools,
    point_rows: Ints,
    meeting_offsets: Ints,
) -> Bools:
    """Whether the operands of ``->`` follow one another; the earliest match of each is enough.

    Parameters
    ----------
    offsets : (n_rays + 1,)
    is_detector : (n_operands,), the operand stands on segments
    masks : (n_cells,) marks of all operands, one after the other
    point_rows : (n_operands,) where the marks of each operand begin in ``masks``
    meeting_offsets : (n_points + 1,) meetings on the segment that starts at each point
    """
    n_operands = len(is_detector)
    out = np.zeros(len(offsets) - 1, np.bool_)
    for ray in range(len(offsets) - 1):
        wanted = 0
        row = offsets[ray]
        end = offsets[ray + 1]
        while row < end and wanted < n_operands:
            # One point serves one operand.
            if not is_detector[wanted] and masks[point_rows[wanted] + row]:
                wanted += 1
            # Meetings of the segment that starts here, in order.
            if wanted < n_operands and is_detector[wanted]:
                for meeting in range(meeting_offsets[row], meeting_offsets[row + 1]):
                    if (
                        wanted < n_operands
                        and is_detector[wanted]
                        and masks[point_rows[wanted] + meeting]
                    ):
                        wanted += 1
            row += 1
        out[ray] = wanted == n_operands
    return out


@kernel
def _step(states: NDArray[np.uint64], follow: NDArray[np.uint64], out: NDArray[np.uint64]) -> None:
    """States that may come after any of ``states``."""
    n_words = len(states)
    for word in range(n_words):
        out[word] = 0
    for word in range(n_words):
        bits = states[word]
        state = word * 64
        while bits:
            if bits & np.uint64(1):
                for target in range(n_words):
                    out[target] |= follow[state, target]
            bits >>= np.uint64(1)
            state += 1


@kernel
def _events_fit(event: int, masks: Ints, exact: bool, principal: int) -> bool:
    """Loose: any of the masks; exact: each of them and no other principal event."""
    union = 0
    any_mask = False
    each = True
    for number in range(len(masks)):
        mask = masks[number]
        if mask == 0:
            continue
        union |= mask
        if event & mask:
            any_mask = True
        else:
            each = False
    if exact:
        return each and (event & principal & ~union) == 0
    return any_mask or union == 0


@kernel
def match_path(
    source: Ints,
    offsets: Ints,
    object_: Ints,
    face: Ints,
    event: Ints,
    triangle: Ints,
    triangle_mode: int,
    meeting_offsets: Ints,
    detector: Ints,
    registered: Bools,
    kind: Ints,
    sources: Bools,
    objects: Bools,
    faces: Bools,
    triangles: Ints,
    placeless: Bools,
    event_masks: Ints,
    detectors: Bools,
    follow: NDArray[np.uint64],
    first: NDArray[np.uint64],
    last: NDArray[np.uint64],
    exact: bool,
    needs_detectors: bool,
    needs_faces: bool,
    needs_events: bool,
    principal: int,
) -> Bools:
    """Run a position automaton over the itinerary of every ray.

    ``triangle_mode``: 0 primitives are unknown and taken not to fit, 1 unknown and taken to fit,
    2 compared. Columns that are not needed may be empty. Loose expressions skip registrations that
    they do not name and may name those of one segment in any order; exact ones name all of them in
    their order.
    """
    n_words = len(first)
    out = np.zeros(len(offsets) - 1, np.bool_)
    states = np.zeros(n_words, np.uint64)
    reach = np.zeros(n_words, np.uint64)
    moved = np.zeros(n_words, np.uint64)
    one = np.uint64(1)
    for ray in range(len(offsets) - 1):
        begin = offsets[ray]
        end = offsets[ray + 1]
        alive = True
        for row in range(begin, end):
            # States that this point can be, among those that may come now.
            if row == begin:
                for word in range(n_words):
                    reach[word] = first[word]
            else:
                _step(states, follow, reach)
            alive = False
            for word in range(n_words):
                bits = reach[word]
                states[word] = 0
                place = 0
                while bits:
                    if bits & one:
                        q = word * 64 + place
                        fits = False
                        if kind[q] == 0:
                            fits = True
                        elif kind[q] == 1:
                            if placeless[q]:
                                fits = object_[row] < 0
                            elif row == begin:
                                fits = sources[q, source[ray]]
                            elif object_[row] >= 0:
                                fits = objects[q, object_[row]]
                                if (
                                    not fits
                                    and needs_faces
                                    and face[row] >= 0
                                    and faces[q, face[row]]
                                ):
                                    fits = (
                                        triangles[q] < 0
                                        or triangle_mode == 1
                                        or (triangle_mode == 2 and triangle[row] == triangles[q])
                                    )
                            if fits and needs_events:
                                fits = _events_fit(event[row], event_masks[q], exact, principal)
                        if fits:
                            states[word] |= one << np.uint64(place)
                            alive = True
                    bits >>= one
                    place += 1
            if not alive:
                break
            if not needs_detectors:
                continue
            if exact:
                # Every registration is one element.
                for meeting in range(meeting_offsets[row], meeting_offsets[row + 1]):
                    if not registered[meeting]:
                        continue
                    _step(states, follow, reach)
                    for word in range(n_words):
                        states[word] = 0
                    for q in range(len(kind)):
                        if (
                            kind[q] == 2
                            and (reach[q // 64] >> np.uint64(q % 64)) & one
                            and detectors[q, detector[meeting]]
                        ):
                            states[q // 64] |= one << np.uint64(q % 64)
            else:
                # After the last point, look back at the segment that ended there.
                segment = row if row < end - 1 else row - 1
                if segment < begin:
                    continue
                if meeting_offsets[segment] == meeting_offsets[segment + 1]:
                    continue
                changed = True
                while changed:
                    changed = False
                    _step(states, follow, moved)
                    for q in range(len(kind)):
                        bit = one << np.uint64(q % 64)
                        if kind[q] != 2 or not (moved[q // 64] & bit) or states[q // 64] & bit:
                            continue
                        for meeting in range(
                            meeting_offsets[segment], meeting_offsets[segment + 1]
                        ):
                            if registered[meeting] and detectors[q, detector[meeting]]:
                                states[q // 64] |= bit
                                changed = True
                                break
        if alive:
            for word in range(n_words):
                if states[word] & last[word]:
                    out[ray] = True
    return out
