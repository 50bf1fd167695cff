"""Three-valued logic on columns: what is certain, and what is possible.

A pair bounds an answer that is not known yet from both sides; where both sides are one array it is
exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from query.engine.surface_parameters import COMPARISONS

__all__ = ["Bools", "Pair", "apply", "combine", "exactly", "gather", "interval", "negate"]

Bools = NDArray[np.bool_]


class Pair(NamedTuple):
    """Kleene truth of many points or rays: true where certain, false where not possible."""

    certain: Bools
    possible: Bools

    @property
    def exact(self) -> bool:
        return self.certain is self.possible


def gather(pair: Pair, rows: NDArray[np.integer]) -> Pair:
    """An exact answer for rows of it."""
    certain = pair.certain[rows]
    return Pair(certain, certain)


def exactly(mask: Bools) -> Pair:
    """What is known on both sides."""
    return Pair(mask, mask)


def apply(pair: Pair, function: Callable[[Bools], Bools]) -> Pair:
    """Apply a monotone function to both sides."""
    certain = function(pair.certain)
    return Pair(certain, certain if pair.exact else function(pair.possible))


def negate(pair: Pair) -> Pair:
    """What is not possible is certain not to be."""
    certain = ~pair.possible
    return Pair(certain, certain if pair.exact else ~pair.certain)


def combine(operator: str, pairs: Sequence[Pair]) -> Pair:
    """``and``, ``or``, ``xor`` of all, or ``not`` of the one."""
    if operator == "not":
        return negate(pairs[0])
    result = pairs[0]
    for pair in pairs[1:]:
        exact = result.exact and pair.exact
        if operator == "xor" and not exact:
            result = Pair(
                (result.certain & ~pair.possible) | (pair.certain & ~result.possible),
                (result.possible & ~pair.certain) | (pair.possible & ~result.certain),
            )
            continue
        join = {"and": np.logical_and, "or": np.logical_or, "xor": np.logical_xor}[operator]
        certain = join(result.certain, pair.certain)
        result = Pair(certain, certain if exact else join(result.possible, pair.possible))
    return result


def interval(
    operator: str, least: NDArray[np.integer], most: NDArray[np.integer], value: float
) -> Pair:
    """Compare whole numbers known to lie in [least, most], all of which are possible."""
    if operator in ("==", "!="):
        whole = float(value).is_integer()
        possible = (least <= value) & (value <= most) & whole
        certain = possible & (least == most)
        equal = Pair(certain, possible)
        return equal if operator == "==" else negate(equal)
    compare = COMPARISONS[operator]
    low, high = compare(least, value), compare(most, value)
    return Pair(low & high, low | high)
