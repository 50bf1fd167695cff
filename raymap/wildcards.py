r"""Names with wildcards: ``*`` any characters, ``?`` one; matched without backtracking.

A pattern is a row of pieces between stars. The first piece begins the name, the last one ends it,
and each other one is found at the earliest place after the one before: taking it later could not
make the rest fit better. So no place is tried twice for the sake of another piece, and a pattern
of many stars costs as much as one of few.
"""

from __future__ import annotations

from collections.abc import Iterator

__all__ = ["Wildcard", "characters"]

_Piece = tuple[str | None, ...]


def characters(pattern: str) -> Iterator[tuple[str, bool]]:
    """Characters of a pattern with a flag: was it escaped by a backslash?"""
    place = 0
    while place < len(pattern):
        if pattern[place] == "\\" and place + 1 < len(pattern):
            yield pattern[place + 1], True
            place += 2
        else:
            yield pattern[place], False
            place += 1


class Wildcard:
    """A pattern that whole names match; case counts.

    Parameters
    ----------
    escapes : a backslash takes the meaning from the character behind it
    """

    def __init__(self, pattern: str, *, escapes: bool = True) -> None:
        read = characters(pattern) if escapes else ((c, False) for c in pattern)
        pieces: list[list[str | None]] = [[]]
        for character, escaped in read:
            if character == "*" and not escaped:
                pieces.append([])
            else:
                pieces[-1].append(None if character == "?" and not escaped else character)
        self._first, *rest = (tuple(piece) for piece in pieces)
        self._last: _Piece | None = rest.pop() if rest else None
        self._between = [_Finder(piece) for piece in rest if piece]

    def matches(self, name: str) -> bool:
        """Whether the pattern stands for the whole name."""
        if not _fits(self._first, name, 0):
            return False
        place = len(self._first)
        if self._last is None:
            return place == len(name)
        end = len(name) - len(self._last)
        for finder in self._between:
            found = finder.find(name, place)
            if found < 0:
                return False
            place = found + finder.length
        return place <= end and _fits(self._last, name, end)


class _Finder:
    """Finds a piece between two stars."""

    def __init__(self, piece: _Piece) -> None:
        self.length = len(piece)
        self._piece = piece
        self._text = "".join(c for c in piece if c is not None)
        self._literal = len(self._text) == len(piece)

    def find(self, name: str, start: int) -> int:
        """The earliest place from ``start`` on, -1 none."""
        if self._literal:
            return name.find(self._text, start)
        places = range(start, len(name) - self.length + 1)
        return next((place for place in places if _fits(self._piece, name, place)), -1)


def _fits(piece: _Piece, name: str, place: int) -> bool:
    if place < 0 or place + len(piece) > len(name):
        return False
    return all(c is None or c == name[place + k] for k, c in enumerate(piece))
