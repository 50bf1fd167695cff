"""A path expression bound to a map: its automaton as arrays for the compiled matcher."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from query.expression.automaton import Automaton, Element, parse_path
from query.expression.names import FaceNames, match_indices, match_objects, unknown
from raymap.model.directory import Directory
from raymap.model.errors import UnknownName
from raymap.model.events import FAMILIES, Event

__all__ = ["ANY_POINT", "DETECTOR", "PLACE", "PRINCIPAL", "PathMachine", "bind_path"]

ANY_POINT, PLACE, DETECTOR = 0, 1, 2
"""Kinds of elements of a path expression."""

INFORMATIVE = (
    Event.EMITTED
    | Event.DETECTOR_CROSSED
    | Event.DETECTOR_REGISTERED
    | Event.MEDIUM_CHANGED
    | Event.DISPERSIVE_SELECT
    | Event.RIM_HIT
)
PRINCIPAL = sum(int(event) for event in Event if not event & INFORMATIVE)
"""Events that tell paths apart in path tables and in exact path expressions."""

_KINDS = {"any": ANY_POINT, "place": PLACE, "detector": DETECTOR}


class PathMachine(NamedTuple):
    """Arrays of a position automaton with n states and w words of 64 states.

    Attributes
    ----------
    kind : (n,) int8: `ANY_POINT`, `PLACE` or `DETECTOR`
    sources : (n, n_sources + 1) bool, names taken as sources
    objects : (n, n_objects + 1) bool; faces : (n, n_faces + 1) bool
    triangle : (n,) int32, -1 none required
    placeless : (n,) bool, matches points without object
    event_masks : (n, m) int32, one mask per event word, 0 unused
    detectors : (n, n_detectors + 1) bool
    follow : (n, w) uint64; first, last : (w,) uint64
    exact : events and registrations are exactly the ones written
    needs_faces, needs_events, needs_detectors : columns that are looked at
    """

    kind: NDArray[np.int8]
    sources: NDArray[np.bool_]
    objects: NDArray[np.bool_]
    faces: NDArray[np.bool_]
    triangle: NDArray[np.int32]
    placeless: NDArray[np.bool_]
    event_masks: NDArray[np.int32]
    detectors: NDArray[np.bool_]
    follow: NDArray[np.uint64]
    first: NDArray[np.uint64]
    last: NDArray[np.uint64]
    exact: bool
    needs_faces: bool = True
    needs_events: bool = True
    needs_detectors: bool = True

    @property
    def needs_triangles(self) -> bool:
        """Whether primitives are looked at, too."""
        return bool((self.triangle >= 0).any())


def _words(bits: int, n_words: int) -> list[int]:
    return [bits >> (64 * word) & (2**64 - 1) for word in range(n_words)]


def _can_be_second(automaton: Automaton) -> int:
    """States that can stand anywhere but first, as a bit set."""
    reachable = 0
    for following in automaton.follow:
        reachable |= following
    return reachable


class _Places:
    """Resolves the names of elements, each pattern once."""

    def __init__(self, directory: Directory, names: FaceNames) -> None:
        self.sources = [source.name for source in directory.sources]
        self.detectors = [detector.name for detector in directory.detectors]
        self.names = names

    def source_indices(self, pattern: str) -> list[int]:
        try:
            return match_indices(pattern, self.sources, "source")
        except UnknownName:
            return []


def bind_path(text: str, exact: bool, directory: Directory, names: FaceNames) -> PathMachine:
    """Resolve the names of a path expression.

    Raises
    ------
    UnknownName
        a name is neither a source (where the first element can stand) nor an object or face.
    """
    automaton = parse_path(text)
    places = _Places(directory, names)
    n = len(automaton.elements)
    n_words = (n + 63) // 64
    n_events = max(1, max(len(element.events) for element in automaton.elements))
    machine = PathMachine(
        kind=np.array([_KINDS[element.kind] for element in automaton.elements], np.int8),
        sources=np.zeros((n, len(places.sources) + 1), np.bool_),
        objects=np.zeros((n, len(names.objects) + 1), np.bool_),
        faces=np.zeros((n, names.n_faces + 1), np.bool_),
        triangle=np.full(n, -1, np.int32),
        placeless=np.zeros(n, np.bool_),
        event_masks=np.zeros((n, n_events), np.int32),
        detectors=np.zeros((n, len(places.detectors) + 1), np.bool_),
        follow=np.array([_words(bits, n_words) for bits in automaton.follow], np.uint64),
        first=np.array(_words(automaton.first, n_words), np.uint64),
        last=np.array(_words(automaton.last, n_words), np.uint64),
        exact=exact,
    )
    later = _can_be_second(automaton)
    for state, element in enumerate(automaton.elements):
        first = bool(automaton.first >> state & 1)
        _fill(machine, state, element, places, first=first, later=bool(later >> state & 1))
    return machine._replace(
        needs_faces=bool(machine.faces.any()),
        needs_events=exact or bool(machine.event_masks.any()),
        needs_detectors=exact or bool((machine.kind == DETECTOR).any()),
    )


def _fill(
    machine: PathMachine, state: int, element: Element, places: _Places, *, first: bool, later: bool
) -> None:
    if element.kind == "detector":
        assert element.name is not None
        machine.detectors[state, match_indices(element.name, places.detectors, "detector")] = True
        return
    masks = [int(FAMILIES[word]) for word in element.events]
    machine.event_masks[state, : len(masks)] = masks
    if element.kind == "any":
        return
    if element.name is None:
        machine.placeless[state] = True
        return
    sources = places.source_indices(element.name) if first else []
    machine.sources[state, sources] = True
    if not later:
        if not sources:
            raise _first_element(element.name, places)
        return
    try:
        found = match_objects(element.name, places.names, aliases=not machine.exact)
    except UnknownName:
        if sources:
            return
        raise
    machine.objects[state] = found.objects
    machine.faces[state] = found.faces
    machine.triangle[state] = _needed_triangle(found.triangle, found.faces, places)


def _first_element(name: str, places: _Places) -> UnknownName:
    error = unknown("source", name, places.sources)
    return UnknownName(f"{error}; a path expression begins with the source")


def _needed_triangle(triangle: int, faces: NDArray[np.bool_], places: _Places) -> int:
    """The primitive to compare, unless each of the faces has only one."""
    if triangle < 0 or (places.names.table.primitive_count[faces[:-1]] == 1).all():
        return -1
    return triangle
