"""Path expressions read into nested tuples, in the plainest words."""

from __future__ import annotations

import re
from typing import Any


def tokens_of(text: str) -> list[str]:
    return re.findall(
        r"\(|\)(?:[*+?]|\{\d+(?:,\d*)?\})?|\||\.(?=[\s()|*+?{]|$)(?:[*+?]|\{\d+(?:,\d*)?\})?"
        r"|(?:\\.|[^\s()|\\])+",
        text,
    )


def _quantified(tree: Any, mark: str) -> Any:
    if not mark:
        return tree
    bounds = {"*": (0, None), "+": (1, None), "?": (0, 1)}
    if mark in bounds:
        return ("repeat", tree, *bounds[mark])
    numbers = mark[1:-1].split(",")
    least = int(numbers[0])
    most = least if len(numbers) == 1 else (int(numbers[1]) if numbers[1] else None)
    return ("repeat", tree, least, most)


def read_alternatives(tokens: list[str]) -> tuple[Any, list[str]]:
    choices: list[Any] = []
    parts: list[Any] = []
    while tokens and not tokens[0].startswith(")"):
        token, tokens = tokens[0], tokens[1:]
        if token == "|":
            choices.append(("sequence", parts))
            parts = []
        elif token == "(":
            inner, tokens = read_alternatives(tokens)
            parts.append(_quantified(inner, tokens[0][1:]))
            tokens = tokens[1:]
        elif token[0] == ".":
            parts.append(_quantified(("any",), token[1:]))
        elif token[0] == "@":
            parts.append(("detector", token[1:]))
        else:
            found = re.fullmatch(r"((?:\\.|[^:\\])*?)(?::([a-z_,]+))?", token, flags=re.DOTALL)
            assert found is not None
            words = found.group(2).split(",") if found.group(2) else []
            parts.append(("place", found.group(1) or None, words))
    choices.append(("sequence", parts))
    return ("either", choices), tokens
