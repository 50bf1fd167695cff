"""JSON texts of a map: nothing in them that a reader in another language would take otherwise.

Numbers that JSON cannot hold exactly everywhere are written as text: integers beyond ±(2⁵³ − 1) as
their decimal digits, and ``"NaN"``, ``"Infinity"``, ``"-Infinity"``.
"""

from __future__ import annotations

import json
import math
from typing import Any

from pydantic import BaseModel

from raymap.model.errors import FormatError, LimitExceeded
from raymap.model.giventext import json_value
from raymap.model.limits import MAX_JSON

__all__ = ["parse_json", "plain", "whole_number", "write_json"]

_EXACT = 2**53 - 1

_DEEPEST = 128
"""Levels of lists and objects in a text of a map; what writes them again has limits of its own."""


def write_json(value: Any, what: str) -> bytes:
    """The text of values that JSON knows.

    Parameters
    ----------
    what : names the text in errors

    Raises
    ------
    LimitExceeded
        It is too long, nested too deeply, or holds what JSON does not know.
    """
    try:
        try:
            text = _dumped(value)
            json.loads(text, parse_int=_exactly)
        except (TypeError, ValueError):
            text = _dumped(plain(value))
            # What is nested too deeply to be parsed would make a map that nobody opens
            json.loads(text)
        data = text.encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise LimitExceeded(f"{what} cannot be written as JSON: {error}") from None
    if len(data) > MAX_JSON:
        raise LimitExceeded(f"{what} takes {len(data)} bytes as JSON, at most {MAX_JSON} are read")
    return data


def _dumped(value: Any) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=False)


def _exactly(digits: str) -> int:
    number = int(digits)
    if abs(number) > _EXACT:
        raise ValueError(f"{digits} is not exact everywhere")
    return number


def parse_json(data: bytes, kind: type, what: str) -> Any:
    """The value of a text, which must be of a kind.

    Raises
    ------
    FormatError
    """
    try:
        value = json_value(data)
    except ValueError as error:
        raise FormatError(f"{what} holds no sound JSON: {error}") from None
    if not isinstance(value, kind):
        raise FormatError(f"{what} holds no JSON {'object' if kind is dict else 'array'}")
    if data.count(b"[") + data.count(b"{") > _DEEPEST and _nests(value, _DEEPEST):
        raise FormatError(f"{what} nests deeper than {_DEEPEST} levels")
    return value


def _nests(value: Any, most: int) -> bool:
    """Whether lists and objects stand within each other deeper than so many levels."""
    level = [value]
    for _ in range(most):
        level = [
            inner
            for each in level
            for inner in (each.values() if isinstance(each, dict) else each)
            if isinstance(inner, dict | list)
        ]
        if not level:
            return False
    return True


def plain(value: Any) -> Any:
    """A value with text for numbers that JSON does not hold exactly."""
    if isinstance(value, float):
        if math.isfinite(value):
            return float(value)
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, int) and not isinstance(value, bool):
        return int(value) if -_EXACT <= value <= _EXACT else str(int(value))
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, BaseModel):
        return plain(value.model_dump(exclude_defaults=True))
    if hasattr(value, "tolist"):
        # Arrays and numbers of numpy
        return plain(value.tolist())
    return value


def whole_number(value: Any) -> Any:
    """An integer that may have been written as text; whatever is none stays as it is."""
    if isinstance(value, str) and value.removeprefix("-").isdecimal() and len(value) < 40:
        return int(value)
    return value
