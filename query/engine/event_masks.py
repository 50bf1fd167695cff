"""Events of points, as bit masks."""

from __future__ import annotations

from query.engine.context import Context
from query.engine.kleene import Bools
from query.engine.scans import mark_events
from query.expression.words import EventSet
from raymap.model.events import FAMILIES

__all__ = ["EventMasks", "event_masks", "events_happened"]

EventMasks = tuple[tuple[int, ...], ...]
"""Alternatives of events; in each, every mask must have a bit set at the point."""


def event_masks(events: tuple[EventSet, ...]) -> EventMasks:
    """Masks of the alternatives; single words are merged, they mean any of them anyway."""
    single = 0
    masks: list[tuple[int, ...]] = []
    for words in events:
        if len(words) == 1:
            single |= int(FAMILIES[words[0]])
        else:
            masks.append(tuple(int(FAMILIES[word]) for word in words))
    return ((single,), *masks) if single else tuple(masks)


def events_happened(context: Context, events: EventMasks) -> Bools:
    """Whether one of the alternatives happened at every point."""
    result: Bools | None = None
    for masks in events:
        one = mark_events(context.event, masks[0])
        for mask in masks[1:]:
            one &= mark_events(context.event, mask)
        result = one if result is None else result | one
    assert result is not None
    return result
