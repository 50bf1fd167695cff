"""Letters in pictures, with those that Pillow's own font lacks from matplotlib's."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path

from PIL import ImageDraw, ImageFont

__all__ = ["Lettering"]

Font = ImageFont.ImageFont | ImageFont.FreeTypeFont

_UNASSIGNED = "\ue123"
"""A character that no font has: what stands for it stands for all that a font lacks."""


class Lettering:
    """Writes text of one size into a picture.

    Pillow's font has no arrows, no ``×``, no ``²`` and few letters beyond English ones; DejaVu
    Sans, which comes with matplotlib, has them.
    """

    def __init__(self, draw: ImageDraw.ImageDraw, size: int) -> None:
        self._draw = draw
        self._fonts = _fonts(size)

    def length(self, text: str) -> float:
        """Width of a text [pixels]."""
        return sum(self._draw.textlength(part, font=font) for font, part in self._runs(text))

    def write(self, place: tuple[float, float], text: str, fill: tuple[int, ...]) -> None:
        """Write a text to the right of and below a place."""
        x, y = place
        first = self._fonts[0]
        for font, part in self._runs(text):
            if font is first or isinstance(first, ImageFont.ImageFont):
                self._draw.text((x, y), part, font=font, fill=fill)
            else:
                # On the line on which the other letters stand
                line = y + first.getmetrics()[0]
                self._draw.text((x, line), part, font=font, fill=fill, anchor="ls")
            x += self._draw.textlength(part, font=font)

    def _runs(self, text: str) -> list[tuple[Font, str]]:
        """Pieces of the text, each with the first font that has its characters."""
        return [
            (self._fonts[number], "".join(part))
            for number, part in groupby(text, lambda letter: _font_of(self._fonts, letter))
        ]


@lru_cache(8)
def _fonts(size: int) -> tuple[Font, ...]:
    fonts: list[Font] = [ImageFont.load_default(size)]
    found = find_spec("matplotlib")
    if found is not None and found.origin is not None:
        more = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
        if more.exists() and isinstance(fonts[0], ImageFont.FreeTypeFont):
            fonts.append(ImageFont.truetype(more, size))
    return tuple(fonts)


@lru_cache(4096)
def _font_of(fonts: tuple[Font, ...], letter: str) -> int:
    """Number of the first font that has a character; 0 where none has it."""
    return next((k for k, font in enumerate(fonts) if _drawn(font, letter)), 0)


def _drawn(font: Font, letter: str) -> bool:
    """Whether a font has a character."""
    own, missing = font.getmask(letter), font.getmask(_UNASSIGNED)
    return (own.size, bytes(own)) != (missing.size, bytes(missing))
