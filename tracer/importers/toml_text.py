"""Write the tables of a scene as TOML, as a person would: one table per named thing."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["toml_text"]


def toml_text(tables: Mapping[str, Any]) -> str:
    """The TOML of a scene's tables: numbers, strings, lists and mappings.

    What is not a table stands first; a mapping of mappings becomes ``[key.NAME]`` tables.
    """
    lines = [
        f"{_key(key)} = {_value(value)}"
        for key, value in tables.items()
        if not isinstance(value, Mapping)
    ]
    for key, value in tables.items():
        if not isinstance(value, Mapping):
            continue
        if value and all(isinstance(item, Mapping) for item in value.values()):
            for name, item in value.items():
                lines += ["", f"[{_key(key)}.{_key(name)}]", *_entries(item)]
        else:
            lines += ["", f"[{_key(key)}]", *_entries(value)]
    return "\n".join(lines) + "\n"


def _entries(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(key)} = {_value(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        number = float(value)
        if math.isfinite(number):
            return repr(number)
        return "nan" if math.isnan(number) else ("inf" if number > 0.0 else "-inf")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_entries(value)) + " }" if value else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise TypeError(f"{type(value).__name__} has no TOML")
