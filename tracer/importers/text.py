"""Text of files whose encoding only their first bytes tell."""

from __future__ import annotations

import codecs
from pathlib import Path

from raymap.errors import SceneError

__all__ = ["read_text"]

LARGEST_BYTES = 64 * 2**20


def read_text(path: str | Path) -> str:
    """The text of a file in UTF-16 or UTF-8 with or without a mark, or else Latin-1.

    Raises
    ------
    SceneError
        where there is no such file, it cannot be read, or it is no text
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise SceneError(f"{path.name} is too large for a lens file ({size:,} bytes)")
        raw = path.read_bytes()
    except FileNotFoundError:
        raise SceneError(f"there is no file {str(path)!r}; check the path") from None
    except OSError as error:
        raise SceneError(f"cannot read {str(path)!r}: {error.strerror or error}") from None
    text = _decode(raw)
    if "\0" in text:
        raise SceneError(f"{path.name} is not a text file")
    return text


def _decode(raw: bytes) -> str:
    for mark, encoding in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if raw.startswith(mark):
            return raw.decode(encoding, errors="replace")
    # Latin text in UTF-16 without a mark has a zero in every other byte
    head = raw[:4096]
    if len(head) > 3 and head[1::2].count(0) > 0.4 * len(head):
        return raw.decode("utf-16-le", errors="replace")
    if len(head) > 3 and head[0::2].count(0) > 0.4 * len(head):
        return raw.decode("utf-16-be", errors="replace")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")
