"""Path expressions on itineraries: position automata run over columns, compiled once for all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from query.engine.context import PathColumns
from query.engine.path_machine import ANY_POINT, DETECTOR, PathMachine
from raymap.jit.kernels import inline_kernel, inner_kernel, kernel

__all__ = ["match_path"]

Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]

_ONE = np.uint64(1)


@inner_kernel
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


@inline_kernel
def _events_fit(event: int, masks: Ints, state: int, exact: bool, principal: int) -> bool:
    """Loose: any of the masks; exact: each of them and no other principal event."""
    union = 0
    any_mask = False
    each = True
    for number in range(masks.shape[1]):
        mask = masks[state, number]
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


@inline_kernel
def _fits(
    paths: PathColumns,
    triangle: Ints,
    triangle_mode: int,
    machine: PathMachine,
    principal: int,
    state: int,
    ray: int,
    row: int,
) -> bool:
    """Whether a point is what an element asks for."""
    kind = machine.kind[state]
    if kind == ANY_POINT:
        return True
    if kind == DETECTOR:
        return False
    owner = paths.object[row]
    if machine.placeless[state]:
        if owner >= 0:
            return False
    elif row == paths.offsets[ray]:
        if not machine.sources[state, paths.source[ray]]:
            return False
    elif owner < 0:
        return False
    elif not machine.objects[state, owner]:
        if not machine.needs_faces or paths.face[row] < 0:
            return False
        if not machine.faces[state, paths.face[row]]:
            return False
        wanted = machine.triangle[state]
        known = triangle_mode == 2
        if wanted >= 0 and triangle_mode != 1 and not (known and triangle[row] == wanted):
            return False
    if not machine.needs_events:
        return True
    return _events_fit(paths.event[row], machine.event_masks, state, machine.exact, principal)


@inline_kernel
def _register_each(
    paths: PathColumns,
    machine: PathMachine,
    row: int,
    states: NDArray[np.uint64],
    reach: NDArray[np.uint64],
) -> None:
    """Exact expressions: every registration of a segment is one element, in their order."""
    for crossing in range(paths.crossing_offsets[row], paths.crossing_offsets[row + 1]):
        if not paths.registered[crossing]:
            continue
        _step(states, machine.follow, reach)
        for word in range(len(states)):
            states[word] = 0
        for q in range(len(machine.kind)):
            bit = _ONE << np.uint64(q % 64)
            if machine.kind[q] != DETECTOR or not reach[q // 64] & bit:
                continue
            if machine.detectors[q, paths.detector[crossing]]:
                states[q // 64] |= bit


@inline_kernel
def _register_any(
    paths: PathColumns,
    machine: PathMachine,
    row: int,
    states: NDArray[np.uint64],
    reach: NDArray[np.uint64],
) -> None:
    """Loose expressions: add elements that some registration of a segment satisfies."""
    first, end = paths.crossing_offsets[row], paths.crossing_offsets[row + 1]
    changed = first < end
    while changed:
        changed = False
        _step(states, machine.follow, reach)
        for q in range(len(machine.kind)):
            bit = _ONE << np.uint64(q % 64)
            if machine.kind[q] != DETECTOR or not reach[q // 64] & bit or states[q // 64] & bit:
                continue
            for crossing in range(first, end):
                if paths.registered[crossing] and machine.detectors[q, paths.detector[crossing]]:
                    states[q // 64] |= bit
                    changed = True
                    break


@kernel
def match_path(
    paths: PathColumns,
    triangle: Ints,
    triangle_mode: int,
    machine: PathMachine,
    principal: int,
) -> Bools:
    """Run a position automaton over the itinerary of every ray.

    Loose expressions skip registrations that they do not name and may name those of one segment in
    any order; exact ones name all of them in their order.

    Parameters
    ----------
    paths : columns that the automaton does not need may be empty
    triangle : (n_points,), or (0,) where primitives are not compared
    triangle_mode : 0 primitives are unknown and taken not to fit, 1 unknown and taken to fit,
        2 compared
    principal : events that tell paths apart

    Returns
    -------
    matched : (n_rays,)
    """
    n_words = len(machine.first)
    out = np.zeros(len(paths.offsets) - 1, np.bool_)
    states = np.zeros(n_words, np.uint64)
    reach = np.zeros(n_words, np.uint64)
    for ray in range(len(out)):
        begin = paths.offsets[ray]
        end = paths.offsets[ray + 1]
        alive = True
        for row in range(begin, end):
            # Find the states that may come now
            if row == begin:
                for word in range(n_words):
                    reach[word] = machine.first[word]
            else:
                _step(states, machine.follow, reach)
            # Keep those that this point can be
            alive = False
            for word in range(n_words):
                bits = reach[word]
                states[word] = 0
                index = 0
                while bits:
                    state = word * 64 + index
                    if bits & _ONE and _fits(
                        paths, triangle, triangle_mode, machine, principal, state, ray, row
                    ):
                        states[word] |= _ONE << np.uint64(index)
                        alive = True
                    bits >>= _ONE
                    index += 1
            if not alive:
                break
            if not machine.needs_detectors:
                continue
            if machine.exact:
                _register_each(paths, machine, row, states, reach)
            else:
                # After the last point, look back at the segment that ended there
                segment = row if row < end - 1 else row - 1
                if segment >= begin:
                    _register_any(paths, machine, segment, states, reach)
        if alive:
            for word in range(n_words):
                if states[word] & machine.last[word]:
                    out[ray] = True
    return out
