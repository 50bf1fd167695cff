"""The detector panel: pictures of what a detector registered, cross sections, drawn regions."""

from __future__ import annotations

import base64
import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.pictures import DetectorImage
from query.answers.images.readings import readings
from raymap.model.doubt import FOOTNOTE, MARK, with_error
from raymap.optics.cellsizes import bin_cells
from viewer.drawn.falsecolor import COLORMAPS, apply_colormap
from viewer.drawn.state import Region
from viewer.paint.plots import profile
from viewer.paint.rendering import encode_png
from viewer.panels.panel import Application, Panel, Question
from viewer.panels.tree import criterion_tree, tree_text, with_region
from viewer.panels.values import choice, flag, maybe, text
from viewer.templates import template

__all__ = [
    "FIELDS",
    "KINDS",
    "Seen",
    "calm_binning",
    "cross_sections",
    "density_facts",
    "finest_binning",
    "image_url",
    "scale_fields",
]

_BINNINGS = (1, 2, 4, 8, 16)
_CALM, _MANY = 0.8, 8.0
_MOST_SHOWN = 2**20
"""Blocks of cells in a picture at most."""


def finest_binning(cells: tuple[int, int]) -> int:
    """Side of the smallest blocks of so many cells that a page is sent."""
    binning = 1
    while math.prod(-(-n // binning) for n in cells) > _MOST_SHOWN:
        binning *= 2
    return binning


def calm_binning(values: NDArray[np.floating]) -> int:
    """The finest binning (1 to 16) that shows more than single rays here and there.

    Either most light lies in blocks with many times that of the faintest cells, as in a focus, or
    the blocks beside those that are lit are lit, too.
    """
    if not values.any():
        return 1
    faint = float(np.quantile(values[values > 0.0], 0.1))
    for binning in _BINNINGS:
        blocks = bin_cells(values, binning)
        if float((blocks**2).sum() / blocks.sum()) >= _MANY * faint:
            return binning
        lit = blocks > 0.0
        beside = 4.0 - 2.0 / lit.shape[0] - 2.0 / lit.shape[1]
        pairs = (lit[1:] & lit[:-1]).sum() + (lit[:, 1:] & lit[:, :-1]).sum()
        if 2.0 * pairs >= _CALM * beside * lit.sum():
            return binning
    return _BINNINGS[-1]


def image_url(
    values: NDArray[np.floating],
    *,
    log: bool,
    colormap: str,
    highest: float,
    cells: tuple[int, int],
    binning: int = 1,
) -> str:
    """A detector's cells as a picture for the page, row 0 at the bottom.

    Parameters
    ----------
    values : (rows, columns) flux per block of ``binning`` cells each way
    highest : value of the brightest colour
    cells : of the detector (u, v); the picture has one pixel for each, or for each of the
        smallest blocks that a page is sent
    """
    pixels = apply_colormap(_scaled(values, log=log, highest=highest), colormap)
    finest = finest_binning(cells)
    for axis in (0, 1):
        pixels = np.repeat(pixels, binning // finest, axis=axis)
    pixels = pixels[: -(-cells[1] // finest), : -(-cells[0] // finest)]
    png = encode_png(np.ascontiguousarray(pixels[::-1]))
    return "data:image/png;base64," + base64.b64encode(png).decode()


@dataclass(frozen=True, eq=False)
class Seen:
    """A picture and what is read off it (`query.answers.images.readings`)."""

    image: DetectorImage
    numbers: dict[str, Any]

    @classmethod
    def of(cls, image: DetectorImage) -> Seen:
        """Read the peak and the like off a picture."""
        return cls(image, readings(image))

    @property
    def peak(self) -> str:
        """In words, with its standard error."""
        return said(self.numbers, "peak", f" {self.numbers['unit']}")


def said(numbers: dict[str, Any], name: str, unit: str = "") -> str:
    """A reading in words with its standard error; a dash where there is none."""
    value, se = numbers.get(name), numbers.get(f"{name}_se")
    return "–" if value is None or se is None else with_error(value, se) + unit


def density_facts(
    selected: Seen, whole: Seen, place: tuple[int, int], binning: int
) -> list[list[str]]:
    """What the detector measures at a cell, and what is read off all of it: [name, words] each.

    Parameters
    ----------
    selected, whole : of the selected and of all rays; nothing is said of cells without a size
    place : row and column of the block of ``binning`` cells each way
    """
    measure = selected.image.measure
    if measure is None:
        return []
    unit = f" {selected.numbers['unit']}"
    both = selected.numbers, whole.numbers
    height, width = measure.sizes.shape
    down, across = (
        range(k * binning, min((k + 1) * binning, n))
        for k, n in zip(place, (height, width), strict=True)
    )
    size = float(measure.sizes.part(down, across).sum())
    here = []
    for seen in (selected, whole):
        lit = seen.image.lit
        inside = (lit.row // binning == place[0]) & (lit.column // binning == place[1])
        flux, variance = float(lit.flux[inside].sum()), float(lit.variance[inside].sum())
        here.append(with_error(flux / size, variance**0.5 / size) + unit if size > 0.0 else "–")
    rows = [("Here", here), ("Peak", [said(numbers, "peak", unit) for numbers in both])]
    if "planes" in whole.numbers:
        for k, plane in enumerate(whole.numbers["planes"]):
            for key, word in (("beam_deg", "beam (50 %)"), ("field_deg", "field (10 %)")):
                words = [said(numbers["planes"][k], key, "°") for numbers in both]
                rows.append((f"{plane['plane']}, {word}", words))
    else:
        rows.append(("Mean", [said(numbers, "mean", unit) for numbers in both]))
        rows.append(("Min/mean", [said(numbers, "min_over_mean") for numbers in both]))
    facts = [[name, f"{mine} selected, {all_} in all"] for name, (mine, all_) in rows]
    if any(MARK in words for _, words in facts):
        facts.append([MARK, FOOTNOTE.removeprefix(f"{MARK} ")])
    return facts


def lowest_shown(values: NDArray[np.floating], highest: float) -> float:
    """Lower end of a logarithmic scale: the smallest value, but at most seven decades down."""
    positive = values[values > 0]
    low = float(positive.min()) if len(positive) else highest
    return max(low * 0.7, highest * 1e-7)


def _scaled(values: NDArray[np.floating], *, log: bool, highest: float) -> NDArray[np.float64]:
    """Values as places on the scale, 0 … 1."""
    if not highest > 0:
        return np.zeros(values.shape)
    if not log:
        return np.asarray(values / highest, np.float64)
    low = lowest_shown(values, highest)
    span = np.log(highest / low) or 1.0
    return np.asarray(np.clip(np.log(np.maximum(values, low * 1e-3) / low) / span, 0, 1))


def scale_fields(
    values: NDArray[np.floating],
    highest: float,
    *,
    log: bool,
    colormap: str,
    unit: str,
    binning: int,
) -> dict[str, str]:
    """Ends and colours of the scale below the pictures."""
    steps = apply_colormap(np.linspace(0, 1, 12), colormap)
    stops = ", ".join("#" + "".join(f"{int(part):02x}" for part in step) for step in steps)
    low = lowest_shown(values, highest) if log and highest > 0 else 0.0
    cells = "cell" if binning == 1 else f"{binning} × {binning} cells"
    return {
        "image_gradient": f"linear-gradient(to right, {stops})",
        "image_low": f"{low:.3g}" if highest > 0 else "",
        "image_high": f"{highest:.3g} {unit} per {cells}",
    }


def cross_sections(
    selected: NDArray[np.floating],
    full: NDArray[np.floating] | None,
    place: tuple[int, int],
    *,
    log: bool,
) -> str:
    """Flux along the row and the column of a cell, as SVG."""
    column, row = place
    parts = []
    across: Any = (row, slice(None))
    along: Any = (slice(None), column)
    for caption, cut in ((f"row {row}, across u", across), (f"column {column}, across v", along)):
        curves: list[tuple[str, Any, str]] = []
        if full is not None:
            curves.append(("all", full[cut], "#7d8ca1"))
        curves.append(("selected", selected[cut], "#56b4e9"))
        parts.append(profile(curves, log=log, caption=caption))
    return "".join(parts)


FIELDS = ("detector", "log_scale", "colormap", "image", "binning")
"""Fields of the page that are part of the session."""


async def _take_detector(app: Application) -> None:
    before = app.inquiry.detector_name()
    changes = {name: app.page[name] for name in FIELDS}
    if app.quiet or not app.change(**changes):
        return
    if app.inquiry.detector_name() != before:
        app.inquiry.place = None
        await app.fill_panel(app.stopping, "detector")
        app.repaint(region=app.region())
        return
    fields = await app.ask(app.inquiry.detector_fields)
    app.repaint(**fields)


async def set_region(app: Application, region: dict[str, Any] | None) -> None:
    """A region was drawn on the image, or taken away."""
    detector = app.inquiry.detector()
    if detector is None:
        return
    value = None
    if region is not None:
        x0, y0, x1, y1 = (round(float(number), 1) for number in region["values"])
        shape = "ellipse" if region.get("shape") == "ellipse" else "rect"
        value = Region(shape=shape, values=(x0, y0, x1, y1))  # type: ignore[arg-type]
    tree = criterion_tree(app.session.state.criterion)
    await app.set_criterion(tree_text(with_region(tree, detector, value)))


async def set_place(app: Application, place: list[int] | None) -> None:
    """The cell under the mouse: cross sections go through it."""
    cells = app.page.detector_cells
    if place is None or not cells or app.inquiry.images is None:
        return
    u, v = int(place[0]), int(place[1])
    if 0 <= u < cells[0] and 0 <= v < cells[1] and app.inquiry.place != (u, v):
        app.inquiry.place = (u, v)
        fields = await app.ask(app.inquiry.section_fields)
        with app.page:
            app.page.update(fields)


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    return [lambda: app.inquiry.look_at_detector(cancel.is_set)]


KINDS = (
    Panel(
        word="detector",
        title="Detector",
        place=20,
        markup=lambda: template("detector"),
        fields=lambda app: {
            "detectors": [entry.name for entry in app.session.map.directory.detectors],
            "colormaps": list(COLORMAPS),
            "shape": "rect",
            "detector_cells": None,
            "image_selected": "",
            "image_full": "",
            "image_low": "",
            "image_high": "",
            "image_gradient": "",
            "image_peaks": ["", ""],
            "binned": 1,
            "detector_note": "",
            "detector_facts": [],
            "detector_sections": "",
            "detector_total": "",
        },
        incoming={
            "detector": maybe(text(1024)),
            "log_scale": flag,
            "colormap": choice(*COLORMAPS),
            "image": choice("selected", "full", "both"),
            "binning": choice(0, *_BINNINGS),
            "shape": choice("rect", "ellipse"),
        },
        actions={"region": set_region, "place": set_place},
        changes={FIELDS: _take_detector},
        fill=_fill,
    ),
)
