"""The atoms of the criteria language: those of `query.atoms`, and those of other distributions."""

from __future__ import annotations

from typing import Any

from query.expression.atom import Atom
from raymap.model.registry import Registry

__all__ = ["ATOMS"]

ATOMS: Registry[Any] = Registry(
    "raymap.atoms",
    "query.atoms",
    words=lambda kind: (kind.word,),
    of=Atom,
    sort="words of criteria",
)
"""Every atom by its word."""
