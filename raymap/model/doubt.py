"""Numbers that are too uncertain to be relied on, and how every answer marks them.

A number stands beside its standard error: ``flux`` beside ``flux_se`` in rows of plain values,
"1.2 ± 0.1" in text. What is less sure than 30 % is marked there by "?", here by its name.
"""

from __future__ import annotations

import math
from typing import Any

__all__ = ["DOUBTFUL", "FOOTNOTE", "MARK", "is_doubtful", "marked", "with_doubts", "with_error"]

DOUBTFUL = 0.3
"""Relative standard error above which a number is marked."""
MARK = "?"
FOOTNOTE = f"{MARK} standard error above 30 %: record more rays to rely on it"


def is_doubtful(value: float | None, se: float | None) -> bool:
    """Whether a number is less sure than 30 %; nothing seen, with no error, says nothing of it."""
    if value is None or se is None:
        return False
    # What is not finite is no number to rely on
    return not se <= DOUBTFUL * abs(value) < math.inf


def marked(text: str, value: float | None, se: float | None) -> str:
    """The text, with the mark behind it where the number is doubtful."""
    return f"{text} {MARK}" if is_doubtful(value, se) else text


def with_error(value: float, se: float, unit: str = "") -> str:
    """A number with its standard error; marked where that is above 30 %."""
    if value and se <= 1e-7 * abs(value) < math.inf:
        # All of the light was met: only the rounding of sums is left
        return f"{value:.6g}{unit}"
    # As many digits as the error has, and one more
    digits = 2 + _tens(value) - _tens(se) if se > 0.0 and value else 4
    shown = f"{value:.{max(1, min(digits, 6))}g}{unit} ± {se:.2g}{unit}"
    return marked(shown, value, se)


def with_doubts(row: dict[str, Any]) -> dict[str, Any]:
    """A row of plain values and, as ``doubtful``, the names of its numbers that are marked.

    A number that has an error stands beside it: ``flux`` and ``flux_se``, either a number or a
    dictionary of numbers with equal keys, which are then named.
    """
    names = []
    for name in row:
        value, se = row[name], row.get(f"{name}_se")
        if isinstance(value, dict) and isinstance(se, dict):
            names += [key for key in se if is_doubtful(value.get(key), se[key])]
        elif isinstance(se, int | float) and is_doubtful(value, se):
            names.append(name)
    return row | {"doubtful": names}


def _tens(number: float) -> int:
    if not math.isfinite(number) or not number:
        return 0
    return math.floor(math.log10(abs(number)))
