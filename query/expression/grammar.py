"""Text to tree: the criteria language, parsed with a grammar and never evaluated as Python."""

from __future__ import annotations

from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from query.expression.atom import Compare, Quantity
from query.expression.criterion import And, Criterion, Not, Or, Then, Xor
from query.expression.names import nearest_names
from query.expression.registry import ATOMS
from query.expression.units import known_units, unit_words
from query.expression.words import EventSet
from raymap.model.errors import CriterionError
from raymap.model.events import FAMILIES

if TYPE_CHECKING:
    from lark import Lark, Token, Tree

__all__ = ["mark", "parse"]

MAX_LENGTH = 1_000_000
MAX_DEPTH = 200

_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
_ASCII = {"≠": "!=", "≤": "<=", "≥": ">="}
_JOINED = {"disjunction": Or, "exclusion": Xor, "conjunction": And, "sequence": Then}
_INSIDE = ("rect", "ellipse")


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


def parse(text: str) -> Criterion:
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
        index = error.pos_in_stream or 0
        what = (
            "a quotation mark is never closed"
            if text[index] == '"'
            else (f"unexpected {text[index]!r}")
        )
        raise _fail(what, text, index, index + 1) from None
    except UnexpectedEOF:
        raise _fail("the criterion ends too early", text, len(text), len(text)) from None
    except UnexpectedToken as error:
        if error.token.type == "$END":
            raise _fail("the criterion ends too early", text, len(text), len(text)) from None
        index = error.token.start_pos or 0
        raise _fail(
            f"unexpected {str(error.token)!r}", text, index, index + len(error.token)
        ) from None
    return _Builder(text).criterion(tree)


def _check_brackets(text: str) -> None:
    """Name the bracket that is open, and bound the nesting before anything recurses over it."""
    open_places: list[int] = []
    quoted = escaped = False
    for index, character in enumerate(text):
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
            open_places.append(index)
            if len(open_places) > MAX_DEPTH:
                raise _fail(f"brackets nest deeper than {MAX_DEPTH}", text, index, index + 1)
        elif character == ")":
            if not open_places:
                raise _fail("this bracket closes nothing", text, index, index + 1)
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

    def criterion(self, node: Any) -> Criterion:
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

    def _criterion(self, node: Any) -> Criterion:
        kind = node.data
        if kind == "group":
            return self.criterion(node.children[0])
        if kind == "negation":
            return Not(self.criterion(node.children[-1]))
        if kind in _JOINED:
            return _JOINED[kind](tuple(self.criterion(child) for child in node.children))
        if kind == "comparison":
            return self.comparison(node)
        if kind in ("call", "word"):
            return self.atom(node)
        shown = self.source(node)
        raise self.fail(
            f"{shown} is not a criterion; names stand in brackets, as in hit({shown})", node
        )

    def atom(self, node: Any) -> Criterion:
        """A condition: a word alone, or with brackets."""
        word, called = str(node.children[0]), node.data == "call"
        kind = ATOMS.get(word)
        if kind is None:
            if word in FAMILIES:
                raise self.fail(f"{word} is an event word: write event({word})", node)
            if called and word in _INSIDE:
                raise self.fail(f'{word} stands inside detected("name", {word}(...))', node)
            raise self.fail(self._unknown_atom(word), node)
        if issubclass(kind, Quantity):
            shown, example = (f"{word}(...)", "(...) >= 2") if called else (word, " > 1")
            raise self.fail(f"{shown} is a number: compare it, for example {word}{example}", node)
        if not called and not kind.stands_alone():
            opening, _ = kind.opening()
            raise self.fail(f"{word} takes something in brackets: {opening}", node)
        found: Criterion = kind.read_call(self, node, node.children[1:])
        return found

    def _unknown_atom(self, word: str) -> str:
        near = nearest_names(word, ATOMS)
        if near:
            return f"unknown word {word!r}; did you mean {' or '.join(near)}?"
        return f"unknown word {word!r}; atoms: {', '.join(atom.word for atom in ATOMS.kinds())}"

    def sides(self, node: Any) -> tuple[Any, str, Any]:
        """Left side, operator and right side of a comparison, the number on the right."""
        left, token, right = node.children
        operator = _ASCII.get(str(token), str(token))
        return (
            (right, _MIRRORED[operator], left) if left.data == "number" else (left, operator, right)
        )

    def comparison(self, node: Any) -> Criterion:
        left, operator, right = self.sides(node)
        quantity = self.quantity(left)
        number, unit = self.number(right)
        return Compare(quantity, operator, number, unit)

    def quantity(self, node: Any) -> Quantity:
        if node.data == "group":
            return self.quantity(node.children[0])
        word = str(node.children[0]) if node.data in ("word", "call") else ""
        kind = ATOMS.get(word)
        if word and kind is None:
            raise self.fail(self._unknown_atom(word), node)
        called = node.data == "call"
        if kind is None or not issubclass(kind, Quantity) or not (called or kind.stands_alone()):
            raise self.fail(f"{self.source(node)} is not a number and cannot be compared", node)
        found: Quantity = kind.read_call(self, node, node.children[1:] if called else [])
        return found

    def number(self, node: Any) -> tuple[float, str]:
        if node.data == "group":
            return self.number(node.children[0])
        if node.data != "number":
            raise self.fail("expected a number, for example 2 or 550 nm", node)
        unit = str(node.children[1].children[0]) if len(node.children) > 1 else ""
        if unit and unit not in self.units:
            near = get_close_matches(unit, self.units, n=1, cutoff=0.5)
            hint = f"nearest: {near[0]}; " if near else ""
            raise self.fail(f"unknown unit {unit!r}; {hint}units are {unit_words()}", node)
        value = float(node.children[0])
        if value in (float("inf"), float("-inf")):
            raise self.fail("the number is too large", node)
        return value, unit

    def string(self, node: Any, where: str) -> str:
        if node.data != "string":
            raise self.fail(f'{where} takes names in quotes, as in {where}("name")', node)
        return str(node.children[0])[1:-1]

    def event_set(self, node: Any) -> EventSet:
        if node.data == "word":
            return self.event_word(node)
        if node.data == "call" and str(node.children[0]) == "all":
            words = [word for child in node.children[1:] for word in self.event_word(child)]
            if words:
                return tuple(words)
        raise self.fail("expected an event word, such as reflected, or all(reflected, tir)", node)

    def event_word(self, node: Any) -> EventSet:
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

    def point_or_event(self, node: Any) -> Criterion:
        if node.data == "word" and str(node.children[0]) in FAMILIES:
            found: Criterion = ATOMS["event"](events=(self.event_word(node),))
            return found
        return self.criterion(node)
