"""Numbers that are too uncertain to be relied on, and how tables mark them."""

from __future__ import annotations

__all__ = ["DOUBTFUL", "FOOTNOTE", "MARK", "is_doubtful"]

DOUBTFUL = 0.3
"""Relative standard error above which a number is marked."""
MARK = "?"
FOOTNOTE = f"{MARK} standard error above 30 %: record more rays to rely on it"


def is_doubtful(value: float | None, se: float | None) -> bool:
    """Whether a number is less sure than 30 %; nothing seen, with no error, says nothing of it."""
    if value is None or se is None:
        return False
    return se > DOUBTFUL * abs(value)
