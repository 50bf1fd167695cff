"""``hit("L1.back", reflected)``: met an object, face or primitive, or a surface like this."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from query.atoms.all import All
from query.atoms.event import alternatives
from query.engine.bind import Binder, Misfit
from query.engine.bound import BoundNode, BoundPoint
from query.engine.context import Context
from query.engine.event_masks import EventMasks, event_masks, events_happened
from query.engine.kleene import Bools, Pair, apply
from query.engine.scans import look_up
from query.engine.surface_parameters import passes, sides_of
from query.expression.arguments import Events, Names, SurfaceTest, SurfaceTests
from query.expression.atom import Condition
from query.expression.names import FaceNames, ObjectMatch, match_objects, unknown
from query.expression.words import EventSet, canonical_names, check_events, quoted
from raymap.model.errors import UnknownName
from raymap.model.events import FAMILIES, Event

__all__ = ["KINDS", "Hit", "Parameter", "hit", "parameter"]


@dataclass(frozen=True)
class Hit(Condition):
    """Met a named object, face or primitive, or a surface with these parameters.

    ``events``: any of the alternatives happened there; empty: whatever happened.
    """

    names: tuple[str, ...] = ()
    surface: tuple[SurfaceTest, ...] = ()
    events: tuple[EventSet, ...] = ()

    word = "hit"
    title = "met an object or face"
    phrase = "met"
    arguments = (
        Names(of="place", optional=True, help="names of objects, faces, primitives"),
        SurfaceTests(help="optical parameters of the surface"),
        Events(optional=True, help="event words, any of which happened there"),
    )
    place = 10

    def __post_init__(self) -> None:
        if self.names or not self.surface:
            object.__setattr__(self, "names", canonical_names(self.names, self.word))
        check_events(self.events)

    @classmethod
    def stands_alone(cls) -> bool:
        return False

    @property
    def is_point(self) -> bool:
        return True

    def bind(self, binder: Binder, text: str) -> BoundNode:
        matches = []
        # In a map of sources and detectors alone "any surface" is none, not a name that is wrong
        patterns = self.names if binder.directory.objects else [x for x in self.names if x != "*"]
        for pattern in patterns:
            try:
                matches.append(match_objects(pattern, binder.names))
            except UnknownName as error:
                raise Misfit(error, quoted(pattern)) from None
        surfaces = _surfaces(self.surface, binder)
        places = _merged(matches, surfaces, binder.names)
        return BoundHit(text=text, places=places, events=event_masks(self.events))


def _surfaces(tests: Sequence[SurfaceTest], binder: Binder) -> Bools | None:
    """Faces whose surface passes all tests on one side; None without tests."""
    if not tests:
        return None
    sides = [
        sides_of(surface.parameters | {"transmits": int(surface.transmits)})
        for surface in binder.directory.surfaces
    ]
    known = sorted({name for surface in sides for side in surface for name in side})
    known = known or ["transmits"]
    for test in tests:
        if test.parameter not in known:
            error = unknown("surface parameter", test.parameter, known)
            raise Misfit(error, test.parameter)
    passing = [any(passes(side, tests) for side in surface) for surface in sides]
    table = np.array([*passing, False], np.bool_)
    return np.append(table[binder.names.table.surface], False)


def _merged(
    matches: list[ObjectMatch], surfaces: Bools | None, names: FaceNames
) -> tuple[ObjectMatch, ...]:
    """One table for all names without primitives; primitives of one-primitive faces need none."""
    table = names.table
    objects = np.zeros(len(names.objects) + 1, np.bool_)
    faces = np.zeros(names.n_faces + 1, np.bool_)
    kept: list[ObjectMatch] = []
    if not matches and surfaces is not None:
        return (ObjectMatch(objects, surfaces),)
    for match in matches:
        if match.triangle < 0:
            objects |= match.objects
            faces |= match.faces
            continue
        single = np.append(table.primitive_count == 1, False)
        faces |= match.faces & single
        if (match.faces & ~single).any():
            kept.append(ObjectMatch(match.objects, match.faces & ~single, match.triangle))
    if surfaces is not None:
        # A surface is a property of faces, so whole objects become their faces
        faces[:-1] |= objects[table.object]
        objects[:] = False
        faces &= surfaces
        kept = [ObjectMatch(item.objects, item.faces & surfaces, item.triangle) for item in kept]
    return (ObjectMatch(objects, faces), *kept)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundHit(BoundPoint):
    """Point condition on object, face, primitive and events.

    Attributes
    ----------
    places : alternatives; without triangles they are merged into one
    events : alternatives of events; empty: whatever happened
    """

    places: tuple[ObjectMatch, ...] = ()
    events: EventMasks = ()

    def own_streams(self) -> tuple[str, ...]:
        return ("triangle",) if any(place.triangle >= 0 for place in self.places) else ()

    def on_points(self, context: Context) -> Pair:
        place = self._places(context)
        # Emission is not a hit
        if context.n_rays:
            for mask in {id(m): m for m in place}.values():
                mask[context.offsets[:-1]] = False
        if not self.events:
            return place
        happened = events_happened(context, self.events)
        return apply(place, lambda mask: mask & happened)

    def _places(self, context: Context) -> Pair:
        certain = np.zeros(context.n_points, np.bool_)
        maybe = None
        for match in self.places:
            if match.triangle >= 0:
                on_face = look_up(match.faces, context.face)
                triangle = context.triangle
                if triangle is None:
                    maybe = on_face if maybe is None else maybe | on_face
                else:
                    certain |= on_face & (triangle == match.triangle)
                continue
            if match.objects.any():
                certain |= look_up(match.objects, context.object)
            if match.faces.any():
                certain |= look_up(match.faces, context.face)
        return Pair(certain, certain if maybe is None else certain | maybe)

    def wider(self) -> tuple[BoundNode, str] | None:
        if not self.events:
            return None
        return BoundHit(places=self.places), "meet it, but this never happens there in this map"


def parameter(name: str) -> Parameter:
    """An optical parameter of a surface, to compare inside `hit`: ``parameter("n") > 0.2``."""
    return Parameter(name)


class Parameter:
    """A surface parameter by name; comparing it gives a `SurfaceTest`."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __lt__(self, value: float) -> SurfaceTest:
        return SurfaceTest(self.name, "<", value)

    def __le__(self, value: float) -> SurfaceTest:
        return SurfaceTest(self.name, "<=", value)

    def __gt__(self, value: float) -> SurfaceTest:
        return SurfaceTest(self.name, ">", value)

    def __ge__(self, value: float) -> SurfaceTest:
        return SurfaceTest(self.name, ">=", value)

    def __eq__(self, value: object) -> SurfaceTest:  # type: ignore[override]
        return SurfaceTest(self.name, "==", value)  # type: ignore[arg-type]

    def __ne__(self, value: object) -> SurfaceTest:  # type: ignore[override]
        return SurfaceTest(self.name, "!=", value)  # type: ignore[arg-type]

    __hash__ = None  # type: ignore[assignment]


def hit(*what: str | SurfaceTest | Event | All, events: object = ()) -> Hit:
    """Met an object, face or primitive; strings that are event words say what happened there.

    ``hit("L1.back", "reflected")``, ``hit("L1", Event.TIR)``, ``hit(parameter("gloss") > 0.2)``.
    A string is a name unless a name or surface test came before it and it is an event word; an
    object that is called like an event goes first.
    """
    names: list[str] = []
    tests: list[SurfaceTest] = []
    sets: list[EventSet] = []
    for item in what:
        if isinstance(item, SurfaceTest):
            tests.append(item)
        elif isinstance(item, str) and not ((names or tests) and item in FAMILIES):
            names.append(item)
        else:
            sets.extend(alternatives(item))
    more = events if isinstance(events, tuple | list) else (events,)
    for item in more:
        sets.extend(alternatives(item))
    return Hit(tuple(names), tuple(tests), tuple(sets))


KINDS = (Hit,)
