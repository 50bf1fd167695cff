"""Readers of values that a page sends: each takes what fits, and refuses the rest in a word."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

__all__ = ["Reader", "Refused", "choice", "flag", "maybe", "number", "text", "whole"]


class Refused(ValueError):
    """A value that a page may not send."""


Reader = Callable[[Any], Any]


def flag(value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise Refused("true or false")
    return value


def choice(*options: Any) -> Reader:
    """One of some values."""

    def read(value: Any) -> Any:
        # 1 is no true, and 0 no false
        if not any(type(value) is type(option) and value == option for option in options):
            raise Refused("one of " + ", ".join(map(str, options)))
        return value

    return read


def number(least: float, most: float) -> Reader:
    """A number within bounds."""

    def read(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise Refused(f"a number from {least:g} to {most:g}")
        if not least <= value <= most:
            raise Refused(f"a number from {least:g} to {most:g}")
        return value

    return read


def whole(most: int) -> Reader:
    """A whole number from 0; a field that was emptied is 0."""

    def read(value: Any) -> int:
        if value in ("", None):
            return 0
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
            raise Refused(f"a whole number from 0 to {most}")
        return value

    return read


def text(most: int, pattern: str = ".*") -> Reader:
    """A text of bounded length, as a regular expression says."""
    fits = re.compile(pattern, re.S).fullmatch

    def read(value: Any) -> str:
        if not isinstance(value, str) or len(value) > most or not fits(value):
            raise Refused(f"a text of at most {most} characters")
        return value

    return read


def maybe(read_some: Reader) -> Reader:
    """Nothing, or a value."""
    return lambda value: None if value is None else read_some(value)
