"""Text of files whose encoding only their first bytes tell."""

from __future__ import annotations

from pathlib import Path

from raymap.model.errors import SceneError
from raymap.model.givenfile import given_bytes
from raymap.model.textfile import decode_text

__all__ = ["read_text"]


def read_text(path: str | Path) -> str:
    """The text of a file in UTF-16 or UTF-8 with or without a mark, or else Latin-1.

    Raises
    ------
    SceneError
        where there is no such file, it cannot be read, or it is no text
    """
    path = Path(path)
    text = decode_text(given_bytes(path, "lens file", SceneError))
    if "\0" in text:
        raise SceneError(f"{path.name} is not a text file")
    return text
