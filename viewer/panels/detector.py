"""The detector panel: pictures of what a detector registered, cross sections, drawn regions."""

from __future__ import annotations

import base64
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.pictures import DetectorImage
from query.answers.images.readings import readings
from raymap.model.doubt import FOOTNOTE, MARK, with_error
from raymap.model.errors import RayMapError
from raymap.optics.cells import cells_by_angle
from raymap.optics.cellsizes import bin_cells
from viewer.drawn.answers import detector_image
from viewer.drawn.falsecolor import COLORMAPS, apply_colormap
from viewer.drawn.state import Region
from viewer.paint.plots import profile
from viewer.paint.rendering import encode_png
from viewer.panels.panel import Application, Panel, Question, Session
from viewer.panels.tree import (
    criterion_region,
    criterion_tree,
    region_values,
    tree_text,
    with_region,
)
from viewer.panels.values import choice, flag, maybe, text
from viewer.templates import template

__all__ = [
    "KINDS",
    "DetectorQuestions",
    "Seen",
    "calm_binning",
    "finest_binning",
    "region_in_words",
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


def region_of(session: Session) -> Region | None:
    """The region of the shown detector that the criterion demands."""
    detector = session.detector()
    if detector is None:
        return None
    try:
        return criterion_region(criterion_tree(session.state.criterion), detector)
    except RayMapError:
        return None


def region_in_words(session: Session) -> dict[str, Any] | None:
    """The region as criteria write it: in cells, of a far field in degrees of C and gamma."""
    region, detector = region_of(session), session.detector()
    if region is None or detector is None:
        return None
    said = {"shape": region.shape, "values": list(region_values(region, detector))}
    return said if cells_by_angle(detector) is None else said | {"unit": "deg"}


class DetectorQuestions:
    """Asks for the pictures of a session's detector."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.images: tuple[Seen, Seen] | None = None
        self._place: tuple[str, int, int] | None = None
        self._full: tuple[object, Seen] | None = None

    def place(self) -> tuple[int, int] | None:
        """The cell of the shown detector that the cross sections go through, once one is chosen."""
        detector = self.session.detector()
        if detector is None or self._place is None or self._place[0] != detector.name:
            return None
        return self._place[1:]

    def go_to(self, u: int, v: int) -> bool:
        """Choose a cell; whether it is another now."""
        detector = self.session.detector()
        if detector is None or self.place() == (u, v):
            return False
        self._place = (detector.name, u, v)
        return True

    def look_at_detector(self, cancel: Callable[[], bool]) -> dict[str, Any]:
        """Images of the selected rays and of all rays."""
        session = self.session
        detector = session.detector()
        if detector is None:
            return {"detector_cells": None}
        name = detector.name
        key = (name, session.map.rays)
        if self._full is None or self._full[0] != key:
            image = detector_image(session.map, name, "", cancel=cancel)
            if cancel():
                return {}
            self._full = key, Seen.of(image)
        selected = self._full[1]
        if session.state.criterion.strip():
            image = detector_image(session.map, name, session.state.criterion, cancel=cancel)
            if cancel():
                return {}
            selected = Seen.of(image)
        self.images = selected, self._full[1]
        return self.detector_fields()

    def detector_fields(self) -> dict[str, Any]:
        """The images with the chosen colours, scales and sections."""
        state, directory = self.session.state, self.session.map.directory
        detector = self.session.detector()
        if detector is None or self.images is None:
            return {"detector_cells": None}
        mine, every = self.images
        finest = finest_binning(detector.cells)
        lit = (every if state.image == "full" else mine).image.lit
        binning = max(state.binning or finest * calm_binning(lit.blocks(lit.flux, finest)), finest)
        selected, whole = (
            seen.image.lit.blocks(seen.image.lit.flux, binning) for seen in self.images
        )
        shown = whole if state.image == "full" else selected
        top, unit = float(shown.max()), directory.flux_unit
        options: dict[str, Any] = {"log": state.log_scale, "colormap": state.colormap}
        drawn = {**options, "cells": detector.cells, "binning": binning}
        place = self.place()
        if place is None:
            peak = np.unravel_index(int(np.argmax(shown)), shown.shape)
            place = (int(peak[1]) * binning, int(peak[0]) * binning)
        u, v = place[0] // binning, place[1] // binning
        note = "" if selected.max() > 0 else "No ray of the selection reaches this detector."
        if whole.max() <= 0:
            note = "No ray of the map reaches this detector."
        size_unit = detector.parameters.get("size_unit", directory.length_unit)
        facts = [
            ["Cells", f"{detector.cells[0]} × {detector.cells[1]}"],
            ["Size", f"{detector.size[0]:g} × {detector.size[1]:g} {size_unit}"],
            [f"Cell {place[0]}, {place[1]}", f"{float(selected[v, u]):.4g} {unit} selected, "
             f"{float(whole[v, u]):.4g} {unit} in all"],
        ]  # fmt: skip
        facts += density_facts(mine, every, (v, u), binning)
        sections = cross_sections(selected, whole, (u, v), log=state.log_scale)
        return {
            "detector_cells": list(detector.cells),
            "binned": binning,
            "image_selected": image_url(selected, highest=float(selected.max()), **drawn),
            "image_full": image_url(whole, highest=float(whole.max()), **drawn),
            "image_peaks": [mine.peak, every.peak],
            "detector_total": f"{float(selected.sum()):.4g} {unit} selected, "
            f"{float(whole.sum()):.4g} {unit} in all",
            "detector_note": note,
            "detector_facts": facts,
            "detector_sections": sections if whole.max() > 0 else "",
            **scale_fields(shown, top, unit=unit, binning=binning, **options),
        }

    def section_fields(self) -> dict[str, Any]:
        """Cross sections and facts alone, for a mouse that moves over the image."""
        fields = self.detector_fields()
        return {name: fields[name] for name in ("detector_sections", "detector_facts")}


def _questions(app: Application) -> DetectorQuestions:
    found: DetectorQuestions = app.questions["detector"]
    return found


FIELDS = ("detector", "log_scale", "colormap", "image", "binning")
"""Fields of the page that are part of the session."""


def _region(session: Session) -> dict[str, Any] | None:
    """The region, to be drawn on the picture."""
    region = region_of(session)
    return asdict(region) if region is not None else None


def _follow(app: Application) -> dict[str, Any]:
    session = app.session
    detector = session.detector()
    return {
        **{name: getattr(session.state, name) for name in FIELDS},
        "detector": detector.name if detector is not None else None,
        "region": _region(session),
    }


async def _take_detector(app: Application) -> None:
    before = app.session.detector()
    changes = {name: app.page[name] for name in FIELDS}
    if app.quiet or not app.change(**changes):
        return
    if app.session.detector() != before:
        await app.fill_panel(app.stopping, "detector")
        app.repaint(region=_region(app.session))
        return
    fields = await app.ask(_questions(app).detector_fields)
    app.repaint(**fields)


async def set_region(app: Application, region: dict[str, Any] | None) -> None:
    """A region was drawn on the image, or taken away."""
    detector = app.session.detector()
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
    if place is None or not cells or _questions(app).images is None:
        return
    u, v = int(place[0]), int(place[1])
    if 0 <= u < cells[0] and 0 <= v < cells[1] and _questions(app).go_to(u, v):
        fields = await app.ask(_questions(app).section_fields)
        with app.page:
            app.page.update(fields)


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    return [lambda: _questions(app).look_at_detector(cancel.is_set)]


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
        follow=_follow,
        questions=DetectorQuestions,
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
