"""Python spelling of criteria: functions and quantities that build the tree.

>>> from query import count, detected, hit
>>> ghosts = (count(hit("L*", "reflected")) == 2) & detected("sensor")
"""

from __future__ import annotations

from query.expression import criteria as c
from query.expression.json_form import from_json
from raymap.model.errors import CriterionError
from raymap.model.events import FAMILIES, Event, event_names

__all__ = [
    "all_",
    "angle_of_polarisation",
    "as_criterion",
    "bounces",
    "count",
    "crossed",
    "degree_of_polarisation",
    "detected",
    "ellipse",
    "event",
    "flux",
    "hit",
    "incidence",
    "last",
    "length",
    "medium",
    "optical_length",
    "optical_path",
    "parameter",
    "path",
    "rect",
    "source",
    "wavelength",
]

wavelength = c.Wavelength()
length = c.Length()
optical_length = c.OpticalLength()
bounces = c.Bounces()
flux = c.Flux()
degree_of_polarisation = c.DegreeOfPolarisation()
angle_of_polarisation = c.AngleOfPolarisation()
optical_path = c.OpticalPath()

_FAMILY_WORDS = {int(bits): word for word, bits in FAMILIES.items()}


def _event_sets(value: object) -> tuple[c.EventSet, ...]:
    """Alternatives that one argument stands for."""
    if isinstance(value, Event):
        if int(value) in _FAMILY_WORDS and not _is_single(value):
            return ((_FAMILY_WORDS[int(value)],),)
        return tuple((word,) for word in event_names(int(value)))
    if isinstance(value, str):
        return ((value,),)
    if isinstance(value, c.All):
        words: list[str] = []
        for arg in value.args:
            if not isinstance(arg, c.EventAt) or len(arg.events) != 1:
                raise CriterionError("inside hit and event, all_ takes single event words")
            words.extend(arg.events[0])
        if not words:
            raise CriterionError("inside hit and event, all_ takes event words: all_('tir')")
        return (tuple(words),)
    raise CriterionError(f"expected an event word or Event, found {value!r}")


def _is_single(value: Event) -> bool:
    return int(value).bit_count() == 1


def source(*names: str) -> c.Source:
    """Emitted by one of these sources."""
    return c.Source(names)


def parameter(name: str) -> Parameter:
    """An optical parameter of a surface, to compare inside `hit`: ``parameter("n") > 0.2``."""
    return Parameter(name)


class Parameter:
    """A surface parameter by name; comparing it gives a `SurfaceTest`."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __lt__(self, value: float) -> c.SurfaceTest:
        return c.SurfaceTest(self.name, "<", value)

    def __le__(self, value: float) -> c.SurfaceTest:
        return c.SurfaceTest(self.name, "<=", value)

    def __gt__(self, value: float) -> c.SurfaceTest:
        return c.SurfaceTest(self.name, ">", value)

    def __ge__(self, value: float) -> c.SurfaceTest:
        return c.SurfaceTest(self.name, ">=", value)

    def __eq__(self, value: object) -> c.SurfaceTest:  # type: ignore[override]
        return c.SurfaceTest(self.name, "==", value)  # type: ignore[arg-type]

    def __ne__(self, value: object) -> c.SurfaceTest:  # type: ignore[override]
        return c.SurfaceTest(self.name, "!=", value)  # type: ignore[arg-type]

    __hash__ = None  # type: ignore[assignment]


def hit(*what: str | c.SurfaceTest | Event | c.All, events: object = ()) -> c.Hit:
    """Met an object, face or primitive; strings that are event words say what happened there.

    ``hit("L1.back", "reflected")``, ``hit("L1", Event.TIR)``, ``hit(parameter("gloss") > 0.2)``.
    A string is a name unless a name or surface test came before it and it is an event word; an
    object that is called like an event goes first.
    """
    names: list[str] = []
    tests: list[c.SurfaceTest] = []
    sets: list[c.EventSet] = []
    for item in what:
        if isinstance(item, c.SurfaceTest):
            tests.append(item)
        elif isinstance(item, str) and not ((names or tests) and item in FAMILIES):
            names.append(item)
        else:
            sets.extend(_event_sets(item))
    more = events if isinstance(events, tuple | list) else (events,)
    for item in more:
        sets.extend(_event_sets(item))
    return c.Hit(tuple(names), tuple(tests), tuple(sets))


def event(*events: str | Event | c.All) -> c.EventAt:
    """One of these events happened: ``event("absorbed")``, ``event(Event.TIR)``."""
    return c.EventAt(tuple(words for item in events for words in _event_sets(item)))


def all_(*conditions: c.Criterion | str | Event) -> c.All:
    """Several point conditions, or event words, at one and the same point.

    Without any: every ray, as ``all`` in text.
    """
    args = tuple(
        item if isinstance(item, c.Criterion) else c.EventAt(_event_sets(item))
        for item in conditions
    )
    return c.All(args)


def rect(x0: float, y0: float, x1: float, y1: float, unit: str = "") -> c.Region:
    """Part of a detector, half-open; in cells, or from the centre with ``unit="mm"``."""
    return c.Region("rect", (x0, y0, x1, y1), unit)


def ellipse(cx: float, cy: float, rx: float, ry: float, unit: str = "") -> c.Region:
    """Part of a detector, closed; in cells, or from the centre with ``unit="mm"``."""
    return c.Region("ellipse", (cx, cy, rx, ry), unit)


def _names_and_regions(
    what: tuple[str | c.Region, ...],
) -> tuple[tuple[str, ...], tuple[c.Region, ...]]:
    names = tuple(item for item in what if isinstance(item, str))
    regions = tuple(item for item in what if isinstance(item, c.Region))
    if len(names) + len(regions) != len(what):
        raise CriterionError("detected and crossed take names and regions")
    return names, regions


def detected(*what: str | c.Region) -> c.Detected:
    """Registered by one of these detectors: ``detected("sensor", rect(0, 0, 10, 10))``."""
    return c.Detected(*_names_and_regions(what))


def crossed(*what: str | c.Region) -> c.Crossed:
    """Passed through one of these detectors, registered or not."""
    return c.Crossed(*_names_and_regions(what))


def medium(*names: str) -> c.Medium:
    """Travelled in one of these media."""
    return c.Medium(names)


def last(point: c.Criterion) -> c.Last:
    """The point condition holds where the ray ended."""
    return c.Last(point)


def count(point: c.Criterion) -> c.Count:
    """How many points satisfy a condition; compare it: ``count(hit("*", "reflected")) >= 2``."""
    return c.Count(point)


def incidence(point: c.Criterion) -> c.Incidence:
    """Angle of incidence [deg] at a point that satisfies the condition."""
    return c.Incidence(point)


def path(expression: str, exact: bool = False) -> c.Path:
    """Regular expression over the whole itinerary."""
    return c.Path(expression, exact)


def as_criterion(value: object) -> c.Criterion | None:
    """A criterion from any of its spellings: tree, text, JSON tree; None stays None.

    Raises
    ------
    CriterionError
        the spelling cannot be read.
    """
    from query.expression.grammar import parse

    if value is None or isinstance(value, c.Criterion):
        return value
    if isinstance(value, str):
        return parse(value)
    if isinstance(value, dict):
        return from_json(value)
    if isinstance(value, c.Quantity):
        raise CriterionError(f"{value.word} is a number; compare it to get a criterion")
    raise CriterionError(f"a criterion is a text, a tree or JSON, not {type(value).__name__}")
