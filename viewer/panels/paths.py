"""The paths panel: the table of paths, sortable, with paths shown alone, and the ghost matrix."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from raymap.model.doubt import FOOTNOTE, MARK, is_doubtful, marked
from viewer.drawn.falsecolor import PALETTE
from viewer.drawn.itinerary import headline
from viewer.drawn.state import MOST_PATHS, StateError
from viewer.panels.panel import Application, Panel, Question
from viewer.panels.values import choice, flag
from viewer.templates import template

__all__ = ["KINDS", "SORTS", "path_rows", "sort_rows"]

SORTS = ("flux", "rays", "path")


def sort_rows(rows: Sequence[dict[str, Any]], by: str) -> list[dict[str, Any]]:
    """Rows of the path table in another order; the remainder stays last."""
    body = [row for row in rows if row["path"] != "remainder"]
    last = [row for row in rows if row["path"] == "remainder"]
    if by == "path":
        return [*sorted(body, key=lambda row: str(row["path"])), *last]
    return [*sorted(body, key=lambda row: -float(row[by])), *last]


def path_rows(
    rows: Sequence[dict[str, Any]], checked: Sequence[str], unit: str
) -> list[dict[str, Any]]:
    """The path table for the page; a checked path gets the colour that its rays have."""
    shown = []
    for number, row in enumerate(rows):
        criterion = str(row.get("criterion") or "")
        flux, se = float(row["flux"]), float(row["flux_se"])
        place = list(checked).index(criterion) if criterion in checked else -1
        color = ""
        if place >= 0 and len(checked) > 1:
            color = "#" + "".join(f"{int(part):02x}" for part in PALETTE[place % len(PALETTE)])
        shown.append(
            {
                "number": number,
                "path": "everything else"
                if row["path"] == "remainder"
                else headline(str(row["path"])),
                "whole": row["path"],
                "source": row.get("source") or "",
                "criterion": criterion,
                "rays": f"{int(row['rays']):,}",
                "flux": f"{flux:.3g} {unit}",
                "flux_se": marked(f"{se:.1g}", flux, se),
                "flux_note": FOOTNOTE.removeprefix(f"{MARK} ") if is_doubtful(flux, se) else "",
                "share": f"{100 * float(row['share']):.3g} %",
                "checked": place >= 0,
                "color": color,
            }
        )
    return shown


async def choose_path(app: Application, action: str, criterion: str) -> None:
    """Show a path alone, or together with others."""
    before = app.session.state.paths
    text = str(criterion)
    if action == "clear" or (action == "only" and before == (text,)):
        paths: tuple[str, ...] = ()
    elif action == "only":
        paths = (text,)
    else:
        paths = tuple(p for p in before if p != text) if text in before else (*before, text)
    if len(paths) > MOST_PATHS:
        raise StateError(f"at most {MOST_PATHS} paths are shown together")
    changes: dict[str, Any] = {"paths": paths}
    if len(paths) > 1 and app.session.state.color == "natural":
        changes["color"] = "path"
    elif len(paths) <= 1 and len(before) > 1 and app.session.state.color == "path":
        changes["color"] = "natural"
    app.session.update(**changes)
    with app.page:
        app.page.color = app.session.state.color
        app.page.update(app.inquiry.sorted_paths(str(app.page.sort)))
    await app.redraw()


def sort_paths(app: Application, by: str) -> None:
    """Another order of the table."""
    with app.page:
        app.page.sort = by if by in SORTS else "flux"
        app.page.update(app.inquiry.sorted_paths(str(app.page.sort)))


async def choose_ghost(app: Application, row: str, column: str) -> None:
    """A cell of the ghost matrix: select that pair of reflections."""
    if row != "" and column != "":
        await app.set_criterion(app.inquiry.pairs[int(row)][int(column)])


async def _take_paths(app: Application) -> None:
    if not app.quiet:
        await app.fill_panel(app.stopping, "paths")


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    by, ghosts, sort = str(app.page.paths_by), bool(app.page.ghosts_only), str(app.page.sort)
    return [
        lambda: app.inquiry.paths(by, ghosts, sort, cancel.is_set),
        lambda: app.inquiry.ghosts(cancel.is_set),
    ]


KINDS = (
    Panel(
        word="paths",
        title="Paths",
        place=30,
        markup=lambda: template("paths"),
        css="rm-paths",
        fields=lambda app: {
            "path_table": [],
            "paths_note": "",
            "paths_message": "",
            "paths_by": "face",
            "ghosts_only": False,
            "sort": "flux",
            "checked_paths": [],
            "ghost_matrix": "",
            "ghost_note": "",
            "ghost_reason": "",
            "many_sources": len(app.session.map.directory.sources) > 1,
        },
        incoming={"paths_by": choice("face", "object"), "ghosts_only": flag},
        actions={"path": choose_path, "sort": sort_paths, "ghost": choose_ghost},
        changes={("paths_by", "ghosts_only"): _take_paths},
        fill=_fill,
    ),
)
