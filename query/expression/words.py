"""Pieces of the criteria language: quotation marks, numbers, events, and how they are checked."""

from __future__ import annotations

import math
import numbers
import re

from query.expression.names import canonical, nearest_names
from raymap.model.errors import CriterionError
from raymap.model.events import FAMILIES, Event, event_names
from raymap.model.textfile import plain_number

__all__ = [
    "EventSet",
    "canonical_names",
    "check_events",
    "event_sets",
    "event_text",
    "finite",
    "measure",
    "measure_text",
    "number_text",
    "quoted",
]

EventSet = tuple[str, ...]
"""Event words that all happen at one point; mostly a single word."""

_FAMILY_WORDS = {int(bits): word for word, bits in FAMILIES.items()}


def quoted(pattern: str) -> str:
    """A pattern in quotation marks; its own marks get a backslash."""
    return '"' + pattern.replace('"', '\\"') + '"'


def number_text(value: float) -> str:
    """Shortest text of a number that reads back the same."""
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def measure_text(value: float, unit: str) -> str:
    """A number with its unit."""
    return f"{number_text(value)} {unit}" if unit else number_text(value)


def event_text(words: EventSet) -> str:
    """Events at one point, as text."""
    return words[0] if len(words) == 1 else f"all({', '.join(words)})"


def canonical_names(names: tuple[str, ...], what: str) -> tuple[str, ...]:
    """Patterns in their one spelling; at least one."""
    if not names or not all(isinstance(name, str) and name for name in names):
        raise CriterionError(f"{what} takes one or more names in quotes")
    return tuple(canonical(name) for name in names)


def check_events(events: tuple[EventSet, ...]) -> None:
    """Refuse words that no event has."""
    for alternative in events:
        for word in alternative:
            if word not in FAMILIES:
                near = nearest_names(word, FAMILIES) or list(FAMILIES)
                raise CriterionError(f"no event is called {word!r}; nearest: {', '.join(near[:5])}")


def event_sets(value: object) -> tuple[EventSet, ...]:
    """Alternatives that a word or an `Event` stands for."""
    if isinstance(value, Event):
        if int(value) in _FAMILY_WORDS and int(value).bit_count() != 1:
            return ((_FAMILY_WORDS[int(value)],),)
        return tuple((word,) for word in event_names(int(value)))
    if isinstance(value, str):
        return ((value,),)
    raise CriterionError(f"expected an event word or Event, found {value!r}")


def _shown(value: object) -> str:
    """A value in a message; of long ones how they begin."""
    try:
        text = repr(value)
    except ValueError:  # digits without end
        text = f"{type(value).__name__} of many digits"
    return text if len(text) <= 60 else f"{text[:60]}…"


def finite(value: object) -> float:
    """A number that is one, or an error that says so."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise CriterionError(f"expected a number, found {_shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise CriterionError(f"expected a finite number, found {_shown(value)}")
    return number + 0.0  # one zero only


def measure(value: object) -> tuple[float, str]:
    """A number, or a text such as ``"12.5 mm"``, as (number, unit)."""
    if isinstance(value, str):
        match = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*([^\d\s]\S*)?\s*", value)
        number = None if match is None else plain_number(match.group(1))
        if match is None or number is None:
            raise CriterionError(
                f"expected a number with a unit such as '12.5 mm', found {_shown(value)}"
            )
        return finite(number), match.group(2) or ""
    return finite(value), ""
