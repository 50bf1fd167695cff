"""Small plots as SVG text, drawn by the browser: cross sections, spectra, heat maps."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from raymap.model.doubt import FOOTNOTE, MARK
from viewer.drawn.falsecolor import apply_colormap, wavelength_rgb

__all__ = ["bars", "heat_map", "profile"]


def _hex(color: NDArray[np.integer] | NDArray[np.floating]) -> str:
    return "#" + "".join(f"{round(float(value)):02x}" for value in color)


def profile(
    curves: Sequence[tuple[str, NDArray[np.floating], str]],
    *,
    log: bool = False,
    width: int = 420,
    height: int = 110,
    caption: str = "",
) -> str:
    """Curves over their index, as steps.

    Parameters
    ----------
    curves : (label, values, colour) each
    log : logarithmic values over at most six decades
    """
    left, bottom, top = 46, 16, 14
    highest = max((float(np.max(v)) for _, v, _ in curves if len(v)), default=0.0)
    parts = [_frame(width, height, left, top, bottom)]
    if highest > 0:
        low = highest * 1e-6 if log else 0.0
        positive = [v[v > 0] for _, v, _ in curves if (v > 0).any()]
        if log and positive:
            low = max(low, min(float(v.min()) for v in positive) * 0.8)
        for _, values, color in curves:
            if len(values) == 0:
                continue
            if log:
                shown = np.log(np.maximum(values, low) / low) / np.log(highest / low)
            else:
                shown = values / highest
            x = left + (width - left - 4) * np.arange(len(values) + 1) / len(values)
            y = height - bottom - (height - bottom - top) * np.clip(shown, 0, 1)
            points = " ".join(
                f"{x[i]:.1f},{y[i]:.1f} {x[i + 1]:.1f},{y[i]:.1f}" for i in range(len(values))
            )
            parts.append(f'<polyline points="{points}" fill="none" stroke="{color}"/>')
        parts.append(_text(left - 4, top + 4, f"{highest:.3g}", "end"))
        parts.append(_text(left - 4, height - bottom, f"{low:.2g}" if log else "0", "end"))
    x_label = left + 4
    for label, _, color in curves:
        parts.append(f'<rect x="{x_label}" y="3" width="8" height="8" fill="{color}"/>')
        parts.append(_text(x_label + 11, 10, label, "start"))
        x_label += 20 + 6 * len(label)
    parts.append(_text(width - 4, height - 4, caption, "end"))
    return _svg(width, height, parts)


def bars(
    labels: Sequence[str],
    values: Sequence[float],
    *,
    wavelengths_nm: Sequence[float] | None = None,
    width: int = 420,
    height: int = 90,
    caption: str = "",
) -> str:
    """One bar per channel, in the colour of its wavelength.

    Parameters
    ----------
    labels, values : of the bars
    wavelengths_nm : of the channels, for colour; None draws them red, green, blue
    """
    left, bottom, top = 30, 16, 18
    heights = np.maximum(np.asarray(values, float), 0)
    highest = float(heights.max()) if len(heights) else 0.0
    if wavelengths_nm is not None:
        colors = [_hex(rgb * 255) for rgb in wavelength_rgb(np.asarray(wavelengths_nm, float))]
    else:
        colors = ["#ef5350", "#66bb6a", "#5c8df6", "#bdbdbd"]
    parts = [_frame(width, height, left, top, bottom)]
    step = (width - left - 4) / max(len(heights), 1)
    skip = max(1, -(-len(labels) * 40 // max(1, width - left)))
    for number, value in enumerate(heights):
        tall = (height - top - bottom) * (value / highest if highest else 0)
        x = left + step * number
        color = colors[number % len(colors)]
        parts.append(
            f'<rect x="{x + 0.12 * step:.1f}" y="{height - bottom - tall:.1f}" '
            f'width="{0.76 * step:.1f}" height="{tall:.1f}" fill="{color}">'
            f"<title>{escape(labels[number])}: {value:.4g}</title></rect>"
        )
        if number % skip == 0:
            parts.append(_text(x + 0.5 * step, height - 4, labels[number], "middle"))
    parts.append(_text(left - 4, top + 8, f"{highest:.2g}", "end"))
    parts.append(_text(width - 4, 11, caption, "end"))
    return _svg(width, height, parts)


def heat_map(
    rows: Sequence[str],
    columns: Sequence[str],
    values: NDArray[np.floating],
    *,
    doubtful: NDArray[np.bool_] | None = None,
    unit: str = "",
    width: int = 430,
) -> str:
    """A matrix as coloured cells, logarithmic; each says its value when pointed at.

    Parameters
    ----------
    rows, columns : names
    values : (n_rows, n_columns), 0 for nothing
    doubtful : of equal shape, cells that are marked; None: none
    """
    if not len(rows) or not len(columns):
        return ""
    longest = max(len(name) for name in rows)
    left = min(130, 8 + 6 * longest)
    size = min(28.0, (width - left - 6) / len(columns))
    top = min(110, 10 + 5 * max(len(name) for name in columns))
    height = int(top + size * len(rows) + 6)
    positive = values[values > 0]
    shown = np.zeros(values.shape)
    doubtful = np.zeros(values.shape, np.bool_) if doubtful is None else doubtful
    if len(positive):
        low, high = float(positive.min()), float(positive.max())
        span = np.log(high / low)
        safe = np.where(values > 0, values, low)
        share = np.log(safe / low) / span if span > 0 else np.ones(values.shape)
        shown = np.where(values > 0, 0.15 + 0.85 * share, 0)
    colors = apply_colormap(shown, "inferno")
    parts = []
    for i, row in enumerate(rows):
        y = top + size * i
        parts.append(_text(left - 5, y + 0.5 * size + 3, _short(row, 20), "end"))
        for j, column in enumerate(columns):
            value = float(values[i, j])
            note = f", {FOOTNOTE.removeprefix(f'{MARK} ')}" if doubtful[i, j] else ""
            fill = _hex(colors[i, j]) if value > 0 else "var(--rm-cell)"
            parts.append(
                f'<rect class="rm-cell" data-row="{i}" data-column="{j}" '
                f'x="{left + size * j:.1f}" y="{y:.1f}" '
                f'width="{size - 1:.1f}" height="{size - 1:.1f}" fill="{fill}">'
                f"<title>{escape(row)} then {escape(column)}: {value:.4g} {escape(unit)}{note}"
                "</title></rect>"
            )
            if doubtful[i, j]:
                x, y_mark = left + size * (j + 0.5) - 0.5, y + 0.5 * size + 3
                parts.append(
                    f'<text class="rm-cell-mark" x="{x:.1f}" y="{y_mark:.1f}">{MARK}</text>'
                )
    for j, column in enumerate(columns):
        x = left + size * (j + 0.5)
        parts.append(
            f'<text x="{x + 3:.1f}" y="{top - 4}" transform="rotate(-60 {x + 3:.1f} {top - 4})" '
            f'class="rm-plot-text">{escape(_short(column, 18))}</text>'
        )
    return _svg(width, height, parts)


def _short(name: str, room: int) -> str:
    return name if len(name) <= room else name[: room - 1] + "…"


def _frame(width: int, height: int, left: int, top: int, bottom: int) -> str:
    return f'<path class="rm-axis" d="M{left} {top} V{height - bottom} H{width - 4}" fill="none"/>'


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return (
        f'<text class="rm-plot-text" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">'
        f"{escape(text)}</text>"
    )


def _svg(width: int, height: int, parts: Sequence[str]) -> str:
    return (
        f'<svg class="rm-plot" viewBox="0 0 {width} {height}" width="100%" role="img">'
        + "".join(parts)
        + "</svg>"
    )
