"""What stands in the brackets of an atom: names, events, points, regions, texts, flags.

An argument knows all of its spellings: how it is read from a parsed call, printed, written to JSON
and read from there. An atom lists its arguments; the grammar gives each part of a call to the first
argument that takes it, and what none takes to the last one that is open to anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from query.expression.criterion import Criterion
from query.expression.words import (
    EventSet,
    event_text,
    finite,
    measure_text,
    number_text,
    quoted,
)
from raymap.model.errors import CriterionError
from raymap.model.unfinished import Unfinished

__all__ = [
    "COMPARISONS",
    "Argument",
    "Events",
    "Flag",
    "JsonReader",
    "Names",
    "Number",
    "PLACES",
    "Places",
    "Point",
    "Points",
    "Region",
    "Regions",
    "SurfaceTest",
    "SurfaceTests",
    "Text",
    "TextReader",
]

PLACES = ("plane", "sphere", "far_field", "moved")
"""Words that describe places (`query.engine.places`)."""
COMPARISONS = ("==", "!=", "<", "<=", ">", ">=")
"""Words that compare."""


class TextReader(Protocol):
    """What arguments need of the grammar (`query.expression.grammar`)."""

    def fail(self, message: str, node: Any) -> CriterionError: ...
    def string(self, node: Any, where: str) -> str: ...
    def number(self, node: Any) -> tuple[float, str]: ...
    def criterion(self, node: Any) -> Criterion: ...
    def point_or_event(self, node: Any) -> Criterion: ...
    def event_set(self, node: Any) -> EventSet: ...
    def sides(self, node: Any) -> tuple[Any, str, Any]: ...
    def source(self, node: Any) -> str: ...


class JsonReader(Protocol):
    """What arguments need of the JSON form (`query.expression.json_form`)."""

    where: str

    def get(self, key: str, kind: type | tuple[type, ...], default: Any = ...) -> Any: ...
    def texts(self, key: str, default: Any = ...) -> tuple[str, ...]: ...
    def child(self, key: str, value: object) -> Criterion: ...
    def children(self) -> list[Criterion]: ...
    def inner(self, key: str, value: object) -> JsonReader: ...
    def finish(self) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Argument:
    """One argument of an atom.

    Attributes
    ----------
    name : attribute of the atom that keeps it
    help : what it is, for pages and proposals
    optional : the atom may stand without it
    """

    name: str
    help: str = ""
    optional: bool = False

    def takes(self, node: Any) -> bool:
        """Whether a part of a call is meant for this argument."""
        raise Unfinished(self, "takes")

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        """The value from its parts of the call ``call`` of the atom ``word``."""
        raise Unfinished(self, "read")

    def show(self, value: Any) -> list[str]:
        """The value as texts between commas."""
        raise Unfinished(self, "show")

    def to_json(self, value: Any) -> dict[str, Any]:
        """The keys that the value adds to the object of its atom."""
        raise Unfinished(self, "to_json")

    def from_json(self, reader: JsonReader, word: str) -> Any:
        """The value from the object of its atom."""
        raise Unfinished(self, "from_json")

    def criteria(self, value: Any) -> Sequence[Criterion]:
        """Criteria in the value."""
        return ()

    @property
    def spelling(self) -> str:
        """How pages write it."""
        return self.name


@dataclass(frozen=True, kw_only=True)
class Names(Argument):
    """Names of things in quotation marks.

    Attributes
    ----------
    of : "source", "detector", "medium" or "place" (an object, face or primitive)
    """

    name: str = "names"
    of: str

    def takes(self, node: Any) -> bool:
        return bool(node.data == "string")

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        return tuple(reader.string(node, word) for node in nodes)

    def show(self, value: Any) -> list[str]:
        return [quoted(name) for name in value]

    def to_json(self, value: Any) -> dict[str, Any]:
        return {self.name: list(value)} if value or not self.optional else {}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        return reader.texts(self.name, []) if self.optional else reader.texts(self.name)

    @property
    def spelling(self) -> str:
        return f'"{self.of}", ...'


@dataclass(frozen=True, kw_only=True)
class Events(Argument):
    """Event words, any of which happened; ``all(...)`` of words that happened at one point."""

    name: str = "events"

    def takes(self, node: Any) -> bool:
        return True

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        return tuple(reader.event_set(node) for node in nodes)

    def show(self, value: Any) -> list[str]:
        return [event_text(words) for words in value]

    def to_json(self, value: Any) -> dict[str, Any]:
        if self.optional and not value:
            return {}
        return {
            self.name: [words[0] if len(words) == 1 else {"all": list(words)} for words in value]
        }

    def from_json(self, reader: JsonReader, word: str) -> Any:
        sets: list[EventSet] = []
        given = reader.get(self.name, list, []) if self.optional else reader.get(self.name, list)
        for item in given:
            words: Any = [item]
            if isinstance(item, dict) and set(item) == {"all"}:
                words = item["all"]
            sound = isinstance(words, list) and words and all(isinstance(w, str) for w in words)
            if not sound:
                raise CriterionError(
                    f"{reader.where}.{self.name} holds {item!r:.60}, no event word"
                )
            sets.append(tuple(words))
        return tuple(sets)

    @property
    def spelling(self) -> str:
        return "event, ..."


@dataclass(frozen=True, kw_only=True)
class Points(Argument):
    """Point conditions, or event words in their place."""

    name: str = "args"

    def takes(self, node: Any) -> bool:
        return True

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        return tuple(reader.point_or_event(node) for node in nodes)

    def show(self, value: Any) -> list[str]:
        return [str(arg) for arg in value]

    def to_json(self, value: Any) -> dict[str, Any]:
        return {"args": [arg.to_json() for arg in value]}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        return tuple(reader.children())

    def criteria(self, value: Any) -> Sequence[Criterion]:
        return tuple(value)

    @property
    def spelling(self) -> str:
        return "point, ..."


@dataclass(frozen=True, kw_only=True)
class Point(Argument):
    """One point condition.

    Attributes
    ----------
    key : in JSON; "args" is a list of this one
    or_event : an event word may stand for it
    """

    name: str = "point"
    key: str = "args"
    or_event: bool = False

    def takes(self, node: Any) -> bool:
        return True

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        if not nodes and self.optional:
            return None
        if len(nodes) != 1:
            raise reader.fail(f"{word} takes one point condition", call)
        return (reader.point_or_event if self.or_event else reader.criterion)(nodes[0])

    def show(self, value: Any) -> list[str]:
        return [] if value is None else [str(value)]

    def to_json(self, value: Any) -> dict[str, Any]:
        if value is None:
            return {}
        tree = value.to_json()
        return {self.key: [tree] if self.key == "args" else tree}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        if self.key == "args":
            args = reader.children()
            if len(args) != 1:
                raise CriterionError(f"{word} takes one argument, found {len(args)}")
            return args[0]
        tree = reader.get(self.key, dict, None) if self.optional else reader.get(self.key, dict)
        return None if tree is None else reader.child(self.key, tree)

    def criteria(self, value: Any) -> Sequence[Criterion]:
        return () if value is None else (value,)

    @property
    def spelling(self) -> str:
        return "point"


@dataclass(frozen=True)
class SurfaceTest:
    """An optical parameter of a surface compared with a number, inside ``hit``."""

    parameter: str
    operator: str
    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", finite(self.value))

    def __bool__(self) -> bool:
        raise TypeError("a surface test belongs inside hit(...): hit(parameter('x') > 0.2)")


@dataclass(frozen=True, kw_only=True)
class SurfaceTests(Argument):
    """Comparisons of optical parameters of the surface."""

    name: str = "surface"
    optional: bool = True

    def takes(self, node: Any) -> bool:
        return bool(node.data == "comparison")

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        tests = []
        for node in nodes:
            left, operator, right = reader.sides(node)
            if left.data != "word":
                raise reader.fail("expected a surface parameter, as in hit(roughness > 0.2)", left)
            number, unit = reader.number(right)
            if unit:
                raise reader.fail("surface parameters are compared with plain numbers", right)
            tests.append(SurfaceTest(str(left.children[0]), operator, number))
        return tuple(tests)

    def show(self, value: Any) -> list[str]:
        return [f"{t.parameter} {t.operator} {number_text(t.value)}" for t in value]

    def to_json(self, value: Any) -> dict[str, Any]:
        tests = [{"parameter": t.parameter, "compare": t.operator, "value": t.value} for t in value]
        return {self.name: tests} if tests else {}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        tests = []
        for item in reader.get(self.name, list, []):
            test = reader.inner(self.name, item)
            operator = test.get("compare", str)
            if operator not in COMPARISONS:
                raise CriterionError(f"{test.where}.compare is {operator!r}")
            parameter, number = test.get("parameter", str), test.get("value", (int, float))
            test.finish()
            tests.append(SurfaceTest(parameter, operator, number))
        return tuple(tests)

    @property
    def spelling(self) -> str:
        return "parameter > number, ..."


_SHAPES = ("rect", "ellipse")


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
        if self.shape not in _SHAPES:
            raise CriterionError(f"a region is rect(...) or ellipse(...), not {self.shape}")
        object.__setattr__(self, "numbers", tuple(finite(number) for number in self.numbers))
        if len(self.numbers) != 4:
            raise CriterionError(f"{self.shape} takes four numbers, found {len(self.numbers)}")
        if self.shape == "ellipse" and min(self.numbers[2:]) <= 0:
            raise CriterionError("the radii of an ellipse are positive")


@dataclass(frozen=True, kw_only=True)
class Regions(Argument):
    """Regions of detectors, ``rect(...)`` and ``ellipse(...)``."""

    name: str = "regions"
    optional: bool = True

    def takes(self, node: Any) -> bool:
        return bool(node.data == "call" and str(node.children[0]) in _SHAPES)

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        return tuple(self._one(reader, node) for node in nodes)

    def _one(self, reader: TextReader, node: Any) -> Region:
        shape = str(node.children[0])
        measures = [reader.number(arg) for arg in node.children[1:]]
        if len(measures) != 4:
            raise reader.fail(f"{shape} takes four numbers, found {len(measures)}", node)
        units = {unit for _, unit in measures}
        if len(units) > 1:
            raise reader.fail("give all four numbers in one unit, or all in cells", node)
        numbers = tuple(number for number, _ in measures)
        try:
            return Region(shape, numbers, units.pop())  # type: ignore[arg-type]
        except CriterionError as error:
            raise reader.fail(str(error), node) from None

    def show(self, value: Any) -> list[str]:
        return [
            f"{region.shape}({', '.join(measure_text(x, region.unit) for x in region.numbers)})"
            for region in value
        ]

    def to_json(self, value: Any) -> dict[str, Any]:
        regions = [
            {region.shape: list(region.numbers)} | ({"unit": region.unit} if region.unit else {})
            for region in value
        ]
        return {self.name: regions} if regions else {}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        regions = []
        for item in reader.get(self.name, list, []):
            region = reader.inner(self.name, item)
            shape = "ellipse" if "ellipse" in item else "rect"
            numbers, unit = region.get(shape, list), region.get("unit", str, "")
            region.finish()
            regions.append(Region(shape, tuple(numbers), unit))
        return tuple(regions)

    @property
    def spelling(self) -> str:
        return "rect(...) or ellipse(...), ..."


@dataclass(frozen=True, kw_only=True)
class Places(Argument):
    """Places in the scene where no detector stands, as ``plane(z=120, size=[36, 24])``."""

    name: str = "places"

    def takes(self, node: Any) -> bool:
        return True

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        for node in nodes:
            if node.data != "call" or str(node.children[0]) not in PLACES:
                raise reader.fail(
                    f"{word} takes places, as plane(z=120, size=[36, 24]); they are "
                    f"{', '.join(PLACES)}",
                    node,
                )
        return tuple(" ".join(reader.source(node).split()) for node in nodes)

    def show(self, value: Any) -> list[str]:
        return list(value)

    def to_json(self, value: Any) -> dict[str, Any]:
        return {self.name: list(value)}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        return tuple(" ".join(text.split()) for text in reader.texts(self.name))

    @property
    def spelling(self) -> str:
        return "plane(...), ..."


@dataclass(frozen=True, kw_only=True)
class Text(Argument):
    """One text in quotation marks; ``example`` is shown where it is missing."""

    name: str = "text"
    example: str

    def takes(self, node: Any) -> bool:
        return bool(node.data == "string")

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        if len(nodes) != 1:
            what = f'{word} takes one expression in quotes, as in {word}("{self.example}")'
            raise reader.fail(what, call)
        return reader.string(nodes[0], word)

    def show(self, value: Any) -> list[str]:
        return [quoted(value)]

    def to_json(self, value: Any) -> dict[str, Any]:
        return {self.name: value}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        return reader.get(self.name, str)

    @property
    def spelling(self) -> str:
        return f'"{self.name}"'


@dataclass(frozen=True, kw_only=True)
class Flag(Argument):
    """A word that is there or not."""

    optional: bool = True

    def takes(self, node: Any) -> bool:
        return bool(node.data == "word" and str(node.children[0]) == self.name)

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        if len(nodes) > 1:
            raise reader.fail(f"{self.name} stands once", call)
        return bool(nodes)

    def show(self, value: Any) -> list[str]:
        return [self.name] if value else []

    def to_json(self, value: Any) -> dict[str, Any]:
        return {self.name: True} if value else {}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        return reader.get(self.name, bool, False)


@dataclass(frozen=True, kw_only=True)
class Number(Argument):
    """A plain number."""

    def takes(self, node: Any) -> bool:
        return bool(node.data == "number")

    def read(self, reader: TextReader, word: str, call: Any, nodes: Sequence[Any]) -> Any:
        if not nodes and self.optional:
            return None
        if len(nodes) != 1:
            raise reader.fail(f"{word} takes one number ({self.name})", call)
        number, unit = reader.number(nodes[0])
        if unit:
            raise reader.fail(f"{word} takes a plain number, without a unit", nodes[0])
        return number

    def show(self, value: Any) -> list[str]:
        return [] if value is None else [number_text(float(value))]

    def to_json(self, value: Any) -> dict[str, Any]:
        return {} if value is None else {self.name: value}

    def from_json(self, reader: JsonReader, word: str) -> Any:
        return reader.get(self.name, (int, float), None if self.optional else ...)
