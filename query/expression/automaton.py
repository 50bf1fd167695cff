"""Path expressions: regular expressions over the itinerary of a ray, as position automata.

The itinerary is the source, then each point, with the registrations of detectors in between. The
expression is parsed into a tree, numbered element by element, and turned into the position
automaton of Glushkov (V. M. Glushkov, "The abstract theory of automata", Russian Mathematical
Surveys 16, 1961): one state per element, no empty moves, no compilation.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache

from query.expression.names import nearest_names
from raymap.model.errors import CriterionError
from raymap.model.events import FAMILIES

__all__ = ["Automaton", "Element", "canonical_path", "parse_path"]

MAX_ELEMENTS = 4096
MAX_CHOICES = 512
"""Elements of an expression in which several can follow one; a point costs up to their square."""
MAX_NESTING = 100


@dataclass(frozen=True)
class Element:
    """One element of a path expression.

    Attributes
    ----------
    kind : "any" point, "place" or "detector"
    name : pattern; None for a point without object
    events : event words, any of which (exact: all of which) happened
    """

    kind: str
    name: str | None = None
    events: tuple[str, ...] = ()


@dataclass(frozen=True)
class Automaton:
    """Position automaton: state q is "element q was the last one used".

    Attributes
    ----------
    elements : one per state
    first, last : states in which a match can begin and end, as bit sets
    follow : per state the states that may come next, as bit sets
    """

    elements: tuple[Element, ...]
    first: int
    last: int
    follow: tuple[int, ...]


def canonical_path(text: str) -> str:
    """The one spelling of a path expression: quotation marks without backslash."""
    if re.search(r"(?<!\\)(\\\\)*\\$", text):
        raise CriterionError("the path expression ends with a lone backslash")
    return re.sub(
        r"\\.", lambda pair: '"' if pair.group(0) == '\\"' else pair.group(0), text, flags=re.DOTALL
    )


_TOKEN = re.compile(
    r"""(?P<space>\s+)|(?P<open>\()|(?P<close>\))|(?P<bar>\|)
      | (?P<detector>@(?:\\.|[^\s()|@:\\])+)
      | (?P<any>\.(?=[\s()|*+?{]|$))
      | (?P<place>(?:\\.|[^\s()|@{}+.:\\])(?:\\.|[^\s()|@{}+:\\])*(?::[A-Za-z_,]+)?|:[A-Za-z_,]*)
      """,
    flags=re.VERBOSE | re.DOTALL,
)
_QUANTIFIER = re.compile(r"[*+?]|\{(\d+)(?:(,)(\d*))?\}")

_LONGEST_REPETITION = 20
"""Characters of a repetition; paths have no more points than 9 digits say."""


@dataclass
class _Glushkov:
    """A part of the expression: can it be empty, where does it begin and end."""

    nullable: bool = True
    first: int = 0
    last: int = 0


@dataclass
class _PathParser:
    """Recursive descent; builds the automaton while it reads."""

    text: str
    place: int = 0
    depth: int = 0
    elements: list[Element] = field(default_factory=list)
    follow: list[int] = field(default_factory=list)

    def fail(self, message: str, index: int | None = None) -> CriterionError:
        start = self.place if index is None else index
        around = self.text[max(0, start - 20) : start] + "⟨here⟩" + self.text[start : start + 20]
        return CriterionError(f"path expression: {message} at {around!r}")

    def alternatives(self) -> _Glushkov:
        self.depth += 1
        if self.depth > MAX_NESTING:
            raise self.fail(f"brackets nest deeper than {MAX_NESTING}")
        result = self.sequence()
        while self.text.startswith("|", self.place):
            self.place += 1
            other = self.sequence()
            result = _Glushkov(
                result.nullable or other.nullable,
                result.first | other.first,
                result.last | other.last,
            )
        self.depth -= 1
        return result

    def sequence(self) -> _Glushkov:
        result = _Glushkov()
        separated = True
        while self.place < len(self.text):
            match = _TOKEN.match(self.text, self.place)
            if match is None:
                raise self.fail("cannot read this")
            if match.lastgroup in ("close", "bar"):
                break
            if match.lastgroup == "space":
                self.place = match.end()
                separated = True
                continue
            if not separated:
                raise self.fail("elements are separated by spaces")
            result = self.join(result, self.item(match))
            separated = False
        return result

    def item(self, match: re.Match[str]) -> _Glushkov:
        """An element or a bracket, with its quantifier."""
        start, n_before = self.place, len(self.elements)
        self.place = match.end()
        if match.lastgroup == "open":
            part = self.alternatives()
            if not self.text.startswith(")", self.place):
                raise self.fail("a bracket is never closed", start)
            self.place += 1
        else:
            part = self.element(match)
        quantifier = _QUANTIFIER.match(self.text, self.place)
        if quantifier is None:
            return part
        if match.lastgroup not in ("open", "any"):
            raise self.fail("quantifiers stand after ) or . only; put the element in brackets")
        self.place = quantifier.end()
        return self.repeat(part, n_before, quantifier)

    def element(self, match: re.Match[str]) -> _Glushkov:
        token = match.group(0)
        if match.lastgroup == "any":
            return self.add(Element("any"))
        if match.lastgroup == "detector":
            return self.add(Element("detector", token[1:]))
        name, _, words = _split_events(token)
        events = tuple(word for word in words.split(",") if word) if words else ()
        for word in events:
            if word not in FAMILIES:
                near = nearest_names(word, FAMILIES) or list(FAMILIES)[:6]
                raise self.fail(
                    f"no event is called {word!r}; nearest: {', '.join(near)}", match.start()
                )
        return self.add(Element("place", name or None, events))

    def add(self, element: Element) -> _Glushkov:
        if len(self.elements) >= MAX_ELEMENTS:
            raise self.fail(f"more than {MAX_ELEMENTS} elements once repetitions are written out")
        state = 1 << len(self.elements)
        self.elements.append(element)
        self.follow.append(0)
        return _Glushkov(False, state, state)

    def link(self, sources: int, targets: int) -> None:
        while sources:
            low = sources & -sources
            self.follow[low.bit_length() - 1] |= targets
            sources ^= low

    def join(self, left: _Glushkov, right: _Glushkov) -> _Glushkov:
        self.link(left.last, right.first)
        return _Glushkov(
            left.nullable and right.nullable,
            left.first | (right.first if left.nullable else 0),
            right.last | (left.last if right.nullable else 0),
        )

    def copy(self, part: _Glushkov, begin: int, end: int) -> _Glushkov:
        """The same part once more, with states of its own."""
        shift = len(self.elements) - begin
        for state in range(begin, end):
            self.add(self.elements[state])
            self.follow[-1] = self.follow[state] << shift
        return _Glushkov(part.nullable, part.first << shift, part.last << shift)

    def repeat(self, part: _Glushkov, begin: int, quantifier: re.Match[str]) -> _Glushkov:
        symbol = quantifier.group(0)
        if symbol in ("*", "+"):
            self.link(part.last, part.first)
            return _Glushkov(part.nullable or symbol == "*", part.first, part.last)
        if symbol == "?":
            return _Glushkov(True, part.first, part.last)
        if len(symbol) > _LONGEST_REPETITION:
            raise self.fail(f"the repetition {symbol[:20]}… is too large")
        least = int(quantifier.group(1))
        open_end = quantifier.group(2) is not None and not quantifier.group(3)
        most = least if quantifier.group(2) is None else int(quantifier.group(3) or least)
        if most < least or (most == 0 and not open_end):
            raise self.fail(f"the repetition {symbol} can never happen")
        if max(most, 1) * max(1, len(self.elements) - begin) > MAX_ELEMENTS:
            raise self.fail(f"more than {MAX_ELEMENTS} elements once repetitions are written out")
        # Write the repetition out: least copies, then optional ones or a loop on the last.
        end = len(self.elements)
        copies = [part] + [self.copy(part, begin, end) for _ in range(max(most, 1) - 1)]
        if open_end:
            self.link(copies[-1].last, copies[-1].first)
        result = _Glushkov()
        for number, piece in enumerate(copies):
            optional = number >= least
            result = self.join(
                result, _Glushkov(piece.nullable or optional, piece.first, piece.last)
            )
        return result


def _split_events(token: str) -> tuple[str, str, str]:
    """Split ``name:event,event`` at the last ``:`` that is not escaped."""
    match = re.fullmatch(r"((?:\\.|[^:\\])*):([A-Za-z_,]*)", token, flags=re.DOTALL)
    return (match.group(1), ":", match.group(2)) if match else (token, "", "")


@lru_cache(maxsize=256)
def parse_path(text: str) -> Automaton:
    """Read a path expression.

    Raises
    ------
    CriterionError
        with the place.
    """
    parser = _PathParser(text)
    whole = parser.alternatives()
    if parser.place < len(text):
        raise parser.fail("this bracket closes nothing")
    if not parser.elements:
        raise CriterionError('the path expression is empty; write for example path("lamp .*")')
    several = any(states & (states - 1) for states in (whole.first, *parser.follow))
    if several and len(parser.elements) > MAX_CHOICES:
        raise CriterionError(
            f"the path expression has {len(parser.elements)} elements once repetitions are written "
            f"out; with alternatives or open repetitions it may have {MAX_CHOICES}"
        )
    return Automaton(tuple(parser.elements), whole.first, whole.last, tuple(parser.follow))
