"""Pictures that nobody waits for any more: long work in pieces, with a look in between."""

from __future__ import annotations

from collections.abc import Callable, Iterator

__all__ = ["Cancel", "Interrupted", "pieces"]

Cancel = Callable[[], bool]
"""Becomes true when the picture is no longer wanted."""


class Interrupted(Exception):
    """A picture was given up."""


def pieces(count: int, size: int, cancel: Cancel | None) -> Iterator[slice]:
    """Slices of ``size`` of ``count`` things in their order; all at once where nobody may cancel.

    Raises
    ------
    Interrupted
        ``cancel`` says so before a piece.
    """
    step = max(count, 1) if cancel is None else size
    for first in range(0, count, step):
        if cancel is not None and cancel():
            raise Interrupted
        yield slice(first, min(first + step, count))
