"""The paths panel: the table of paths, sortable, with paths shown alone, and the ghost matrix."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from query.answers.paths.ghosts import ghost_reflections
from query.atoms.event import event
from raymap.model.doubt import FOOTNOTE, MARK, is_doubtful, marked
from viewer.drawn.answers import ghost_matrix, join_criteria, path_table
from viewer.drawn.falsecolor import PALETTE
from viewer.drawn.itinerary import headline
from viewer.drawn.state import MOST_PATHS, StateError
from viewer.paint.plots import heat_map
from viewer.panels.panel import Application, Panel, Question, Session
from viewer.panels.values import choice, flag
from viewer.templates import template

__all__ = ["GHOSTS", "KINDS", "SORTS", "PathQuestions", "path_rows", "sort_rows"]

SORTS = ("flux", "rays", "path")

GHOSTS = str((ghost_reflections >= 2) & ~event("scattered"))
"""What the table calls ghosts: at least two reflections where light may pass, too."""

TOP = 60
"""Rows of the path table on the page."""


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
        index = list(checked).index(criterion) if criterion in checked else -1
        color = ""
        if index >= 0 and len(checked) > 1:
            color = "#" + "".join(f"{int(part):02x}" for part in PALETTE[index % len(PALETTE)])
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
                "checked": index >= 0,
                "color": color,
            }
        )
    return shown


class PathQuestions:
    """Asks for the paths and ghosts of a session's selection."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.table: list[dict[str, Any]] = []
        self.pairs: list[list[str]] = []

    def paths(self, by: str, ghosts: bool, sort: str, cancel: Callable[[], bool]) -> dict[str, Any]:
        """The path table of the selection."""
        text = self.session.state.criterion
        if ghosts:
            text = join_criteria(text, GHOSTS)
        self.table = path_table(self.session.map, text, by=by, top=TOP, cancel=cancel)
        for row in self.table:
            if row.get("criterion"):
                self.session.path_names[str(row["criterion"])] = headline(str(row["path"]))
        if cancel():
            return {}
        return self.sorted_paths(sort)

    def sorted_paths(self, sort: str) -> dict[str, Any]:
        """The table in an order, with the checked paths marked."""
        unit = self.session.map.directory.flux_unit
        rows = path_rows(sort_rows(self.table, sort), self.session.state.paths, unit)
        count = sum(1 for row in rows if row["criterion"])
        note = f"{count} paths" if count == len(rows) else f"the strongest {count} paths"
        if any(row["flux_note"] for row in rows):
            note += f" · {MARK} error above 30 %"
        return {
            "path_table": rows,
            "paths_note": note if count else "",
            "paths_message": "" if rows else "No ray of the selection takes any path.",
            "checked_paths": list(self.session.state.paths),
        }

    def ghosts(self, cancel: Callable[[], bool]) -> dict[str, Any]:
        """The matrix of pairs of reflecting faces in the selection."""
        found = ghost_matrix(self.session.map, self.session.state.criterion, cancel=cancel)
        if cancel():
            return {"ghost_matrix": "", "ghost_note": "", "ghost_reason": ""}
        if isinstance(found, str):
            return {
                "ghost_matrix": "",
                "ghost_note": "no ghosts of two reflections",
                "ghost_reason": found,
            }
        # Only faces that reflect first make rows, only faces that reflect second make columns
        first = np.flatnonzero(found.flux.any(axis=1))
        second = np.flatnonzero(found.flux.any(axis=0))
        self.pairs = [[found.criterion(int(a), int(b)) for b in second] for a in first]
        rows, columns = ([found.faces[k] for k in places] for places in (first, second))
        values = found.flux[np.ix_(first, second)]
        doubtful = found.doubtful[np.ix_(first, second)]
        picture = heat_map(rows, columns, values, unit=found.flux_unit, doubtful=doubtful)
        note = f"{MARK} error above 30 %" if doubtful.any() else ""
        reason = FOOTNOTE.removeprefix(f"{MARK} ") if note else ""
        return {"ghost_matrix": picture, "ghost_note": note, "ghost_reason": reason}


def _questions(app: Application) -> PathQuestions:
    found: PathQuestions = app.questions["paths"]
    return found


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
        app.page.update(_questions(app).sorted_paths(str(app.page.sort)))
    await app.redraw()


def sort_paths(app: Application, by: str) -> None:
    """Another order of the table."""
    with app.page:
        app.page.sort = by if by in SORTS else "flux"
        app.page.update(_questions(app).sorted_paths(str(app.page.sort)))


async def choose_ghost(app: Application, row: str, column: str) -> None:
    """A cell of the ghost matrix: select that pair of reflections."""
    if row != "" and column != "":
        await app.set_criterion(_questions(app).pairs[int(row)][int(column)])


async def _take_paths(app: Application) -> None:
    if not app.quiet:
        await app.fill_panel(app.stopping, "paths")


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    by, ghosts, sort = str(app.page.paths_by), bool(app.page.ghosts_only), str(app.page.sort)
    return [
        lambda: _questions(app).paths(by, ghosts, sort, cancel.is_set),
        lambda: _questions(app).ghosts(cancel.is_set),
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
        questions=PathQuestions,
        incoming={"paths_by": choice("face", "object"), "ghosts_only": flag},
        actions={"path": choose_path, "sort": sort_paths, "ghost": choose_ghost},
        changes={("paths_by", "ghosts_only"): _take_paths},
        fill=_fill,
    ),
)
