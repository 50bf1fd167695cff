"""Comparisons of whole numbers from 0 upward, such as counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from query.engine.bound import BoundCompare

__all__ = ["BoundWhole"]


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundWhole(BoundCompare):
    """A count compared with a number."""

    def never(self, map: Any) -> str | None:
        value = self.value
        impossible = (
            (self.operator == "==" and (value < 0 or not float(value).is_integer()))
            or (self.operator == "<" and value <= 0)
            or (self.operator == "<=" and value < 0)
        )
        return f"{self.text}: a count is a whole number from 0 upward" if impossible else None
