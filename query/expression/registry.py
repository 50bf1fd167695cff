"""The atoms of the criteria language: those of `query.atoms`, and those of other distributions."""

from __future__ import annotations

from typing import Any

from query.expression.atom import Condition, Quantity
from raymap.registry import Registry

__all__ = ["ATOMS"]


def _fits(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Condition | Quantity) and bool(kind.word)


ATOMS: Registry[Any] = Registry(
    "atoms of criteria",
    package="query.atoms",
    constant="ATOM",
    group="raymap.atoms",
    fits=_fits,
)
"""Every atom by its word."""
