"""``event(absorbed)``: one of these events happened."""

from __future__ import annotations

from dataclasses import dataclass

from query.atoms.all import All
from query.engine.bind import Binder
from query.engine.bound import BoundNode, BoundPoint
from query.engine.context import Context
from query.engine.event_masks import EventMasks, event_masks, events_happened
from query.engine.kleene import Pair, exactly
from query.expression.arguments import Events
from query.expression.atom import Condition
from query.expression.criterion import Criterion
from query.expression.words import EventSet, check_events, event_sets
from raymap.model.errors import CriterionError
from raymap.model.events import Event

__all__ = ["KINDS", "EventAt", "all_", "alternatives", "event"]


@dataclass(frozen=True)
class EventAt(Condition):
    """One of these events happened."""

    events: tuple[EventSet, ...]

    word = "event"
    title = "happened at some point"
    phrase = "event"
    arguments = (Events(help="event words, any of which happened"),)
    place = 50

    def __post_init__(self) -> None:
        if not self.events:
            raise CriterionError("event takes one or more event words: event(absorbed)")
        check_events(self.events)

    @property
    def is_point(self) -> bool:
        return True

    def bind(self, binder: Binder, text: str) -> BoundNode:
        return BoundEvent(text=text, events=event_masks(self.events))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundEvent(BoundPoint):
    """``events`` : alternatives."""

    events: EventMasks

    def on_points(self, context: Context) -> Pair:
        return exactly(events_happened(context, self.events))


def event(*events: str | Event | All) -> EventAt:
    """One of these events happened: ``event("absorbed")``, ``event(Event.TIR)``."""
    return EventAt(tuple(words for item in events for words in alternatives(item)))


def all_(*conditions: Criterion | str | Event) -> All:
    """Several point conditions, or event words, at one and the same point.

    Without any: every ray, as ``all`` in text.
    """
    return All(
        tuple(
            item if isinstance(item, Criterion) else EventAt(event_sets(item))
            for item in conditions
        )
    )


def alternatives(value: object) -> tuple[EventSet, ...]:
    """Alternatives that one argument of `event` or `hit` stands for."""
    if not isinstance(value, All):
        return event_sets(value)
    words: list[str] = []
    for arg in value.args:
        if not isinstance(arg, EventAt) or len(arg.events) != 1:
            raise CriterionError("inside hit and event, all_ takes single event words")
        words.extend(arg.events[0])
    if not words:
        raise CriterionError("inside hit and event, all_ takes event words: all_('tir')")
    return (tuple(words),)


KINDS = (EventAt,)
