"""The questions that the panels ask, each answered as values for the page.

Everything here may run in a worker thread; nothing touches the page.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.ghosts import ghost_reflections
from query.atoms.event import event
from raymap.model.directory import Detector
from raymap.model.doubt import FOOTNOTE, MARK, marked
from raymap.model.errors import RayMapError
from raymap.optics.cells import cells_by_angle
from viewer.app.session import Session
from viewer.drawn.answers import (
    Drawing,
    count_rays,
    detector_image,
    draw_rays,
    ghost_matrix,
    join_criteria,
    path_table,
    ray_report,
    read_one,
)
from viewer.drawn.itinerary import headline
from viewer.drawn.rays import DrawnRays
from viewer.drawn.state import Region
from viewer.paint.plots import heat_map
from viewer.panels.criterion import tree_fields
from viewer.panels.detector import (
    Seen,
    calm_binning,
    cross_sections,
    density_facts,
    finest_binning,
    image_url,
    scale_fields,
)
from viewer.panels.paths import path_rows, sort_rows
from viewer.panels.report import point_fields, report_fields
from viewer.panels.tree import criterion_region, criterion_tree, region_values, tree_rows

if TYPE_CHECKING:
    from query.answers.selections.selection import Selection

__all__ = ["GHOSTS", "Inquiry", "criterion_error"]

Cancel = Callable[[], bool]
Image = NDArray[np.float64]

GHOSTS = str((ghost_reflections >= 2) & ~event("scattered"))
"""What the table calls ghosts: at least two reflections where light may pass, too."""

TOP = 60
"""Rows of the path table on the page."""


def criterion_error(error: Exception) -> dict[str, str]:
    """A message, and the line with carets below it if it has one."""
    message, _, caret = str(error).partition("\n")
    return {"message": message, "caret": caret}


class Inquiry:
    """Asks the questions of one session and remembers the last answers."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.found: Selection | None = None
        self.table: list[dict[str, Any]] = []
        self.pairs: list[list[str]] = []
        self.report: dict[str, Any] | None = None
        self.images: tuple[Seen, Seen] | None = None
        self.place: tuple[int, int] | None = None
        self._full: tuple[object, Seen] | None = None

    # -- criterion -----------------------------------------------------------------------------

    def region(self) -> Region | None:
        """The region of the shown detector that the criterion demands."""
        detector = self.detector()
        if detector is None:
            return None
        try:
            return criterion_region(criterion_tree(self.session.state.criterion), detector)
        except RayMapError:
            return None

    def region_in_words(self) -> dict[str, Any] | None:
        """The region as criteria write it: in cells, of a far field in degrees of C and gamma."""
        region, detector = self.region(), self.detector()
        if region is None or detector is None:
            return None
        said = {"shape": region.shape, "values": list(region_values(region, detector))}
        return said if cells_by_angle(detector) is None else said | {"unit": "deg"}

    def answer(self, cancel: Cancel, progress: Callable[[Any], None]) -> dict[str, Any]:
        """How many rays satisfy the criterion, and their flux."""
        text = self.session.state.criterion
        found = count_rays(self.session.map, text, cancel=cancel, progress=progress)
        self.found = found
        unit = self.session.map.directory.flux_unit
        if found.matched:
            said = f"{found.flux:.4g} ± {found.flux_se:.1g} {unit}"
            flux = marked(said, found.flux, found.flux_se)
        elif found.flux_bound_95 is not None:
            flux = f"flux below {found.flux_bound_95:.2g} {unit} (95 %)"
        else:
            flux = ""
        share = f" ({100 * found.matched / found.rays:.3g} %)" if found.rays else ""
        if not found.complete:
            share = ", stopped"
        return {
            "answer_text": f"{found.matched:,} of {found.rays:,} rays{share}",
            "answer_flux": f"{flux} · {found.seconds:.2g} s",
            "answer_title": found.reason or (FOOTNOTE if flux.endswith(MARK) else ""),
        }

    def tree(self, cancel: Cancel) -> list[dict[str, Any]]:
        """The criterion as a tree with the number of rays of each node."""
        rows = tree_rows(criterion_tree(self.session.state.criterion))
        counts: dict[str, str] = {}
        for row in rows:
            if cancel():
                break
            try:
                found = count_rays(self.session.map, row.text, cancel=cancel)
                counts[row.text] = f"{found.matched:,}"
            except RayMapError:
                counts[row.text] = ""
        return tree_fields(rows, counts)

    def plain_tree(self) -> list[dict[str, Any]]:
        """The criterion as a tree, not yet counted."""
        return tree_fields(tree_rows(criterion_tree(self.session.state.criterion)), {})

    # -- rays ----------------------------------------------------------------------------------

    def draw(
        self, cancel: Cancel, early: Callable[[dict[str, Any]], None] | None = None
    ) -> dict[str, Any]:
        """Read the rays to draw; ``early`` is told when some of them can be shown."""
        session = self.session
        state = session.state
        labels = {str(row["criterion"]): headline(str(row["path"])) for row in self.table}
        paths = [(text, labels.get(text, text)) for text in state.paths]

        def preview(rays: DrawnRays) -> None:
            if early is not None and not cancel():
                session.drawing = Drawing(rays=rays, labels={})
                early(self.drawn())

        drawing = draw_rays(
            session.map, state.criterion, state.rays, paths=paths, cancel=cancel, preview=preview
        )
        if cancel():
            return {}
        session.drawing = drawing
        return self.drawn()

    def drawn(self) -> dict[str, Any]:
        """What the 3D panel says of the rays."""
        session = self.session
        count, segments = session.drawing.rays.n_rays, len(session.shown().lines)
        return {
            "drawn_text": f"{count:,} rays, {segments:,} segments drawn",
            "legend": session.legend(),
        }

    # -- paths ---------------------------------------------------------------------------------

    def paths(self, by: str, ghosts: bool, sort: str, cancel: Cancel) -> dict[str, Any]:
        """The path table of the selection."""
        text = self.session.state.criterion
        if ghosts:
            text = join_criteria(text, GHOSTS)
        self.table = path_table(self.session.map, text, by=by, top=TOP, cancel=cancel)
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

    def ghosts(self, cancel: Cancel) -> dict[str, Any]:
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

    # -- detector ------------------------------------------------------------------------------

    def detector_name(self) -> str | None:
        """The detector that is shown."""
        names = [entry.name for entry in self.session.map.directory.detectors]
        chosen = self.session.state.detector
        if chosen in names:
            return chosen
        return names[0] if names else None

    def detector(self) -> Detector | None:
        """The entry of the detector that is shown."""
        name = self.detector_name()
        entries = self.session.map.directory.detectors
        return next((entry for entry in entries if entry.name == name), None)

    def look_at_detector(self, cancel: Cancel) -> dict[str, Any]:
        """Images of the selected rays and of all rays."""
        session = self.session
        name = self.detector_name()
        if name is None:
            return {"detector_cells": None}
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
        name = self.detector_name()
        if name is None or self.images is None:
            return {"detector_cells": None}
        mine, every = self.images
        detector = next(entry for entry in directory.detectors if entry.name == name)
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
        place = self.place
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

    # -- report --------------------------------------------------------------------------------

    def read_report(self, ray_id: int) -> dict[str, Any]:
        """The report of one ray.

        Raises
        ------
        RayNotFound
        """
        self.report = ray_report(self.session.map, ray_id)
        self.session.chosen = read_one(self.session.map, ray_id)
        unit = self.session.map.directory.length_unit
        return {"report": report_fields(self.report, unit), "ray_text": str(ray_id)}

    def point_fields(self) -> dict[str, Any]:
        """The chosen point of the report."""
        point = self.session.state.point
        if self.report is None or point is None:
            return {"report_point": None, "point": point}
        ray_map = self.session.map
        index, _ = ray_map.find_ray(int(self.report["ray_id"]))
        channels = ray_map.channel_sets[ray_map.portions[index].channel_set]
        spectral = channels.wavelengths_nm if channels.kind == "spectral" else None
        labels = [label.removesuffix(" nm") for label in channels.labels]
        fields = point_fields(self.report, point, ray_map.directory.length_unit, labels, spectral)
        return {"report_point": fields, "point": point if fields is not None else None}

    def neighbour(self, step: int) -> int | None:
        """The next or previous drawn ray of the selection."""
        ids = np.sort(self.session.drawing.rays.ray_ids)
        if len(ids) == 0:
            return None
        current = self.session.state.ray
        if current is None:
            return int(ids[0] if step > 0 else ids[-1])
        place = int(np.searchsorted(ids, current, "right" if step > 0 else "left"))
        place = place if step > 0 else place - 1
        return int(ids[place % len(ids)])
