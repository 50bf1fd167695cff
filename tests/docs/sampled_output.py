"""Whether the output of a short run says what a page says of a long one.

Figures are compared as samples of the same light: counts are scaled by the rays recorded, and agree
within six standard errors of what the short run counts; ± grows with the root of that scale. On a
page `…` stands for anything.
"""

from __future__ import annotations

import math
import re

__all__ = ["says"]

TOKEN = re.compile(r"…|[-+]?\d(?:[\d,]*\d)?(?:\.\d+)?(?:e[-+]?\d+)?|±|[^\s\d…±]+")


def number(token: str) -> float | None:
    try:
        return float(token.replace(",", ""))
    except ValueError:
        return None


def says(expected: str, got: str, scale: float, rough: float = 0.0) -> bool:
    """Whether a line of output says what a line of a page says."""
    wanted: list[str] = TOKEN.findall(expected)
    found: list[str] = TOKEN.findall(got)
    counts = [int(t.replace(",", "")) for t in re.findall(r"(?<!\S)\d[\d,]*(?!\S)", got)]
    fewest = min([c for c in counts if c > 20], default=0)
    spread = 6.0 / math.sqrt(fewest) if fewest else rough

    def agree(i: int, j: int) -> bool:
        a, b = number(wanted[i]), number(found[j])
        if a is None or b is None:
            return wanted[i] == found[j]
        if math.isclose(a, b, rel_tol=1e-9):
            return True
        if j and found[j - 1] == "±":
            return 0.4 * a < b / math.sqrt(scale) < 2.5 * a
        error = number(found[j + 2]) if found[j + 1 : j + 2] == ["±"] else None
        if error is not None:
            return abs(a - b) <= 6.0 * error
        times = scale if re.fullmatch(r"\d[\d,]*", found[j]) else 1.0
        return abs(b * times - a) <= spread * abs(a) + (rough if a == 0.0 else 0.0)

    def match(i: int, j: int) -> bool:
        if i == len(wanted):
            return j == len(found) or (bool(wanted) and wanted[-1] == "…")
        if wanted[i] == "…":
            return any(match(i + 1, k) for k in range(j, len(found) + 1))
        return j < len(found) and agree(i, j) and match(i + 1, j + 1)

    return match(0, 0)
