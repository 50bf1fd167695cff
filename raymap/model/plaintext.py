"""Texts of strangers as one line that does nothing but stand there.

A name of a map may hold what steers a terminal (escape sequences that clear the screen or set its
title), turns the direction of writing around (so that a line reads as another one), or cannot be
written at all (half of a surrogate pair). Such characters are shown as ``\\x1b``, ``\\u202e``.
"""

from __future__ import annotations

import re

__all__ = ["plain_json", "plain_lines", "plain_text"]

# Control characters (C0, DEL, C1), line and paragraph separators, marks, embeddings, overrides and
# isolates of direction (Unicode Standard Annex 9), the mark of byte order, lone surrogates
_ACTIVE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]"
)


def plain_text(text: str) -> str:
    """A text in which every character that acts on its surroundings is spelt out."""
    return _ACTIVE.sub(_spelt, text)


def plain_lines(text: str) -> str:
    """The same for a text of several lines: their ends and tabs stay."""
    return _ACTIVE.sub(_spelt_within, text)


def plain_json(text: str) -> str:
    """A JSON text of the same value without such characters: they stand as escapes of JSON."""
    return _ACTIVE.sub(_escaped, text)


def _spelt_within(found: re.Match[str]) -> str:
    return found[0] if found[0] in "\n\t" else _spelt(found)


def _escaped(found: re.Match[str]) -> str:
    return f"\\u{ord(found[0]):04x}"


def _spelt(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
