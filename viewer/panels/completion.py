"""What can stand at the cursor of a criterion: words of the language and names of the map."""

from __future__ import annotations

import re
import string
from dataclasses import dataclass

from raymap.model.directory import Directory
from raymap.model.events import FAMILIES

__all__ = ["Completion", "complete"]

_FUNCTIONS = {
    "hit": "met an object or face",
    "detected": "registered by a detector",
    "crossed": "passed through a detector",
    "source": "emitted by",
    "event": "happened anywhere",
    "medium": "travelled in",
    "last": "the ray ended there",
    "count": "number of points",
    "path": "itinerary",
    "incidence": "angle of incidence",
}
_QUANTITIES = {
    "wavelength": "of the last segment",
    "length": "of the ray",
    "optical_length": "of the ray",
    "bounces": "points between start and end",
    "flux": "of the ray",
    "degree_of_polarisation": "of the last segment",
    "angle_of_polarisation": "of the last segment",
    "optical_path": "recorded",
}
_FAMILY_WORDS = ("reflected", "refracted", "transmitted", "scattered", "absorbed")
_LIMIT = 12


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
    function = _open_function(before[:start])
    if function in ("hit", "event", "count", "last"):
        found = _events(typed)
        if function == "event" or before[:start].rstrip().endswith(","):
            return start, found
        return start, [*_words(typed), *found][:_LIMIT]
    if not typed and before.rstrip()[-1:] not in (*"&|^!(,>~", ""):
        return start, []
    return start, _words(typed)


def _word_at_end(text: str, letters: str = string.ascii_letters + "_") -> str:
    """The letters with which a text ends."""
    return text[len(text.rstrip(letters)) :]


def _open_function(before: str) -> str:
    """Name of the innermost function whose bracket is still open."""
    plain = re.sub(r'"[^"]*"', lambda found: " " * len(found.group()), before)
    depth = 0
    for place in range(len(plain) - 1, -1, -1):
        if plain[place] == ")":
            depth += 1
        elif plain[place] == "(":
            if depth == 0:
                return _word_at_end(plain[:place].rstrip(), string.ascii_lowercase + "_")
            depth -= 1
    return ""


def _names(before: str, directory: Directory, *, closed: bool) -> tuple[int, list[Completion]]:
    """Names inside quotation marks."""
    start = before.rfind('"') + 1
    typed = before[start:].lower()
    function = _open_function(before[: start - 1])
    known: list[tuple[str, str]] = []
    if function == "source":
        known = [(entry.name, "source") for entry in directory.sources]
    elif function in ("detected", "crossed"):
        known = [(entry.name, "detector") for entry in directory.detectors]
    elif function == "medium":
        known = [(entry.name, "medium") for entry in directory.media]
    elif function == "hit":
        known = [(item.name, item.kind or "object") for item in directory.objects]
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
    """Functions and quantities."""
    found = []
    for name, kind in _FUNCTIONS.items():
        if name.startswith(typed):
            point = name in ("last", "count", "incidence", "event")
            insert = f"{name}()" if point else f'{name}("")'
            found.append(Completion(text=name, kind=kind, insert=insert, back=1 if point else 2))
    for name, kind in _QUANTITIES.items():
        if name.startswith(typed):
            found.append(Completion(text=name, kind=kind, insert=name))
    return found[:_LIMIT]


def _events(typed: str) -> list[Completion]:
    """Words of events, the families first."""
    words = [*_FAMILY_WORDS, *(word for word in FAMILIES if word not in _FAMILY_WORDS)]
    return [
        Completion(text=word, kind="events" if word in _FAMILY_WORDS else "event", insert=word)
        for word in words
        if word.startswith(typed)
    ][:_LIMIT]
