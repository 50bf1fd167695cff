"""Text of files that other programs wrote: encodings, line ends, what stands behind, numbers."""

from __future__ import annotations

import codecs
import re

__all__ = ["decode_text", "plain_number", "split_lines", "text_lines"]

_CLOSING = "\0\x1a"
_LINE_END = re.compile(r"\r\n|\r|\n")
_NUMBER = re.compile(
    r"[-+]?((\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?|inf(inity)?|nan)", re.IGNORECASE | re.ASCII
)
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def decode_text(raw: bytes) -> str:
    """The text in UTF-16 or UTF-8, with or without a mark, or else Latin-1.

    A closing Ctrl-Z (the end of a text file under DOS and CP/M) and the NUL bytes with which some
    programs fill a block are not part of it.
    """
    text = _decode(raw)
    ended = text.rstrip(_CLOSING + " \t\r\n")
    return ended if any(mark in text[len(ended) :] for mark in _CLOSING) else text


def text_lines(raw: bytes) -> list[str]:
    """Lines of a file's text, as `decode_text` and `split_lines` have them."""
    return split_lines(decode_text(raw))


def split_lines(text: str) -> list[str]:
    r"""Lines of a text, ended by CR, LF or both and by nothing else.

    `str.splitlines` ends lines at further characters, among them U+0085, which is a letter in other
    encodings of one byte.
    """
    lines = _LINE_END.split(text)
    return lines[:-1] if lines[-1] == "" else lines


def _decode(raw: bytes) -> str:
    for mark, encoding in _MARKS:
        if raw.startswith(mark):
            return raw.decode(encoding, errors="replace")
    # Latin text in UTF-16 without a mark has a zero in every other byte
    head = raw[:4096].rstrip(b"\0")
    if len(head) > 3 and head[1::2].count(0) > 0.4 * len(head):
        return raw.decode("utf-16-le", errors="replace")
    if len(head) > 3 and head[0::2].count(0) > 0.4 * len(head):
        return raw.decode("utf-16-be", errors="replace")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def plain_number(text: str) -> float | None:
    """A number as programs print it, with E or Fortran's D; None for anything else.

    Python's own reader also takes underscores and the digits of every script, which no program
    writes: there they are slips.
    """
    if not _NUMBER.fullmatch(text):
        return None
    return float(re.sub(r"(?<=[\d.])[dD]", "e", text))
