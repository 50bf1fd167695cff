"""What can stand at the cursor of a criterion: words of the language and names of the map."""

from __future__ import annotations

import re
import string
from dataclasses import dataclass
from typing import Any

from query.expression.arguments import Events, Names, Point, Points
from query.expression.registry import ATOMS
from raymap.model.directory import Directory
from raymap.model.events import FAMILIES

__all__ = ["Completion", "complete"]

_FAMILY_WORDS = ("reflected", "refracted", "transmitted", "scattered", "absorbed")
_LIMIT = 14


@dataclass(frozen=True, kw_only=True)
class Completion:
    """One proposal.

    Attributes
    ----------
    text : shown
    kind : what it is, shown beside
    insert : replaces what stands before the cursor from ``start`` on
    back : the cursor goes this many characters back from the end of it
    """

    text: str
    kind: str
    insert: str
    back: int = 0


def complete(text: str, cursor: int, directory: Directory) -> tuple[int, list[Completion]]:
    """Proposals for a place in a criterion.

    Returns
    -------
    start, completions : what stands from ``start`` to the cursor is replaced
    """
    before = text[:cursor]
    if before.count('"') % 2:
        return _names(before, directory, closed=text[cursor:].startswith('"'))
    typed = _word_at_end(before)
    start = cursor - len(typed)
    arguments = _arguments(_open_function(before[:start]))
    if any(isinstance(argument, Events | Point | Points) for argument in arguments):
        found = _events(typed)
        only_events = all(isinstance(argument, Events) for argument in arguments)
        if only_events or before[:start].rstrip().endswith(","):
            return start, found
        return start, [*_words(typed), *found][:_LIMIT]
    if not typed and before.rstrip()[-1:] not in (*"&|^!(,>~", ""):
        return start, []
    return start, _words(typed)


def _arguments(word: str) -> tuple[Any, ...]:
    """What stands in the brackets of an atom."""
    kind = ATOMS.get(word)
    return () if kind is None else kind.arguments


def _word_at_end(text: str, letters: str = string.ascii_letters + "_") -> str:
    """The letters with which a text ends."""
    return text[len(text.rstrip(letters)) :]


def _open_function(before: str) -> str:
    """Name of the innermost function whose bracket is still open."""
    plain = re.sub(r'"[^"]*"', lambda found: " " * len(found.group()), before)
    depth = 0
    for index in range(len(plain) - 1, -1, -1):
        if plain[index] == ")":
            depth += 1
        elif plain[index] == "(":
            if depth == 0:
                return _word_at_end(plain[:index].rstrip(), string.ascii_lowercase + "_")
            depth -= 1
    return ""


def _names(before: str, directory: Directory, *, closed: bool) -> tuple[int, list[Completion]]:
    """Names inside quotation marks."""
    start = before.rfind('"') + 1
    typed = before[start:].lower()
    function = _open_function(before[: start - 1])
    asked = {argument.of for argument in _arguments(function) if isinstance(argument, Names)}
    known: list[tuple[str, str]] = []
    if "source" in asked:
        known += [(entry.name, "source") for entry in directory.sources]
    if "detector" in asked:
        known += [(entry.name, "detector") for entry in directory.detectors]
    if "medium" in asked:
        known += [(entry.name, "medium") for entry in directory.media]
    if "place" in asked:
        known += [(item.name, item.kind or "object") for item in directory.objects]
        known += [(name, "face") for name in directory.faces.names]
    first = [pair for pair in known if pair[0].lower().startswith(typed)]
    inside = [pair for pair in known if typed in pair[0].lower() and pair not in first]
    end = "" if closed else '"'
    return start, [
        Completion(text=name, kind=kind, insert=name.replace('"', '\\"') + end)
        for name, kind in (first + inside)[:_LIMIT]
        if not (name.lower() == typed and closed)
    ]


def _words(typed: str) -> list[Completion]:
    """Atoms of the language."""
    found = []
    for atom in ATOMS.kinds():
        if atom.word.startswith(typed):
            insert, back = atom.opening()
            found.append(Completion(text=atom.word, kind=atom.title, insert=insert, back=back))
    return found[:_LIMIT]


def _events(typed: str) -> list[Completion]:
    """Words of events, the families first."""
    words = [*_FAMILY_WORDS, *(word for word in FAMILIES if word not in _FAMILY_WORDS)]
    return [
        Completion(text=word, kind="events" if word in _FAMILY_WORDS else "event", insert=word)
        for word in words
        if word.startswith(typed)
    ][:_LIMIT]
