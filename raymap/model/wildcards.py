r"""Names with wildcards: ``*`` any characters, ``?`` one; matched without backtracking.

Patterns of scene files know classes as the shell does, too: ``[34]``, ``[a-f]``, ``[!0-9]``.

A pattern is a row of pieces between stars. The first piece begins the name, the last one ends it,
and each other one is found at the earliest place after the one before: taking it later could not
make the rest fit better. So no place is tried twice for the sake of another piece, and a pattern
of many stars costs as much as one of few.
"""

from __future__ import annotations

from collections.abc import Iterator

__all__ = ["Wildcard", "characters"]


class _Class:
    """One character of a class in brackets."""

    def __init__(self, inside: str) -> None:
        self.negated = inside.startswith("!")
        rest = inside[self.negated :]
        ranges = []
        while rest:
            wide = len(rest) > 2 and rest[1] == "-"
            ranges.append((rest[0], rest[2] if wide else rest[0]))
            rest = rest[3 if wide else 1 :]
        self.ranges = tuple(ranges)

    def holds(self, character: str) -> bool:
        return any(low <= character <= high for low, high in self.ranges) != self.negated


_Element = str | _Class | None
_Piece = tuple[_Element, ...]


def characters(pattern: str) -> Iterator[tuple[str, bool]]:
    """Characters of a pattern with a flag: was it escaped by a backslash?"""
    index = 0
    while index < len(pattern):
        if pattern[index] == "\\" and index + 1 < len(pattern):
            yield pattern[index + 1], True
            index += 2
        else:
            yield pattern[index], False
            index += 1


class Wildcard:
    """A pattern that whole names match; case counts.

    Parameters
    ----------
    escapes : a backslash takes the meaning from the character behind it, and brackets are
        characters of names; without, brackets enclose a class and a backslash is a character
    """

    def __init__(self, pattern: str, *, escapes: bool = True) -> None:
        pieces: list[list[_Element]] = [[]]
        for element in _escaped(pattern) if escapes else _of_the_shell(pattern):
            if element is _STARS:
                pieces.append([])
            else:
                pieces[-1].append(element)
        self._first, *rest = (tuple(piece) for piece in pieces)
        self._last: _Piece | None = rest.pop() if rest else None
        self._between = [_Finder(piece) for piece in rest if piece]

    def matches(self, name: str) -> bool:
        """Whether the pattern stands for the whole name."""
        if not _fits(self._first, name, 0):
            return False
        index = len(self._first)
        if self._last is None:
            return index == len(name)
        end = len(name) - len(self._last)
        for finder in self._between:
            found = finder.find(name, index)
            if found < 0:
                return False
            index = found + finder.length
        return index <= end and _fits(self._last, name, end)


class _Finder:
    """Finds a piece between two stars."""

    def __init__(self, piece: _Piece) -> None:
        self.length = len(piece)
        self._piece = piece
        self._text = "".join(c for c in piece if isinstance(c, str))
        self._literal = len(self._text) == len(piece)

    def find(self, name: str, start: int) -> int:
        """The earliest place from ``start`` on, -1 none."""
        if self._literal:
            return name.find(self._text, start)
        places = range(start, len(name) - self.length + 1)
        return next((index for index in places if _fits(self._piece, name, index)), -1)


def _fits(piece: _Piece, name: str, index: int) -> bool:
    if index < 0 or index + len(piece) > len(name):
        return False
    return all(_is(element, name[index + k]) for k, element in enumerate(piece))


def _is(element: _Element, character: str) -> bool:
    if isinstance(element, _Class):
        return element.holds(character)
    return element is None or element == character


_STARS = _Class("")


def _escaped(pattern: str) -> Iterator[_Element]:
    for character, escaped in characters(pattern):
        yield character if escaped else {"*": _STARS, "?": None}.get(character, character)


def _of_the_shell(pattern: str) -> Iterator[_Element]:
    index = 0
    while index < len(pattern):
        character = pattern[index]
        # A bracket right behind the opening one, or behind "!", stands for itself
        first = index + (3 if pattern.startswith("[!", index) else 2)
        end = pattern.find("]", first) if character == "[" else -1
        if end > 0:
            yield _Class(pattern[index + 1 : end])
            index = end
        else:
            yield {"*": _STARS, "?": None}.get(character, character)
        index += 1
