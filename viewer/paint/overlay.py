"""Text in pictures: the legend of the rays and the names of objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from viewer.drawn.bodies import Body
from viewer.drawn.colors import Legend
from viewer.paint.lettering import Lettering

__all__ = ["draw_legend", "draw_names"]

Picture = NDArray[np.uint8]
Box = tuple[float, float, float, float]


def _inks(dark: bool) -> tuple[tuple[int, int, int], tuple[int, int, int, int]]:
    """Ink and panel colour."""
    if dark:
        return (226, 232, 240), (15, 20, 28, 205)
    return (30, 38, 50), (255, 255, 255, 215)


def draw_legend(
    picture: Picture, legend: Legend, *, caption: Sequence[str] = (), dark: bool, size: int = 13
) -> Picture:
    """Write what the colours mean into the lower left corner, and a caption into the upper left.

    Parameters
    ----------
    picture : (height, width, 3) uint8
    caption : lines of text
    size : of the letters [pixels]
    """
    image = Image.fromarray(picture).convert("RGBA")
    veil = Image.new("RGBA", image.size)
    draw = ImageDraw.Draw(veil)
    letters = Lettering(draw, size)
    ink, panel = _inks(dark)
    if legend.entries:
        _legend_panel(draw, letters, image.size, legend, size, ink, panel)
    y = size
    for number, line in enumerate(caption):
        tone = (*ink, 255 if number == 0 else 190)
        for row in _wrap(letters, line, image.size[0] - 2 * size):
            letters.write((size, y), row, tone)
            y += int(1.4 * size)
    return np.asarray(Image.alpha_composite(image, veil).convert("RGB"))


def _legend_panel(
    draw: ImageDraw.ImageDraw,
    letters: Lettering,
    extent: tuple[int, int],
    legend: Legend,
    size: int,
    ink: tuple[int, int, int],
    panel: tuple[int, int, int, int],
) -> None:
    """Swatches with their labels; labels that are too long are cut."""
    step = int(1.45 * size)
    room = max(10, int(extent[0] * 0.62))
    labels = [_cut(letters, entry.label, room) for entry in legend.entries]
    texts = [legend.title, *labels]
    width = max(letters.length(text) for text in texts) + 3.4 * size
    height = step * len(texts) + size
    left, top = size, extent[1] - height - size
    draw.rounded_rectangle((left, top, left + width, top + height), size // 3, fill=panel)
    x, y = left + 0.7 * size, top + 0.5 * size
    letters.write((x, y), legend.title, (*ink, 200))
    for entry, label in zip(legend.entries, labels, strict=True):
        y += step
        square: Box = (x, y + 0.2 * size, x + size, y + 1.1 * size)
        draw.rectangle(square, fill=(*entry.rgb, 255))
        letters.write((x + 1.6 * size, y), label, (*ink, 255))


def _cut(letters: Lettering, text: str, room: float) -> str:
    """Leave out the middle of a text that is too long."""
    if letters.length(text) <= room:
        return text
    keep = len(text)
    while keep > 4:
        keep -= 1
        short = text[: keep // 2] + " … " + text[len(text) - keep // 2 :]
        if letters.length(short) <= room:
            return short
    return text[:4]


def _wrap(letters: Lettering, text: str, room: float) -> list[str]:
    """Break a line of text at spaces."""
    rows = [""]
    for word in text.split(" "):
        longer = f"{rows[-1]} {word}".strip()
        if rows[-1] and letters.length(longer) > room:
            rows.append(word)
        else:
            rows[-1] = longer
    return rows


def draw_names(
    picture: Picture,
    bodies: Sequence[Body],
    matrix: NDArray[np.float64],
    *,
    dark: bool,
    size: int = 12,
    supersampling: int = 1,
) -> Picture:
    """Write the name of each body above it.

    Parameters
    ----------
    matrix : (4, 4), world to the pixels of a picture ``supersampling`` times as large
    """
    image = Image.fromarray(picture).convert("RGBA")
    veil = Image.new("RGBA", image.size)
    draw = ImageDraw.Draw(veil)
    letters = Lettering(draw, size)
    ink, panel = _inks(dark)
    taken: list[Box] = []
    for body in bodies:
        if len(body.corners) == 0:
            continue
        flat = body.corners.reshape(-1, 3).astype(np.float64) @ matrix[:, :3].T + matrix[:, 3]
        flat = flat[flat[:, 3] > 0]
        if len(flat) == 0:
            continue
        pixels = flat[:, :2] / flat[:, 3:] / supersampling
        x = float(0.5 * (pixels[:, 0].min() + pixels[:, 0].max()))
        y = float(pixels[:, 1].min()) - 1.5 * size
        width = letters.length(body.name)
        box = _free_place(x - width / 2 - 4, y, width + 8, 1.45 * size, taken)
        inside = box[0] >= 0 and box[2] <= image.size[0] and 0 <= box[1] < image.size[1] - size
        if not inside:
            continue
        taken.append(box)
        draw.rounded_rectangle(box, 3, fill=panel)
        letters.write((box[0] + 4, box[1] + 1), body.name, (*ink, 255))
    return np.asarray(Image.alpha_composite(image, veil).convert("RGB"))


def _free_place(x: float, y: float, width: float, height: float, taken: Sequence[Box]) -> Box:
    """Move a label upward until it covers no other."""
    box = (x, y, x + width, y + height)
    for _ in range(len(taken) + 1):
        hit = next((t for t in taken if t[0] < box[2] and box[0] < t[2] and t[1] < box[3]
                    and box[1] < t[3]), None)  # fmt: skip
        if hit is None:
            break
        box = (x, hit[1] - height - 2, x + width, hit[1] - 2)
    return box
