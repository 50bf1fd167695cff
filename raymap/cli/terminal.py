"""What a command prints: texts of files are text there, whoever prints them.

A command runs with both streams replaced (`plain_streams`): every character that acts on a
terminal is spelt out on the way, but for ends of lines and tabs. Colours and lines that are drawn
anew are ours alone: they come from a `console`, whose *texts* are spelt out before they are
coloured, and from `live_line`.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, TextIO

from raymap.model.plaintext import plain_lines

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["PlainStream", "console", "live_line", "plain_streams"]


class PlainStream:
    """A stream for texts that may have come from a file.

    It has no ``buffer``: there is no way around `write`, but for `trusted`.

    Parameters
    ----------
    trusted : the stream behind, for what this program makes itself
    """

    def __init__(self, trusted: TextIO) -> None:
        self.trusted = trusted

    def write(self, text: str) -> int:
        """Write a text; what acts, or what the stream behind cannot write, is spelt out."""
        shown = plain_lines(text)
        try:
            self.trusted.write(shown)
        except UnicodeEncodeError:
            encoding = self.trusted.encoding or "ascii"
            self.trusted.write(shown.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        if name in ("buffer", "detach", "reconfigure"):
            raise AttributeError(f"a stream of texts has no {name}")
        return getattr(self.trusted, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.trusted)


@contextlib.contextmanager
def plain_streams() -> Iterator[None]:
    """Spell out what acts in all that the block prints."""
    with (
        contextlib.redirect_stdout(_plain(sys.stdout)),
        contextlib.redirect_stderr(_plain(sys.stderr)),
    ):
        yield


def _plain(stream: TextIO) -> Any:
    return stream if stream is None or isinstance(stream, PlainStream) else PlainStream(stream)


def _trusted(stream: Any) -> TextIO:
    behind: TextIO = stream.trusted if isinstance(stream, PlainStream) else stream
    return behind


def console(*, stderr: bool = False, **options: Any) -> Console:
    """A console of rich whose texts do nothing but stand there; options as rich has them."""
    from rich.console import Console
    from rich.segment import Segment

    class PlainConsole(Console):
        """Spells out the texts of all that it renders; colours are put around them later."""

        def render(self, renderable: Any, options: Any = None) -> Iterator[Segment]:
            for text, style, control in super().render(renderable, options):
                yield Segment(text if control else plain_lines(text), style, control)

    stream = _trusted(sys.stderr if stderr else sys.stdout)
    return PlainConsole(file=stream, highlight=False, **options)


def live_line(text: str) -> None:
    """Draw the last line of a terminal on stderr anew."""
    stream = _trusted(sys.stderr)
    stream.write(f"\r\x1b[K{plain_lines(text)}")
    stream.flush()
