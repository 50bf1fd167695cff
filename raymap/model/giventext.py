"""TOML and JSON that a user, a client or a file gives: read, or refused in one line.

Both languages allow numbers of any length, and Python reads them: integers of 400 digits are no
float, of 5,000 digits not even an integer. TOML asks for 64 bits and for an error beyond; a JSON
number beyond them is a float, as readers in other languages have it.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from typing import Any

from raymap.model.errors import RayMapError

__all__ = ["WHOLE_BITS", "json_value", "toml_tables"]

WHOLE_BITS = 64
"""Of whole numbers, with or without a sign."""

_HALVES = re.compile("[\ud800-\udfff]")


def toml_tables(text: str, where: str, error: type[RayMapError] = RayMapError) -> dict[str, Any]:
    """The tables of a TOML text.

    Parameters
    ----------
    where : begins messages
    error : that is raised

    Raises
    ------
    RayMapError
        Of the given kind: no TOML, nested too deeply, or a whole number beyond 64 bits.
    """
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as failure:
        raise error(f"{where}: not a TOML file: {failure}") from None
    except RecursionError:
        raise error(f"{where}: brackets nest too deep to be read") from None
    except ValueError as failure:  # a number of thousands of digits
        raise error(f"{where}: a number cannot be read: {failure}") from None
    waiting: list[tuple[str, Any]] = [("", tables)]
    while waiting:
        dotted, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{dotted}.{key}" if dotted else key, each) for key, each in value.items()]
        elif isinstance(value, list):
            waiting += [(dotted, each) for each in value]
        elif isinstance(value, int) and value.bit_length() > WHOLE_BITS:
            raise error(f"{where}: {dotted}: a whole number has at most {WHOLE_BITS} bits")
    return tables


def json_value(text: str | bytes) -> Any:
    """The value of a JSON text; whole numbers beyond 64 bits are floats.

    Halves of characters (lone surrogates), which no text can be written with, are spelt out in it.

    Raises
    ------
    ValueError
        No JSON, nested too deeply, or a number that no float holds.
    """
    try:
        value = json.loads(text, parse_int=_whole, parse_float=_float)
        escaped = b"\\u" in text if isinstance(text, bytes) else "\\u" in text
        return _whole_characters(value) if escaped else value
    except RecursionError:
        raise ValueError("it nests too deeply") from None


def _whole_characters(value: Any) -> Any:
    text = json.dumps(value, ensure_ascii=False)
    if not _HALVES.search(text):
        return value
    return json.loads(
        _HALVES.sub(lambda half: f"\\\\u{ord(half[0]):04x}", text),
        parse_int=_whole,
        parse_float=_float,
    )


def _whole(digits: str) -> int | float:
    # 2^64 has 20 digits
    if len(digits) <= 21:
        value = int(digits)
        if value.bit_length() <= WHOLE_BITS:
            return value
    return _float(digits)


def _float(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise ValueError(f"the number {digits[:20]}… is too large")
    return value
