"""What the page asks of detector, paths and report, and of files to save."""

from __future__ import annotations

import json
from typing import Any

from viewer.app.actions_criterion import CriterionActions
from viewer.app.core import DETECTOR
from viewer.drawn.answers import path_of_ray
from viewer.drawn.state import MOST_PATHS, Region, StateError, state_to_json
from viewer.export.gltf import to_glb, to_vtp
from viewer.panels.tree import criterion_tree, tree_text, with_region

__all__ = ["ResultActions"]


class ResultActions(CriterionActions):
    """The panels that show what was found; most of them can also change the criterion."""

    async def _take_detector(self) -> None:
        before = self.inquiry.detector_name()
        changes = {name: self.page[name] for name in DETECTOR}
        if self._quiet or not self._change(**changes):
            return
        if self.inquiry.detector_name() != before:
            self.inquiry.place = None
            await self._fill_panel(self._cancel, "detector")
            self._repaint(region=self._region())
            return
        fields = await self._ask(self.inquiry.detector_fields)
        self._repaint(**fields)

    async def _take_panel(self) -> None:
        if not self._quiet and self._change(panel=self.page.panel):
            await self._fill_panel(self._cancel)
            self._repaint()

    async def _take_paths(self) -> None:
        if not self._quiet:
            await self._fill_panel(self._cancel, "paths")

    # -- detector --------------------------------------------------------------------------------

    async def set_region(self, region: dict[str, Any] | None) -> None:
        """A region was drawn on the image, or taken away."""
        detector = self.inquiry.detector()
        if detector is None:
            return
        value = None
        if region is not None:
            x0, y0, x1, y1 = (round(float(number), 1) for number in region["values"])
            shape = "ellipse" if region.get("shape") == "ellipse" else "rect"
            value = Region(shape=shape, values=(x0, y0, x1, y1))  # type: ignore[arg-type]
        tree = criterion_tree(self.session.state.criterion)
        await self.set_criterion(tree_text(with_region(tree, detector, value)))

    async def set_place(self, place: list[int] | None) -> None:
        """The cell under the mouse: cross sections go through it."""
        cells = self.page.detector_cells
        if place is None or not cells or self.inquiry.images is None:
            return
        u, v = int(place[0]), int(place[1])
        if 0 <= u < cells[0] and 0 <= v < cells[1] and self.inquiry.place != (u, v):
            self.inquiry.place = (u, v)
            fields = await self._ask(self.inquiry.section_fields)
            with self.page:
                self.page.update(fields)

    # -- paths -----------------------------------------------------------------------------------

    async def choose_path(self, action: str, criterion: str) -> None:
        """Show a path alone, or together with others."""
        before = self.session.state.paths
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
        if len(paths) > 1 and self.session.state.color == "natural":
            changes["color"] = "path"
        elif len(paths) <= 1 and len(before) > 1 and self.session.state.color == "path":
            changes["color"] = "natural"
        self.session.update(**changes)
        with self.page:
            self.page.color = self.session.state.color
            self.page.update(self.inquiry.sorted_paths(str(self.page.sort)))
        await self._redraw()

    def sort_paths(self, by: str) -> None:
        """Another order of the table."""
        with self.page:
            self.page.sort = by if by in ("flux", "rays", "path") else "flux"
            self.page.update(self.inquiry.sorted_paths(str(self.page.sort)))

    async def choose_ghost(self, row: str, column: str) -> None:
        """A cell of the ghost matrix: select that pair of reflections."""
        if row != "" and column != "":
            await self.set_criterion(self.inquiry.pairs[int(row)][int(column)])

    # -- report ----------------------------------------------------------------------------------

    async def step_ray(self, step: int) -> None:
        """The next or the previous ray."""
        number = self.inquiry.neighbour(int(step))
        if number is not None:
            await self.open_ray(str(number))

    def choose_point(self, point: int) -> None:
        """A point of the report, marked in the scene."""
        points = len(self.page.report["points"]) if self.page.report else 0
        if not 0 <= int(point) < points:
            raise StateError(f"the report has {points} points")
        self.session.update(point=int(point))
        self._repaint(**self.inquiry.point_fields())

    async def select_path_of_ray(self) -> None:
        """All rays that took the path of this one."""
        if self.session.state.ray is not None:
            ray_map, number = self.session.map, self.session.state.ray
            await self.set_criterion(await self._ask(path_of_ray, ray_map, number))

    # -- files -----------------------------------------------------------------------------------

    async def export(self, kind: str) -> None:
        """Make a file for the person at the page."""
        name = self.session.map.path.stem
        data, mime = await self._ask(self._file, str(kind))
        with self.page:
            self.page.file = {
                "name": f"{name}.{'json' if kind == 'session' else kind}",
                "type": mime,
                "data": data,
            }

    def _file(self, kind: str) -> tuple[Any, str]:
        session = self.session
        shown = session.shown()
        if kind == "png":
            width, height = self._size
            scale = max(1.0, 1920 / max(width, 1))
            return session.picture(round(width * scale), round(height * scale)), "image/png"
        if kind == "glb":
            bodies = session.painter.visible(session.state)
            unit = session.map.directory.length_unit
            data = to_glb(bodies, shown.lines, shown.rgba, length_unit=unit, title="scene")
            return data, "model/gltf-binary"
        if kind == "vtp":
            return to_vtp(shown.rays, shown.lines, shown.rgba), "application/xml"
        if kind == "session":
            return json.dumps(state_to_json(session.state), indent=1), "application/json"
        raise StateError(f"there is no export {kind!r}")
