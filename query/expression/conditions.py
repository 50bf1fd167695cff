"""What a ray did: the atoms of criteria, from ``source`` to ``path``.

`Hit`, `EventAt` and `All` are point conditions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from query.expression.criterion import Criterion, check_point
from query.expression.names import canonical
from query.expression.quantities import finite
from raymap.model.errors import CriterionError
from raymap.model.events import FAMILIES

__all__ = [
    "All",
    "Crossed",
    "Detected",
    "EventAt",
    "EventSet",
    "Hit",
    "Last",
    "Medium",
    "Path",
    "Region",
    "Source",
    "SurfaceTest",
]

EventSet = tuple[str, ...]
"""Event words that all happen at one point; mostly a single word."""


def _names(names: tuple[str, ...], what: str) -> tuple[str, ...]:
    if not names or not all(isinstance(name, str) and name for name in names):
        raise CriterionError(f"{what} takes one or more names in quotes")
    return tuple(canonical(name) for name in names)


def _event_sets(events: tuple[EventSet, ...]) -> None:
    for alternative in events:
        for word in alternative:
            if word not in FAMILIES:
                from query.expression.names import nearest_names

                near = nearest_names(word, FAMILIES) or list(FAMILIES)
                raise CriterionError(f"no event is called {word!r}; nearest: {', '.join(near[:5])}")


@dataclass(frozen=True)
class Source(Criterion):
    """Emitted by one of the named sources."""

    names: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", _names(self.names, "source"))


@dataclass(frozen=True)
class SurfaceTest:
    """An optical parameter of a surface compared with a number, inside `Hit`."""

    parameter: str
    operator: str
    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", finite(self.value))

    def __bool__(self) -> bool:
        raise TypeError("a surface test belongs inside hit(...): hit(parameter('x') > 0.2)")


@dataclass(frozen=True)
class Hit(Criterion):
    """Met a named object, face or primitive, or a surface with these parameters.

    ``events``: any of the alternatives happened there; empty: whatever happened.
    """

    names: tuple[str, ...] = ()
    surface: tuple[SurfaceTest, ...] = ()
    events: tuple[EventSet, ...] = ()

    def __post_init__(self) -> None:
        if self.names or not self.surface:
            object.__setattr__(self, "names", _names(self.names, "hit"))
        _event_sets(self.events)

    @property
    def is_point(self) -> bool:
        return True


@dataclass(frozen=True)
class EventAt(Criterion):
    """One of these events happened."""

    events: tuple[EventSet, ...]

    def __post_init__(self) -> None:
        if not self.events:
            raise CriterionError("event takes one or more event words: event(absorbed)")
        _event_sets(self.events)

    @property
    def is_point(self) -> bool:
        return True


@dataclass(frozen=True)
class All(Criterion):
    """Several point conditions at one and the same point; without any, every point and ray."""

    args: tuple[Criterion, ...] = ()

    def __post_init__(self) -> None:
        for arg in self.args:
            check_point(arg, "all")

    @property
    def is_point(self) -> bool:
        return True


@dataclass(frozen=True)
class Region:
    """Part of a detector: ``rect`` (x0, y0, x1, y1), half-open, or ``ellipse`` (cx, cy, rx, ry).

    ``unit`` empty: in cells from the lower left corner; a length: from the detector's centre; an
    angle: C and gamma of a far field.
    """

    shape: str
    numbers: tuple[float, float, float, float]
    unit: str = ""

    def __post_init__(self) -> None:
        if self.shape not in ("rect", "ellipse"):
            raise CriterionError(f"a region is rect(...) or ellipse(...), not {self.shape}")
        object.__setattr__(self, "numbers", tuple(finite(number) for number in self.numbers))
        if len(self.numbers) != 4:
            raise CriterionError(f"{self.shape} takes four numbers, found {len(self.numbers)}")
        if self.shape == "ellipse" and min(self.numbers[2:]) <= 0:
            raise CriterionError("the radii of an ellipse are positive")


@dataclass(frozen=True)
class Detected(Criterion):
    """Registered by one of the named detectors, inside one of the regions if any are given."""

    names: tuple[str, ...]
    regions: tuple[Region, ...] = ()
    word: ClassVar[str] = "detected"

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", _names(self.names, self.word))

    @property
    def is_meeting(self) -> bool:
        return True


@dataclass(frozen=True)
class Crossed(Detected):
    """Passed through one of the named detectors, registered or not."""

    word: ClassVar[str] = "crossed"


@dataclass(frozen=True)
class Medium(Criterion):
    """Travelled in one of the named media."""

    names: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", _names(self.names, "medium"))


@dataclass(frozen=True)
class Last(Criterion):
    """The point condition holds where the ray ended."""

    point: Criterion

    def __post_init__(self) -> None:
        check_point(self.point, "last")


@dataclass(frozen=True)
class Path(Criterion):
    """A regular expression over the whole itinerary.

    ``exact``: the events of each point and the registrations between points are exactly the ones
    written, as the rows of path tables write them.
    """

    text: str
    exact: bool = False

    def __post_init__(self) -> None:
        from query.expression.automaton import canonical_path, parse_path

        object.__setattr__(self, "text", canonical_path(self.text))
        parse_path(self.text)
