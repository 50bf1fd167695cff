"""Letters of labels are drawn as they are, none as the box that stands for a missing one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from viewer.drawn.colors import Legend, LegendEntry
from viewer.paint.lettering import Lettering
from viewer.paint.overlay import draw_legend

MISSING = "\ue123"


def drawn(text: str, size: int = 13) -> NDArray[np.uint8]:
    image = Image.new("L", (200, 30))
    draw = ImageDraw.Draw(image)
    Lettering(draw, size).write((4, 4), text, (255,))
    return np.asarray(image)


# What headlines, units and names are written with
@pytest.mark.parametrize("letter", "↩→←×–…·°±²µλ≤äßéŁΩЖ")
def test_no_letter_is_missing(letter: str) -> None:
    assert drawn(letter).any()
    assert not np.array_equal(drawn(letter), drawn(MISSING))


def test_letters_of_two_fonts_stand_on_one_line() -> None:
    # H and its Cyrillic twin Н, of the other font, end in the same row
    latin, cyrillic = (np.flatnonzero(drawn(letter, 20).any(axis=1))[-1] for letter in "HН")
    assert latin == cyrillic


def test_length_is_that_of_what_is_written() -> None:
    letters = Lettering(ImageDraw.Draw(Image.new("L", (1, 1))), 20)
    text = "L1.front ↩ → eye"
    inked = np.flatnonzero(drawn(text, 20).any(axis=0))
    assert letters.length(text) == pytest.approx(inked[-1] - 4 + 1, abs=3)


def test_the_legend_draws_its_arrows() -> None:
    def legend(label: str) -> NDArray[np.uint8]:
        entries = (LegendEntry(label=label, rgb=(200, 100, 0)),)
        picture = np.zeros((80, 300, 3), np.uint8)
        return draw_legend(picture, Legend(title="path", entries=entries), dark=True)

    arrows = legend("a ↩ → eye ×2")
    for letter in "↩→×":
        assert not np.array_equal(arrows, legend("a ↩ → eye ×2".replace(letter, MISSING)))
