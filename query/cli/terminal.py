"""Answers as tables in a terminal."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from query.answers.paths.tables import PathTable
from query.answers.reports.histograms import PathNumbers
from query.answers.selections.selection import Selection
from raymap.cli.terminal import console as make_console
from raymap.model.doubt import FOOTNOTE, is_doubtful, marked
from raymap.model.plaintext import plain_text
from raymap.optics.colorimetry import encode_srgb

__all__ = ["print_paths", "print_report", "print_rows", "print_selection"]


_FILE_WIDTH = 140
"""Columns where the output goes to a file or another program, which have no width."""

_LONGEST, _WORTH = 8, 4
"""Words that repeat as a group at most, and words in all for which brackets are shorter."""


def _console() -> Console:
    console = make_console(soft_wrap=False)
    if not console.is_terminal:
        console.width = _FILE_WIDTH
    return console


def _number(value: float | None, digits: int = 6) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def print_selection(selection: Selection, show_rays: bool) -> None:
    """How many rays, how much flux, why nothing; the first ray numbers."""
    console = _console()
    unit = selection.map.directory.flux_unit
    share = f" ({selection.matched / selection.rays:.4%})" if selection.rays else ""
    more = ", stopped at the limit" if selection.limited else ""
    console.print(f"{selection.matched:,} of {selection.rays:,} rays{share}{more}")
    flux, se = selection.flux, selection.flux_se
    console.print(marked(f"flux {flux:.6g} ± {se:.2g} {unit}", flux, se))
    if is_doubtful(flux, se):
        console.print(FOOTNOTE)
    if selection.flux_bound_95 is not None:
        console.print(f"below {selection.flux_bound_95:.3g} {unit} with 95 % confidence")
    if selection.reason:
        console.print(f"nothing matches: {selection.reason}", markup=False)
    console.print(
        f"{selection.seconds:.3f} s, {selection.portions_read} of "
        f"{len(selection.map.portions)} portions read, {selection.bytes_read / 1e6:.1f} MB"
    )
    if show_rays and selection.matched:
        ids = selection.ray_ids
        shown = " ".join(str(number) for number in ids[:40].tolist())
        console.print(f"rays {shown}{' …' if len(ids) > 40 else ''}", soft_wrap=True)


def print_paths(table: PathTable, top: int | None, numbers: Sequence[PathNumbers] = ()) -> None:
    """The path table, strongest first; a sentence where no ray is in it."""
    if not any(row.rays for row in table.rows(top)):
        _console().print("no paths: no ray of the map satisfies what was asked")
        return
    unit = table.map.directory.flux_unit
    view = Table(title=f"{table.n_paths:,} paths by {table.by}, {table.total:.6g} {unit}")
    view.add_column("#", justify="right")
    for name in ("rays", f"flux [{unit}]", "±", "share"):
        view.add_column(Text(name), justify="right", no_wrap=True)
    with_peak = table._peaks is not None
    if with_peak:
        view.add_column("peak cell", no_wrap=True)
    for each in numbers:
        unit_of = f" [{each.unit}]" if each.unit else ""
        view.add_column(Text(f"{each.quantity}{unit_of}"), no_wrap=True)
        view.add_column("spread", no_wrap=True)
    view.add_column("path", overflow="fold")
    for number, row in enumerate(table.rows(top), 1):
        cells = [
            str(number) if row.criterion else "",
            f"{row.rays:,}",
            _number(row.flux, 5),
            marked(_number(row.flux_se, 2), row.flux, row.flux_se),
            f"{row.share:.3%}",
        ]
        if with_peak:
            cells.append("" if row.peak is None else f"{row.peak[0]}, {row.peak[1]}")
        for each in numbers:
            own = each.of.get(row.path)
            cells += ["", ""] if own is None else [
                f"{own.mean:.7g} ± {own.mean_se:.2g}", f"{own.spread:.3g}"
            ]  # fmt: skip
        view.add_row(*cells, Text(_shorter(row.path)))
        if is_doubtful(row.flux, row.flux_se):
            view.caption = Text(FOOTNOTE)
    _console().print(view)
    for each in numbers:
        if each.undefined:
            why = f": {each.reason}" if each.reason else ""
            _console().print(
                f"{each.quantity}: {each.undefined:,} rays have no such number{why}", markup=False
            )


def _shorter(path: str) -> str:
    """The itinerary without the word that nearly every point of a lens has, repetitions counted.

    Dots in names lose their backslash: objects are split from faces at the last dot anyway.
    """
    words = [word.removesuffix(":refracted") for word in re.split(r"(?<!\\) ", path)]
    return " ".join(_counted(words)).replace(r"\.", ".")


def _counted(words: list[str]) -> list[str]:
    """Words with what repeats in brackets, as a path expression writes it."""
    short: list[str] = []
    at = 0
    while at < len(words):
        best, period, times = 0, 1, 1
        for length in range(1, min(_LONGEST, (len(words) - at) // 2) + 1):
            unit, count = words[at : at + length], 1
            while words[at + count * length : at + (count + 1) * length] == unit:
                count += 1
            saved = length * (count - 1)
            if saved > best and length * count >= _WORTH:
                best, period, times = saved, length, count
        unit = words[at : at + period]
        short += [f"({' '.join(unit)}){{{times}}}"] if times > 1 else unit
        at += period * times
    return short


def print_rows(
    rows: list[dict[str, Any]],
    title: str,
    unit: str = "",
    errors: list[dict[str, float]] | None = None,
) -> None:
    """Dictionaries with equal keys as a table; ``unit`` of columns that are called flux.

    Where an error is above 30 % of its number it is marked, in its own column ``…_se``; numbers
    whose error has no column are marked themselves.

    Parameters
    ----------
    errors : for each row the standard errors that have no column, by the number's name
    """
    apart: list[dict[str, float]] = errors or [{} for _ in rows]
    view = Table(title=Text(title))
    # What is doubtful is marked in its place
    names = [name for name in (rows[0] if rows else []) if name != "doubtful"]
    for name in names:
        numeric = isinstance(rows[0][name], int | float)
        justify: Any = "right" if numeric else "left"
        view.add_column(Text(_heading(name, unit)), justify=justify, overflow="fold")
    for row, own in zip(rows, apart, strict=True):
        value_and_se = {name: _known(row, own, name) for name in names}
        cells = (marked(_cell(row[name], name), *value_and_se[name]) for name in names)
        view.add_row(*(Text(cell) for cell in cells))
        if any(is_doubtful(*pair) for pair in value_and_se.values()):
            view.caption = Text(FOOTNOTE)
    _console().print(view)


def _known(
    row: dict[str, Any], apart: dict[str, float], name: str
) -> tuple[float | None, float | None]:
    """The number and the error that the mark in a column speaks of."""
    if name.endswith("_se"):
        return row[name.removesuffix("_se")], row[name]
    return row[name], apart.get(name)


def _heading(name: str, unit: str) -> str:
    """A key of JSON as the head of a column."""
    if name.endswith("_se"):
        return "±"
    return name.replace("_", " ") + (f" [{unit}]" if unit and "flux" in name else "")


def _cell(value: Any, name: str = "") -> str:
    if name == "path":
        return _shorter(str(value))
    if name == "share":
        return f"{value:.3%}"
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return "" if value is None else str(value)


def print_report(ray: dict[str, Any]) -> None:
    """One ray, a row for each of its points."""
    unit = ray["units"]["length"]
    console = _console()
    console.print(
        f"ray {ray['ray_id']} from {ray['source']}, {len(ray['points'])} points, "
        f"length {ray['length']:.6g} {unit}, flux {ray['flux']:.4g} {ray['units']['flux']}",
        markup=False,
    )
    view = Table(show_lines=True)
    view.add_column("#", justify="right")
    view.add_column(Text(f"position [{unit}]"), justify="right", no_wrap=True)
    view.add_column("at, events", overflow="fold", ratio=3)
    view.add_column("incidence", justify="right", no_wrap=True)
    view.add_column("then through", overflow="fold", ratio=2)
    view.add_column(Text(f"length [{unit}]"), justify="right", no_wrap=True)
    view.add_column("light", overflow="fold", ratio=2)
    with_state = any("polarisation" in point or "optical_path" in point for point in ray["points"])
    if with_state:
        view.add_column("polarisation, optical path", overflow="fold", ratio=2)
    if any(point["detectors"] for point in ray["points"]):
        view.add_column("detectors", overflow="fold", ratio=2)
    for number, point in enumerate(ray["points"]):
        cells: list[str | Text] = [
            str(number),
            "\n".join(f"{x:.4f}" for x in point["position"]),
            Text("\n".join(filter(None, (_place(point), ", ".join(point["events"]))))),
            "" if point["incidence_deg"] is None else f"{point['incidence_deg']:.3f}°",
            Text("\n".join(filter(None, (point["medium"], _medium(point))))),
            _number(point["length"]),
            _light(point),
        ]
        if with_state:
            cells.append(Text(_state(point)))
        if len(view.columns) > len(cells):
            cells.append(Text(_crossings(point)))
        view.add_row(*cells)
    console.print(view)


def _place(point: dict[str, Any]) -> str:
    if point["object"] is None:
        return ""
    face = f".{point['face']}" if point["face"] else ""
    return f"{point['object']}{face}"


def _medium(point: dict[str, Any]) -> str:
    """Refractive index, by channel where the light is mixed, and further parameters."""
    index = point["refractive_index"]
    if isinstance(index, dict):
        words = [f"n {value:.6f} {name}" for name, value in index.items()]
    else:
        words = [] if index is None else [f"n {index:.6f}"]
    for name, value in (point["medium_parameters"] or {}).items():
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            words.append(plain_text(f"{name} {value}"))
    return "\n".join(words[:4])


def _light(point: dict[str, Any]) -> Text:
    """A patch in the ray's colour, and its channels."""
    lit = {name: share for name, share in point["spectrum"].items() if share > 0}
    if len(lit) == 1:
        words = next(iter(lit))
    elif len(lit) <= 3:
        words = " ".join(f"{name} {share:.2f}" for name, share in lit.items())
    else:
        words = f"{len(lit)} channels"
    text = Text()
    if point["color"] is not None:
        r, g, b = (round(255 * x) for x in encode_srgb(point["color"]).tolist())
        text.append("██ ", style=f"rgb({r},{g},{b})")
    return text.append(words)


def _state(point: dict[str, Any]) -> str:
    """Degree, azimuth and ellipse of the light that goes on, and the optical path so far."""
    words = []
    state = point.get("polarisation")
    if state is not None:
        words.append(f"{state['degree']:.2%}")
        if state["angle_deg"] is not None:
            words.append(f"at {state['angle_deg']:.2f}°")
        if state["handedness"] in ("left", "right"):
            words.append(f"{state['handedness']} {state['axis_ratio']:.3f}")
    path = point.get("optical_path")
    if isinstance(path, int | float):
        words.append(f"path {path:.6g}")
    return "\n".join(words)


def _crossings(point: dict[str, Any]) -> str:
    return ", ".join(
        f"{met['detector']} ({met['cell'][0]}, {met['cell'][1]})"
        + ("" if met["registered"] else " not registered")
        for met in point["detectors"]
    )
