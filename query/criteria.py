"""The expression tree of criteria: immutable nodes and the operators that build them.

A criterion speaks about one ray. Text, Python operators and JSON are three spellings of this one
tree; nothing here knows a map. `Hit`, `EventAt` and `All` are *point conditions*: inside `Count`,
`Last`, `Then` and `Incidence` their operators act at one point, elsewhere a point condition means
"at some point of the ray" and operators combine rays.
"""

from __future__ import annotations

import math
import numbers
import re
from dataclasses import dataclass
from typing import Any, ClassVar

from query.names import canonical
from raymap.errors import CriterionError
from raymap.events import FAMILIES

__all__ = [
    "All",
    "And",
    "AngleOfPolarisation",
    "Bounces",
    "Compare",
    "Count",
    "Criterion",
    "Crossed",
    "DegreeOfPolarisation",
    "Detected",
    "EventAt",
    "EventSet",
    "Flux",
    "Hit",
    "Incidence",
    "Last",
    "Length",
    "Medium",
    "Not",
    "OpticalLength",
    "OpticalPath",
    "Or",
    "Path",
    "Quantity",
    "Recorded",
    "Region",
    "Source",
    "SurfaceTest",
    "Then",
    "Wavelength",
    "Xor",
]

OPERATORS = ("==", "!=", "<", "<=", ">", ">=")

EventSet = tuple[str, ...]
"""Event words that all happen at one point; mostly a single word."""


class Criterion:
    """A logical expression over one ray."""

    @property
    def is_point(self) -> bool:
        """Whether the expression can be asked of a single point."""
        return False

    def __and__(self, other: Criterion) -> Criterion:
        return And((self, _criterion(other, "&")))

    def __or__(self, other: Criterion) -> Criterion:
        return Or((self, _criterion(other, "|")))

    def __xor__(self, other: Criterion) -> Criterion:
        return Xor((self, _criterion(other, "^")))

    def __invert__(self) -> Criterion:
        return Not(self)

    def then(self, *others: Criterion) -> Criterion:
        """This first, then the others, in this order along the ray (``->``)."""
        return Then((self, *others))

    def __bool__(self) -> bool:
        raise TypeError(
            "a criterion has no truth value before it is asked of a map: write & | ~ instead of "
            "and, or, not; put comparisons in parentheses; ask with query.select(map, criterion)"
        )

    def __str__(self) -> str:
        from query.printer import to_text

        return to_text(self)

    def to_json(self) -> dict[str, Any]:
        """The criterion as a JSON tree."""
        from query.json_form import to_json

        return to_json(self)


def _criterion(value: object, operator: str) -> Criterion:
    if not isinstance(value, Criterion):
        advice = ""
        if isinstance(value, Quantity):
            advice = "; compare it with a number, in parentheses: (count(...) >= 2)"
        raise TypeError(f"{operator} joins criteria, not {type(value).__name__}{advice}")
    return value


def _point(value: Criterion, where: str) -> None:
    if not isinstance(value, Criterion) or not value.is_point:
        raise CriterionError(
            f"{where} takes a point condition (hit, event, all and their combinations), "
            f"not {value if isinstance(value, Criterion) else type(value).__name__}"
        )


def _names(names: tuple[str, ...], what: str) -> tuple[str, ...]:
    if not names or not all(isinstance(name, str) and name for name in names):
        raise CriterionError(f"{what} takes one or more names in quotes")
    return tuple(canonical(name) for name in names)


def _event_sets(events: tuple[EventSet, ...]) -> None:
    for alternative in events:
        for word in alternative:
            if word not in FAMILIES:
                from query.names import nearest_names

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
        object.__setattr__(self, "value", _finite(self.value))

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
    """Several point conditions at one and the same point."""

    args: tuple[Criterion, ...]

    def __post_init__(self) -> None:
        if not self.args:
            raise CriterionError("all takes one or more point conditions")
        for arg in self.args:
            _point(arg, "all")

    @property
    def is_point(self) -> bool:
        return True


@dataclass(frozen=True)
class Region:
    """Part of a detector: ``rect`` (x0, y0, x1, y1), half-open, or ``ellipse`` (cx, cy, rx, ry).

    ``unit`` empty: in cells from the lower left corner; else a length (or, on angular detectors,
    an angle) from the detector's centre.
    """

    shape: str
    numbers: tuple[float, float, float, float]
    unit: str = ""

    def __post_init__(self) -> None:
        if self.shape not in ("rect", "ellipse"):
            raise CriterionError(f"a region is rect(...) or ellipse(...), not {self.shape}")
        object.__setattr__(self, "numbers", tuple(_finite(number) for number in self.numbers))
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
        _point(self.point, "last")


@dataclass(frozen=True)
class Path(Criterion):
    """A regular expression over the whole itinerary.

    ``exact``: the events of each point and the registrations between points are exactly the ones
    written, as the rows of path tables write them.
    """

    text: str
    exact: bool = False

    def __post_init__(self) -> None:
        from query.automaton import canonical_path, parse_path

        object.__setattr__(self, "text", canonical_path(self.text))
        parse_path(self.text)


@dataclass(frozen=True)
class Not(Criterion):
    """The opposite."""

    arg: Criterion

    @property
    def is_point(self) -> bool:
        return self.arg.is_point


@dataclass(frozen=True)
class _Nary(Criterion):
    """An associative operator; nested ones of the same kind are merged."""

    args: tuple[Criterion, ...]
    symbol: ClassVar[str] = ""

    def __post_init__(self) -> None:
        flat: list[Criterion] = []
        for arg in self.args:
            _criterion(arg, self.symbol)
            flat.extend(arg.args if type(arg) is type(self) else (arg,))
        if len(flat) < 2:
            raise CriterionError(f"{self.symbol} joins two or more criteria")
        object.__setattr__(self, "args", tuple(flat))

    @property
    def is_point(self) -> bool:
        return all(arg.is_point for arg in self.args)


@dataclass(frozen=True)
class And(_Nary):
    """All of them."""

    symbol: ClassVar[str] = "&"


@dataclass(frozen=True)
class Or(_Nary):
    """At least one of them."""

    symbol: ClassVar[str] = "|"


@dataclass(frozen=True)
class Xor(_Nary):
    """An odd number of them."""

    symbol: ClassVar[str] = "^"


@dataclass(frozen=True)
class Then(_Nary):
    """One after the other along the ray: points i < j < k, detectors between two points."""

    symbol: ClassVar[str] = "->"

    def __post_init__(self) -> None:
        super().__post_init__()
        for arg in self.args:
            if not isinstance(arg, Detected):
                _point(arg, "->")

    @property
    def is_point(self) -> bool:
        return False


class Quantity:
    """A number that a ray has; compare it with a number to get a criterion.

    Comparison builds a `Compare` node: ``wavelength < 500``, ``length >= "12 cm"``.
    """

    word: ClassVar[str] = ""

    def __lt__(self, other: object) -> Compare:
        return Compare(self, "<", *_measure(other))

    def __le__(self, other: object) -> Compare:
        return Compare(self, "<=", *_measure(other))

    def __gt__(self, other: object) -> Compare:
        return Compare(self, ">", *_measure(other))

    def __ge__(self, other: object) -> Compare:
        return Compare(self, ">=", *_measure(other))

    def __eq__(self, other: object) -> Any:
        if isinstance(other, Quantity):
            return type(self) is type(other) and self._key() == other._key()
        return Compare(self, "==", *_measure(other))

    def __ne__(self, other: object) -> Any:
        if isinstance(other, Quantity):
            return not (type(self) is type(other) and self._key() == other._key())
        return Compare(self, "!=", *_measure(other))

    def __hash__(self) -> int:
        return hash((type(self).__name__, self._key()))

    def __bool__(self) -> bool:
        raise TypeError(
            f"{self.word} has no truth value; compare it with a number: {self.word} > 1"
        )

    def _key(self) -> object:
        return None


class Wavelength(Quantity):
    """Vacuum wavelength of the ray at its end [nm]; undefined while several channels travel."""

    word = "wavelength"


class Length(Quantity):
    """Geometric length of the ray [scene units], without the last segment of one that left."""

    word = "length"


class OpticalLength(Quantity):
    """Sum of refractive index x length [scene units]."""

    word = "optical_length"


class Bounces(Quantity):
    """Points between the first and the last."""

    word = "bounces"


class Flux(Quantity):
    """Flux that the ray carries [flux unit of the map]."""

    word = "flux"


@dataclass(frozen=True, eq=False)
class Count(Quantity):
    """How many points satisfy a point condition."""

    point: Criterion
    word = "count"

    def __post_init__(self) -> None:
        _point(self.point, "count")

    def _key(self) -> object:
        return self.point


@dataclass(frozen=True, eq=False)
class Incidence(Quantity):
    """Angle between the arriving ray and the normal at a point that satisfies a condition [deg].

    The comparison holds if it holds at one such point.
    """

    point: Criterion
    word = "incidence"

    def __post_init__(self) -> None:
        _point(self.point, "incidence")

    def _key(self) -> object:
        return self.point


@dataclass(frozen=True, eq=False)
class Recorded(Quantity):
    """A quantity that polarised traces record, at the ray's end or at certain points.

    Without ``point`` it speaks of the light of the ray's last segment; with one, of the light that
    goes on from points that satisfy it, and the comparison holds if it holds at one of them.
    Undefined in maps without the column. Calling it adds the point:
    ``degree_of_polarisation(hit("L1")) > 0.5``.
    """

    point: Criterion | None = None

    def __post_init__(self) -> None:
        if self.point is not None:
            _point(self.point, self.word)

    def __call__(self, point: Criterion) -> Recorded:
        return type(self)(point)

    def _key(self) -> object:
        return self.point


@dataclass(frozen=True, eq=False)
class DegreeOfPolarisation(Recorded):
    """Polarised share of the light, 0 to 1."""

    word = "degree_of_polarisation"


@dataclass(frozen=True, eq=False)
class AngleOfPolarisation(Recorded):
    """Azimuth of the vibration from the transverse axis x [deg], (-90, 90]."""

    word = "angle_of_polarisation"


@dataclass(frozen=True, eq=False)
class OpticalPath(Recorded):
    """Recorded optical path from the emission to the point [scene units]."""

    word = "optical_path"


@dataclass(frozen=True)
class Compare(Criterion):
    """A quantity compared with a number."""

    quantity: Quantity
    operator: str
    value: float
    unit: str = ""

    def __post_init__(self) -> None:
        if self.operator not in OPERATORS:
            raise CriterionError(
                f"{self.operator!r} is no comparison; write one of == != < <= > >="
            )
        object.__setattr__(self, "value", _finite(self.value))


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise CriterionError(f"expected a number, found {value!r}")
    number = float(value)
    if not math.isfinite(number):
        raise CriterionError(f"expected a finite number, found {value!r}")
    return number + 0.0  # one zero only


def _measure(value: object) -> tuple[float, str]:
    """A number, or a text such as ``"12.5 mm"``, as (number, unit)."""
    if isinstance(value, str):
        match = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*([^\d\s]\S*)?\s*", value)
        if match is None:
            raise CriterionError(
                f"expected a number with a unit such as '12.5 mm', found {value!r}"
            )
        return _finite(float(match.group(1))), match.group(2) or ""
    return _finite(value), ""
