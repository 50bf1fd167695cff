"""Text to tree: the criteria language, parsed with a grammar and never evaluated as Python."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from query.expression import criteria as c
from query.expression.names import nearest_names
from query.expression.units import known_units, unit_words
from raymap.model.errors import CriterionError
from raymap.model.events import FAMILIES

if TYPE_CHECKING:
    from lark import Lark, Token, Tree

__all__ = ["mark", "parse"]

MAX_LENGTH = 1_000_000
MAX_DEPTH = 200

_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
_ASCII = {"≠": "!=", "≤": "<=", "≥": ">="}
_PLAIN_QUANTITIES: dict[str, type[c.Quantity]] = {
    kind.word: kind for kind in (c.Wavelength, c.Length, c.OpticalLength, c.Bounces, c.Flux)
}
_POINT_QUANTITIES = {"count": c.Count, "incidence": c.Incidence}
_RECORDED: dict[str, type[c.Recorded]] = {
    kind.word: kind for kind in (c.DegreeOfPolarisation, c.AngleOfPolarisation, c.OpticalPath)
}
_ATOMS = (
    *("source", "hit", "event", "all", "detected", "crossed", "medium", "last", "path"),
    *_POINT_QUANTITIES,
    *_PLAIN_QUANTITIES,
    *_RECORDED,
)


def mark(text: str, start: int, end: int) -> str:
    """The line of ``text`` that holds a place, with carets under it."""
    line_start = text.rfind("\n", 0, start) + 1
    line_end = text.find("\n", start)
    line_end = len(text) if line_end < 0 else line_end
    # A window keeps carets visible in very long criteria.
    left = max(line_start, start - 60)
    right = min(line_end, max(end, start + 1) + 60)
    width = max(1, min(end, line_end) - start)
    head = "…" if left > line_start else ""
    tail = "…" if right < line_end else ""
    shown = head + text[left:right].replace("\t", " ") + tail
    return f"  {shown}\n  {' ' * (len(head) + start - left)}{'^' * min(width, right - start + 1)}"


def _fail(message: str, text: str, start: int, end: int) -> CriterionError:
    return CriterionError(f"{message} (column {start + 1})\n{mark(text, start, end)}")


@lru_cache(maxsize=1)
def _parser() -> Lark:
    from lark import Lark

    grammar = FilePath(__file__).with_name("grammar.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", maybe_placeholders=False, propagate_positions=True)


def parse(text: str) -> c.Criterion:
    """Read a criterion from text.

    Raises
    ------
    CriterionError
        with the place, carets under it, and what was expected.
    """
    from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedToken

    if not isinstance(text, str):
        raise CriterionError(f"a criterion is a text, not {type(text).__name__}")
    if len(text) > MAX_LENGTH:
        raise CriterionError(f"the criterion is longer than {MAX_LENGTH} characters")
    if not text.strip():
        raise CriterionError('the criterion is empty; write for example hit("L1")')
    _check_brackets(text)
    try:
        tree = _parser().parse(text)
    except UnexpectedCharacters as error:
        place = error.pos_in_stream or 0
        what = (
            "a quotation mark is never closed"
            if text[place] == '"'
            else (f"unexpected {text[place]!r}")
        )
        raise _fail(what, text, place, place + 1) from None
    except UnexpectedEOF:
        raise _fail("the criterion ends too early", text, len(text), len(text)) from None
    except UnexpectedToken as error:
        if error.token.type == "$END":
            raise _fail("the criterion ends too early", text, len(text), len(text)) from None
        place = error.token.start_pos or 0
        raise _fail(
            f"unexpected {str(error.token)!r}", text, place, place + len(error.token)
        ) from None
    return _Builder(text).criterion(tree)


def _check_brackets(text: str) -> None:
    """Name the bracket that is open, and bound the nesting before anything recurses over it."""
    open_places: list[int] = []
    quoted = escaped = False
    for place, character in enumerate(text):
        if quoted:
            if escaped:
                escaped = False
            elif character == "\\":
                escaped = True
            elif character == '"':
                quoted = False
        elif character == '"':
            quoted = True
        elif character == "(":
            open_places.append(place)
            if len(open_places) > MAX_DEPTH:
                raise _fail(f"brackets nest deeper than {MAX_DEPTH}", text, place, place + 1)
        elif character == ")":
            if not open_places:
                raise _fail("this bracket closes nothing", text, place, place + 1)
            open_places.pop()
    if open_places and not quoted:
        raise _fail(
            "this bracket is never closed: add )", text, open_places[-1], open_places[-1] + 1
        )


class _Builder:
    """Turns the parse tree into nodes; every error carries its place."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.units = known_units()
        self.depth = 0

    def fail(self, message: str, node: Tree[Token] | Token) -> CriterionError:
        start, end = self.span(node)
        return _fail(message, self.text, start, end)

    def span(self, node: Tree[Token] | Token) -> tuple[int, int]:
        place: Any = getattr(node, "meta", node)
        return place.start_pos, place.end_pos

    def source(self, node: Tree[Token]) -> str:
        start, end = self.span(node)
        return self.text[start:end]

    def criterion(self, node: Any) -> c.Criterion:
        """Any expression that stands for rays or points."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fail(f"the criterion nests deeper than {MAX_DEPTH}", node)
        try:
            return self._criterion(node)
        except CriterionError as error:
            # Errors of the nodes themselves do not know their place yet.
            if "\n" in str(error):
                raise
            raise self.fail(str(error), node) from None
        finally:
            self.depth -= 1

    def _criterion(self, node: Any) -> c.Criterion:
        kind = node.data
        if kind == "group":
            return self.criterion(node.children[0])
        if kind == "negation":
            return c.Not(self.criterion(node.children[-1]))
        joined = {"disjunction": c.Or, "exclusion": c.Xor, "conjunction": c.And, "sequence": c.Then}
        if kind in joined:
            return joined[kind](tuple(self.criterion(child) for child in node.children))
        if kind == "comparison":
            return self.comparison(node)
        if kind == "call":
            return self.call(node)
        if kind == "word":
            word = str(node.children[0])
            if word == "all":
                return c.All()
            if word in FAMILIES:
                raise self.fail(f"{word} is an event word: write event({word})", node)
            if word in _PLAIN_QUANTITIES or word in _RECORDED:
                raise self.fail(f"{word} is a number: compare it, for example {word} > 1", node)
            raise self.fail(self._unknown_atom(word), node)
        shown = self.source(node)
        raise self.fail(
            f"{shown} is not a criterion; names stand in brackets, as in hit({shown})", node
        )

    def _unknown_atom(self, word: str) -> str:
        near = nearest_names(word, _ATOMS)
        meant = f"; did you mean {' or '.join(near)}?" if near else f"; atoms: {', '.join(_ATOMS)}"
        return f"unknown word {word!r}{meant}"

    def comparison(self, node: Any) -> c.Criterion:
        left, token, right = node.children
        operator = _ASCII.get(str(token), str(token))
        if left.data == "number":
            left, right, operator = right, left, _MIRRORED[operator]
        quantity = self.quantity(left)
        number, unit = self.number(right)
        return c.Compare(quantity, operator, number, unit)

    def quantity(self, node: Any) -> c.Quantity:
        if node.data == "group":
            return self.quantity(node.children[0])
        word = str(node.children[0]) if node.data in ("word", "call") else ""
        if node.data == "word" and word in _PLAIN_QUANTITIES:
            return _PLAIN_QUANTITIES[word]()
        if node.data == "word" and word in _RECORDED:
            return _RECORDED[word]()
        if node.data == "call" and word in (*_POINT_QUANTITIES, *_RECORDED):
            args = node.children[1:]
            if len(args) != 1:
                raise self.fail(f"{word} takes one point condition", node)
            point = self.criterion(args[0])
            kind = _POINT_QUANTITIES.get(word) or _RECORDED[word]
            return kind(point)
        if node.data in ("word", "call") and word not in _ATOMS:
            raise self.fail(self._unknown_atom(word), node)
        raise self.fail(f"{self.source(node)} is not a number and cannot be compared", node)

    def number(self, node: Any) -> tuple[float, str]:
        if node.data == "group":
            return self.number(node.children[0])
        if node.data != "number":
            raise self.fail("expected a number, for example 2 or 550 nm", node)
        unit = str(node.children[1].children[0]) if len(node.children) > 1 else ""
        if unit and unit not in self.units:
            raise self.fail(f"unknown unit {unit!r}; units are {unit_words()}", node)
        value = float(node.children[0])
        if value in (float("inf"), float("-inf")):
            raise self.fail("the number is too large", node)
        return value, unit

    def call(self, node: Any) -> c.Criterion:
        word, args = str(node.children[0]), node.children[1:]
        if word in ("source", "medium"):
            names = tuple(self.string(arg, word) for arg in args)
            return c.Source(names) if word == "source" else c.Medium(names)
        if word == "hit":
            return self.hit(args)
        if word == "event":
            return c.EventAt(tuple(self.event_set(arg) for arg in args))
        if word == "all":
            return c.All(tuple(self.point_or_event(arg) for arg in args))
        if word in ("detected", "crossed"):
            return self.detected(word, args)
        if word == "last":
            if len(args) != 1:
                raise self.fail("last takes one point condition", node)
            return c.Last(self.point_or_event(args[0]))
        if word == "path":
            return self.path(node, args)
        if word in _POINT_QUANTITIES or word in _RECORDED:
            raise self.fail(
                f"{word}(...) is a number: compare it, for example {word}(...) >= 2", node
            )
        if word in ("rect", "ellipse"):
            raise self.fail(f'{word} stands inside detected("name", {word}(...))', node)
        if word in FAMILIES:
            raise self.fail(f"{word} is an event word: write event({word})", node)
        raise self.fail(self._unknown_atom(word), node)

    def string(self, node: Any, where: str) -> str:
        if node.data != "string":
            raise self.fail(f'{where} takes names in quotes, as in {where}("name")', node)
        return str(node.children[0])[1:-1]

    def event_set(self, node: Any) -> c.EventSet:
        if node.data == "word":
            return self.event_word(node)
        if node.data == "call" and str(node.children[0]) == "all":
            words = [word for child in node.children[1:] for word in self.event_word(child)]
            if words:
                return tuple(words)
        raise self.fail("expected an event word, such as reflected, or all(reflected, tir)", node)

    def event_word(self, node: Any) -> c.EventSet:
        if node.data != "word":
            raise self.fail("expected an event word, such as reflected", node)
        word = str(node.children[0])
        if word not in FAMILIES:
            near = nearest_names(word, FAMILIES) or list(FAMILIES)[:8]
            raise self.fail(
                f"no event is called {word!r}; nearest: {', '.join(near)}; "
                f'names of things stand in quotes: "{word}"',
                node,
            )
        return (word,)

    def point_or_event(self, node: Any) -> c.Criterion:
        if node.data == "word" and str(node.children[0]) in FAMILIES:
            return c.EventAt((self.event_word(node),))
        return self.criterion(node)

    def hit(self, args: list[Any]) -> c.Criterion:
        names: list[str] = []
        tests: list[c.SurfaceTest] = []
        events: list[c.EventSet] = []
        for arg in args:
            if arg.data == "string":
                names.append(self.string(arg, "hit"))
            elif arg.data == "comparison":
                tests.append(self.surface_test(arg))
            else:
                events.append(self.event_set(arg))
        return c.Hit(tuple(names), tuple(tests), tuple(events))

    def surface_test(self, node: Any) -> c.SurfaceTest:
        left, token, right = node.children
        operator = _ASCII.get(str(token), str(token))
        if left.data == "number":
            left, right, operator = right, left, _MIRRORED[operator]
        if left.data != "word":
            raise self.fail("expected a surface parameter, as in hit(roughness > 0.2)", left)
        number, unit = self.number(right)
        if unit:
            raise self.fail("surface parameters are compared with plain numbers", right)
        return c.SurfaceTest(str(left.children[0]), operator, number)

    def detected(self, word: str, args: list[Any]) -> c.Criterion:
        names: list[str] = []
        regions: list[c.Region] = []
        for arg in args:
            if arg.data == "call" and str(arg.children[0]) in ("rect", "ellipse"):
                regions.append(self.region(arg))
            else:
                names.append(self.string(arg, word))
        kind = c.Detected if word == "detected" else c.Crossed
        return kind(tuple(names), tuple(regions))

    def region(self, node: Any) -> c.Region:
        shape = str(node.children[0])
        measures = [self.number(arg) for arg in node.children[1:]]
        if len(measures) != 4:
            raise self.fail(f"{shape} takes four numbers, found {len(measures)}", node)
        units = {unit for _, unit in measures}
        if len(units) > 1:
            raise self.fail("give all four numbers in one unit, or all in cells", node)
        numbers = tuple(number for number, _ in measures)
        try:
            return c.Region(shape, numbers, units.pop())  # type: ignore[arg-type]
        except CriterionError as error:
            raise self.fail(str(error), node) from None

    def path(self, node: Any, args: list[Any]) -> c.Criterion:
        exact = len(args) == 2 and args[1].data == "word" and str(args[1].children[0]) == "exact"
        if not args or len(args) > 1 + exact:
            raise self.fail('path takes one expression in quotes, as in path("lamp .* @eye")', node)
        text = self.string(args[0], "path")
        return c.Path(text, exact)
