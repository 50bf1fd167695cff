"""Text of files whose encoding only their first bytes tell."""

from __future__ import annotations

from pathlib import Path

from raymap.errors import SceneError
from raymap.textfile import decode_text

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
    text = decode_text(raw)
    if "\0" in text:
        raise SceneError(f"{path.name} is not a text file")
    return text
