"""What every file format says of itself, and which one a file has."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from raymap.model.registry import Registry

__all__ = [
    "FileFormat",
    "by_content",
    "by_suffix",
    "known_suffixes",
    "of_other_program",
    "suffixes_of",
]


@dataclass(frozen=True, kw_only=True)
class FileFormat:
    """A format of files that other programs write.

    Attributes
    ----------
    suffixes : of file names, in lower case with the dot; the words of the format
    title : what such files are
    place : in lists, from the lowest
    sniff : whether the first bytes of a file are those of the format; None: they do not tell
    """

    suffixes: tuple[str, ...]
    title: str
    place: float = 1000.0
    sniff: Callable[[bytes], bool] | None = None

    def spelling(self) -> str:
        """The suffixes, for lists."""
        return " ".join(self.suffixes)


Format = TypeVar("Format", bound=FileFormat)

HEAD_BYTES = 4096
"""Of a file, by which formats know it."""


def suffixes_of(kind: FileFormat) -> tuple[str, ...]:
    """The words of a format in a registry."""
    return kind.suffixes


def by_suffix(formats: Registry[Format], path: Path) -> Format | None:
    """The format of a file's suffix."""
    return formats.get(path.suffix.lower())


def by_content(formats: Registry[Format], path: Path) -> Format | None:
    """The format that knows the first bytes of a file.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    sniffing = [kind for kind in formats.kinds() if kind.sniff is not None]
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    return next((kind for kind in sniffing if kind.sniff is not None and kind.sniff(head)), None)


_RAYS_OF_OTHERS = {".dis": "ASAP", ".ray": "LightTools or Speos"}
"""Files of rays that are not read, and whose they are."""


def of_other_program(path: Path) -> str:
    """For messages: what a file of light is that no format reads; empty where that is not known."""
    program = _RAYS_OF_OTHERS.get(path.suffix.lower())
    if program is None:
        return ""
    return f" (its name is that of rays of {program}: ask for them as TM-25 or in Zemax' format)"


def known_suffixes(formats: Iterable[FileFormat]) -> str:
    """For messages: what files may end in."""
    return ", ".join(suffix for kind in formats for suffix in kind.suffixes)
