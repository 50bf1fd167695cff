"""The application: joins the session, its questions and the page."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from raymap.errors import RayMapError
from raymap.events import FAMILIES
from viewer.answers import check_criterion, path_of_ray
from viewer.completion import complete
from viewer.export import to_glb, to_vtp
from viewer.falsecolor import COLORMAPS
from viewer.inquiry import Inquiry, criterion_error
from viewer.panel_criterion import CriterionShelf, choices
from viewer.panel_scene import section_fields, section_of
from viewer.session import Session
from viewer.state import (
    COLOR_RULES,
    Clip,
    Region,
    StateError,
    ViewState,
    state_from_address,
    state_from_json,
    state_to_address,
    state_to_json,
)
from viewer.templates import template
from viewer.tree import (
    add_node,
    count_node,
    criterion_tree,
    make_atom,
    negate_node,
    remove_node,
    set_group,
    tree_text,
    with_region,
)

if TYPE_CHECKING:
    from raymap.reader import RayMap

__all__ = ["Application", "view"]

RAY_STEPS = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000)

LOOK = ("color", "width", "opacity", "fade", "body_opacity", "names", "dark")
"""Fields of the page that change the picture alone."""

DETECTOR = ("detector", "log_scale", "colormap", "image", "binning")
SECTION = ("section_on", "section_side", "section_place", "section_rays")
CLIP = ("clip_event", "clip_after", "clip_until")

REFRESH_SECONDS = 2.0
"""How often a map that is still recorded is looked at again."""

EXPORTS = (
    ("session", "Save this session", "mdi-content-save-outline"),
    ("png", "Picture (PNG)", "mdi-image-outline"),
    ("glb", "Scene with rays (glTF)", "mdi-cube-outline"),
    ("vtp", "Rays (VTK PolyData)", "mdi-vector-polyline"),
)


class Application:
    """One map on one page; several tabs of it share the session.

    Parameters
    ----------
    server : a trame server that is not yet started
    ray_map : an open map
    state : where to begin
    """

    def __init__(self, server: Any, ray_map: RayMap, state: ViewState | None = None) -> None:
        self.server, self.page = server, server.state
        self.session = Session(ray_map, state)
        self.inquiry = Inquiry(self.session)
        self.shelf = CriterionShelf()
        self._painting = ThreadPoolExecutor(1, "paint")
        self._asking = ThreadPoolExecutor(2, "ask")
        self._tasks: set[asyncio.Task[Any]] = set()
        self._cancel = threading.Event()
        self._number = 0
        self._progress = 0.0
        self._tabs = 0
        self._size = (900, 700)
        self._quiet = False
        self._damage_told = 0
        self._page()
        self._connect()
        self._push()

    # -- setting up ----------------------------------------------------------------------------

    def _page(self) -> None:
        """The markup, and every name that it uses."""
        from trame.ui.vuetify3 import VAppLayout

        directory = self.session.map.directory
        self.page.trame__title = f"{self.session.map.path.name} – Raymap"
        self.page.update(
            {
                "version": 0, "messages": [], "searching": False, "progress": 0.0, "answered": 0,
                "menu": False, "panel_busy": False, "file": None, "address": "", "parallel": True,
                "criterion_error": None, "answer_text": "", "answer_flux": "", "answer_title": "",
                "drawn_text": "", "legend": {"title": "", "scale": False, "entries": []},
                "tree": [], "tree_place": None, "atom_kind": "hit", "atom_event": "reflected",
                "count_compare": ">=", "count_value": 2, "save_name": "",
                "path_table": [], "paths_note": "", "paths_message": "", "paths_by": "face",
                "ghosts_only": False, "sort": "flux", "checked_paths": [], "ghost_matrix": "",
                "many_sources": len(directory.sources) > 1,
                "detectors": [entry.name for entry in directory.detectors], "shape": "rect",
                "detector_cells": None, "image_selected": "", "image_full": "", "image_low": "",
                "image_high": "", "image_gradient": "", "image_peaks": ["", ""],
                "detector_note": "", "detector_facts": [],
                "detector_sections": "", "detector_total": "",
                "report": None, "report_error": "", "report_point": None, "ray_text": "",
                "color_rules": [
                    {"value": rule, "title": rule.replace("_", " ").replace("ending", "last event")}
                    for rule in COLOR_RULES
                ],
                "colormaps": list(COLORMAPS), "ray_steps": [f"{n:,}" for n in RAY_STEPS],
                "clip_events": list(FAMILIES),
                "exports": [
                    {"kind": kind, "title": title, "icon": icon} for kind, title, icon in EXPORTS
                ],
                **choices(directory),
            }
        )  # fmt: skip
        self.page.client_only("menu", "save_name")
        markup = template("page")
        for part in ("controls", "view", "criterion", "detector", "paths", "report"):
            markup = markup.replace(f"@{part}@", template(part))
        with VAppLayout(self.server) as layout:
            layout.root.add_child(markup)

    def _connect(self) -> None:
        """Hang the functions that the page calls on the server."""
        calls: dict[str, Callable[..., Any]] = {
            "frame": self.frame, "pick": self.pick, "hover": self.hover, "camera": self.look,
            "criterion": self.set_criterion, "complete": self.complete, "cancel": self.cancel,
            "restore": self.restore, "load": self.load, "hello": self.hello,
            "rays": self.set_rays, "object": self.toggle_object, "opacity": self.set_opacity,
            "tree": self.edit_tree, "add": self.add_atom, "shelf": self.use_shelf,
            "region": self.set_region, "place": self.set_place,
            "path": self.choose_path, "sort": self.sort_paths, "ghost": self.choose_ghost,
            "ray": self.open_ray, "step_ray": self.step_ray, "point": self.choose_point,
            "same_path": self.select_path_of_ray,
            "export": self.export, "dismiss": self.dismiss,
        }  # fmt: skip
        for name, function in calls.items():
            self.server.controller.trigger(f"rm_{name}")(self._guarded(function))
        change = self.page.change
        change(*LOOK)(self._guarded(self._take_look))
        change(*DETECTOR)(self._guarded(self._take_detector))
        change(*SECTION)(self._guarded(self._take_section))
        change(*CLIP)(self._guarded(self._take_clip))
        change("panel")(self._guarded(self._take_panel))
        change("paths_by", "ghosts_only")(self._guarded(self._take_paths))
        controller = self.server.controller
        controller.on_server_ready.add(self._begin)
        controller.on_client_exited.add(lambda **_: self._count_tabs(-1))

    def _guarded(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Turn refused requests into messages on the page; the server goes on."""

        async def call(*arguments: Any, **_: Any) -> Any:
            try:
                result = function(*arguments)
                return await result if asyncio.iscoroutine(result) else result
            except RayMapError as error:
                self.say(str(error), "error")
            except (TypeError, ValueError, KeyError, IndexError, AttributeError) as error:
                # Whatever a page may send, it ends here
                self.say(f"this was not understood ({type(error).__name__}: {error})", "error")
            return None

        return call

    def _begin(self, **_: Any) -> None:
        """Once the server runs: look for the first answer, watch a growing map."""
        self._spawn(self._answer())
        if not self.session.map.finished:
            self._spawn(self._watch())

    def close(self) -> None:
        """End running searches."""
        self._cancel.set()
        for task in self._tasks:
            task.cancel()
        self._painting.shutdown(wait=False, cancel_futures=True)
        self._asking.shutdown(wait=False, cancel_futures=True)

    def _spawn(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _ask(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._asking, function, *arguments)

    # -- messages ------------------------------------------------------------------------------

    def say(self, text: str, kind: str = "note") -> None:
        """Show a message in the page; the same one only once."""
        with self.page:
            others = [item for item in self.page.messages if item["text"] != text]
            key = int(time.monotonic() * 1e6)
            self.page.messages = [*others[-2:], {"key": key, "text": text, "kind": kind}]

    def dismiss(self, key: int) -> None:
        """Close a message."""
        self.page.messages = [item for item in self.page.messages if item["key"] != key]

    def hello(self) -> None:
        """A tab was opened."""
        self._count_tabs(1)

    def _count_tabs(self, step: int) -> None:
        self._tabs = max(0, self._tabs + step)
        if self._tabs > 1 and step > 0:
            self.say(f"This session is open in {self._tabs} tabs; all of them show the same.")

    def _tell_damage(self) -> None:
        """Say once what could not be read."""
        damage = self.session.map.damage
        if len(damage) > self._damage_told:
            lost = ", ".join(
                f"portion {item.portion}" if item.portion is not None else f"bytes at {item.offset}"
                for item in damage[:3]
            )
            more = f" and {len(damage) - 3} more" if len(damage) > 3 else ""
            self.say(
                f"The map is damaged: {lost}{more} cannot be read and are left out "
                f"({damage[-1].reason}). `raymap repair` saves the rest.",
                "error",
            )
        self._damage_told = len(damage)

    # -- state of the page ---------------------------------------------------------------------

    def _push(self) -> None:
        """Show the whole state in the page."""
        state, ray_map = self.session.state, self.session.map
        self._quiet = True
        step = sum(1 for number in RAY_STEPS if number < state.rays)
        count = f"{ray_map.rays:,} rays"
        with self.page:
            self.page.update(
                {
                    **{name: getattr(state, name) for name in (*LOOK, *DETECTOR)},
                    **section_fields(state, ray_map.directory),
                    **self.shelf.fields(),
                    "criterion": state.criterion, "panel": state.panel,
                    "detector": self.inquiry.detector_name(),
                    "clip_event": state.clip.event, "clip_after": state.clip.after,
                    "clip_until": state.clip.until,
                    "ray_step": min(step, len(RAY_STEPS) - 1), "rays_text": f"{state.rays:,}",
                    "objects": self.session.objects(),
                    "region": self._region(),
                    "point": state.point, "parallel": self._parallel(),
                    "map_name": ray_map.path.name, "map_title": str(ray_map.path),
                    "map_rays": count, "recording": not ray_map.finished,
                }
            )  # fmt: skip
        self._quiet = False

    def _parallel(self) -> bool:
        camera = self.session.state.camera
        return camera is None or camera.parallel

    def _repaint(self, **fields: Any) -> None:
        """Show a new picture, and the session in the address."""
        with self.page:
            self.page.update(fields)
            self.page.version += 1
            self.page.address = state_to_address(self.session.state)
            self.page.parallel = self._parallel()

    def _change(self, **changes: Any) -> bool:
        """Take changes from the page, checked as a saved session would be."""
        merged = asdict(self.session.state)
        merged.update({name: _plain(value) for name, value in changes.items()})
        checked = state_from_json(merged)
        return self.session.update(**{name: getattr(checked, name) for name in changes})

    def _take_look(self) -> None:
        if not self._quiet and self._change(**{name: self.page[name] for name in LOOK}):
            self._repaint(legend=self.session.legend(), objects=self.session.objects())

    def _take_section(self) -> None:
        side, place = str(self.page.section_side), float(self.page.section_place)
        section = section_of(
            side, place, on=bool(self.page.section_on), rays=bool(self.page.section_rays)
        )
        if not self._quiet and self._change(section=section):
            fields = section_fields(self.session.state, self.session.map.directory)
            self._repaint(**fields, **self.inquiry.drawn())

    def _take_clip(self) -> None:
        clip = Clip(
            event=str(self.page.clip_event),
            after=int(self.page.clip_after or 0),
            until=int(self.page.clip_until or 0),
        )
        if not self._quiet and self._change(clip=clip):
            self._repaint(**self.inquiry.drawn())

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

    def restore(self, text: str) -> None:
        """Take the session of an address."""
        if text and text != state_to_address(self.session.state):
            self._restart(state_from_address(str(text)))

    def load(self, text: str) -> None:
        """Take the session of a file that was opened in the page."""
        import json

        try:
            values = json.loads(text)
        except ValueError:
            raise StateError("this file is no saved session (not JSON)") from None
        self._restart(state_from_json(values))

    def _restart(self, state: ViewState) -> None:
        self.session.state = state
        self.session.chosen, self.inquiry.report = None, None
        self._push()
        self._spawn(self._answer())

    # -- 3D ------------------------------------------------------------------------------------

    async def frame(self, request: dict[str, Any]) -> dict[str, Any]:
        """The picture for a tab, after what its mouse did."""
        width, height = _size(request)
        self._size = (width, height)
        moved = any(key in request for key in ("orbit", "pan", "zoom"))
        if moved:
            at = (float(request["x"]), float(request["y"])) if "x" in request else None
            self.session.move(
                width, height, turn=_pair(request.get("orbit")), shift=_pair(request.get("pan")),
                enlarge=float(request.get("zoom", 1.0)), at=at,
            )  # fmt: skip
        coarse = bool(request.get("coarse"))
        ratio = min(2.0, max(0.5, float(request.get("ratio", 1))))
        image = await asyncio.get_running_loop().run_in_executor(
            self._painting,
            lambda: self.session.frame(width, height, ratio, coarse=coarse),
        )
        if not coarse:
            with self.page:
                self.page.address = state_to_address(self.session.state)
        return {"image": image, "type": "image/jpeg", "coarse": coarse}

    async def pick(self, request: dict[str, Any]) -> None:
        """A click in the scene: open the report of the ray there."""
        place = float(request["x"]), float(request["y"])
        found = await self._ask(self.session.pick, *place, *_size(request))
        if found is None:
            return
        await self.open_ray(str(found[0]), found[1])

    async def hover(self, request: dict[str, Any]) -> str:
        """What is under the mouse."""
        place = float(request["x"]), float(request["y"])
        text: str = await self._ask(self.session.hover, *place, *_size(request))
        return text

    def look(self, name: str) -> None:
        """A standard view, fit, parallel or perspective."""
        self.session.look(str(name), *self._size)
        self._repaint()

    async def set_rays(self, step: int) -> None:
        """How many rays are drawn."""
        number = RAY_STEPS[min(max(int(step), 0), len(RAY_STEPS) - 1)]
        if self.session.update(rays=number):
            with self.page:
                self.page.rays_text, self.page.ray_step = f"{number:,}", int(step)
            await self._redraw()

    def toggle_object(self, name: str) -> None:
        """Hide or show an object."""
        self.session.toggle_object(str(name))
        self._repaint(objects=self.session.objects())

    def set_opacity(self, name: str, opacity: float) -> None:
        """Opacity of one object."""
        self.session.set_opacity(str(name), float(opacity))
        self._repaint(objects=self.session.objects())

    # -- criterion -----------------------------------------------------------------------------

    def complete(self, text: str, cursor: int) -> dict[str, Any]:
        """Proposals for the editor."""
        start, found = complete(str(text), int(cursor), self.session.map.directory)
        return {"from": start, "items": [asdict(item) for item in found]}

    async def set_criterion(self, text: str) -> None:
        """A new criterion, from the editor, the tree or a list."""
        text = str(text).strip()
        if text == self.session.state.criterion and self.page.criterion_error is None:
            return
        try:
            check_criterion(self.session.map, text)
        except RayMapError as error:
            with self.page:
                self.page.criterion_error = criterion_error(error)
            return
        self.session.update(criterion=text, paths=())
        with self.page:
            self.page.update(
                {
                    "criterion": text,
                    "criterion_error": None,
                    "tree_place": None,
                    "region": self._region(),
                }
            )
        await self._answer()
        self.shelf.use(text)
        with self.page:
            self.page.update(self.shelf.fields())

    async def edit_tree(self, action: str, key: str, value: str) -> None:
        """Edit one node of the tree."""
        tree = criterion_tree(self.session.state.criterion)
        place = _place(key)
        if tree is None:
            return
        if action == "remove":
            new = remove_node(tree, place)
        elif action == "not":
            new = negate_node(tree, place)
        elif action == "group":
            new = set_group(tree, place, str(value))
        else:
            compare, number = str(value).split(" ")
            new = count_node(tree, place, compare, int(number))
        await self.set_criterion(tree_text(new))

    async def add_atom(self, join: str, kind: str, name: str, event: str) -> None:
        """Add a condition to the chosen line of the tree."""
        tree = criterion_tree(self.session.state.criterion)
        place = _place(self.page.tree_place or "") if tree is not None else ()
        atom = make_atom(str(kind), str(name), str(event) if kind in ("hit", "event") else "")
        await self.set_criterion(tree_text(add_node(tree, place, atom, str(join))))

    def use_shelf(self, action: str, name: str) -> None:
        """Save or forget a criterion."""
        if action == "save":
            self.shelf.save(str(name), self.session.state.criterion)
        else:
            self.shelf.forget(str(name))
        with self.page:
            self.page.update(self.shelf.fields())

    # -- searching -----------------------------------------------------------------------------

    def cancel(self) -> None:
        """Stop the running search."""
        self._cancel.set()

    def _note_progress(self, progress: Any) -> None:
        self._progress = float(progress.fraction)

    async def _follow(self, number: int) -> None:
        """Show the progress of a search that takes a while."""
        while number == self._number:
            await asyncio.sleep(0.25)
            with self.page:
                self.page.progress = max(0.03, self._progress)

    async def _answer(self) -> None:
        """Answer the criterion: rays, picture, table, images; a newer question ends this one."""
        self._cancel.set()
        cancel = self._cancel = threading.Event()
        self._number += 1
        number = self._number
        self._progress = 0.0
        with self.page:
            self.page.update({"searching": True, "progress": 0.0})
        self._spawn(self._follow(number))
        try:
            fields = await self._ask(self.inquiry.draw, cancel.is_set, self._early())
            if number != self._number:
                return
            self._repaint(**fields)
            fields = await self._ask(self.inquiry.answer, cancel.is_set, self._note_progress)
            if number != self._number:
                return
            with self.page:
                self.page.update({**fields, "criterion_error": None})
            await self._fill_panel(cancel)
        except RayMapError as error:
            if number == self._number:
                with self.page:
                    self.page.criterion_error = criterion_error(error)
                self.say(str(error).partition("\n")[0], "error")
        finally:
            if number == self._number:
                self._number += 1
                with self.page:
                    self.page.update({"searching": False, "answered": self.page.answered + 1})
                self._tell_damage()

    async def _fill_panel(self, cancel: threading.Event, panel: str | None = None) -> None:
        """What the open panel shows of the selection."""
        shown = panel or self.session.state.panel
        inquiry, asked = self.inquiry, self._number
        steps: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        if shown == "paths":
            by, ghosts = str(self.page.paths_by), bool(self.page.ghosts_only)
            steps = [
                (inquiry.paths, (by, ghosts, str(self.page.sort), cancel.is_set)),
                (inquiry.ghosts, (cancel.is_set,)),
            ]
        elif shown == "detector":
            steps = [(inquiry.look_at_detector, (cancel.is_set,))]
        elif shown == "criterion":
            with self.page:
                self.page.tree = inquiry.plain_tree()
            steps = [(lambda c: {"tree": inquiry.tree(c)}, (cancel.is_set,))]
        elif shown == "report" and self.session.state.ray is not None and inquiry.report is None:
            await self.open_ray(str(self.session.state.ray), self.session.state.point)
        with self.page:
            self.page.panel_busy = bool(steps)
        for function, arguments in steps:
            fields = await self._ask(function, *arguments)
            if cancel.is_set() and asked != self._number:
                return
            with self.page:
                self.page.update(fields)
        with self.page:
            self.page.panel_busy = False

    async def _redraw(self) -> None:
        """Other rays of the same selection."""
        with self.page:
            self.page.searching = True
        try:
            fields = await self._ask(self.inquiry.draw, self._cancel.is_set, self._early())
        finally:
            with self.page:
                self.page.searching = False
        if fields:
            self._repaint(**fields)

    def _early(self) -> Callable[[dict[str, Any]], None]:
        """Shows a picture with the first rays, called from a worker."""
        loop = asyncio.get_running_loop()
        return lambda fields: _ignore(loop.call_soon_threadsafe(lambda: self._repaint(**fields)))

    async def _watch(self) -> None:
        """Take in what is recorded meanwhile."""
        while not self.session.map.finished:
            await asyncio.sleep(REFRESH_SECONDS)
            try:
                grown = await self._ask(self.session.map.refresh)
            except (RayMapError, OSError) as error:
                self.say(f"the map cannot be read any more: {error}", "error")
                return
            if grown:
                self._push()
                if not self.page.searching:
                    await self._answer()

    # -- detector ------------------------------------------------------------------------------

    async def set_region(self, region: dict[str, Any] | None) -> None:
        """A region was drawn on the image, or taken away."""
        name = self.inquiry.detector_name()
        if name is None:
            return
        value = None
        if region is not None:
            x0, y0, x1, y1 = (round(float(number), 1) for number in region["values"])
            shape = "ellipse" if region.get("shape") == "ellipse" else "rect"
            value = Region(shape=shape, values=(x0, y0, x1, y1))  # type: ignore[arg-type]
        tree = criterion_tree(self.session.state.criterion)
        await self.set_criterion(tree_text(with_region(tree, name, value)))

    def _region(self) -> dict[str, Any] | None:
        """The region that the criterion demands of the shown detector, to be drawn on it."""
        region = self.inquiry.region()
        return asdict(region) if region is not None else None

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

    # -- paths ---------------------------------------------------------------------------------

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

    # -- report --------------------------------------------------------------------------------

    async def open_ray(self, text: str, point: int | None = None) -> None:
        """Open the report of a ray by its number."""
        try:
            number = int(str(text).strip().replace(",", ""))
        except ValueError:
            with self.page:
                self.page.report_error = f"{text!r} is no ray number"
            return
        try:
            fields = await self._ask(self.inquiry.read_report, number)
        except RayMapError as error:
            with self.page:
                self.page.report_error = str(error)
            return
        self._quiet = True
        self.session.update(ray=number, point=0 if point is None else point, panel="report")
        self._repaint(**fields, **self.inquiry.point_fields(), report_error="", panel="report")
        self._quiet = False

    async def step_ray(self, step: int) -> None:
        """The next or the previous ray."""
        number = self.inquiry.neighbour(int(step))
        if number is not None:
            await self.open_ray(str(number))

    def choose_point(self, point: int) -> None:
        """A point of the report, marked in the scene."""
        self.session.update(point=int(point))
        self._repaint(**self.inquiry.point_fields())

    async def select_path_of_ray(self) -> None:
        """All rays that took the path of this one."""
        if self.session.state.ray is not None:
            ray_map, number = self.session.map, self.session.state.ray
            await self.set_criterion(await self._ask(path_of_ray, ray_map, number))

    # -- files ---------------------------------------------------------------------------------

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
            return to_glb(bodies, shown.lines, shown.rgba), "model/gltf-binary"
        if kind == "vtp":
            return to_vtp(shown.rays, shown.lines, shown.rgba), "application/xml"
        if kind == "session":
            import json

            return json.dumps(state_to_json(session.state), indent=1), "application/json"
        raise StateError(f"there is no export {kind!r}")


def _ignore(_: object) -> None:
    return None


def _plain(value: Any) -> Any:
    return asdict(value) if hasattr(value, "__dataclass_fields__") else value


def _place(key: str) -> tuple[int, ...]:
    return tuple(int(part) for part in str(key).split(".") if part)


def _pair(values: Any) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))


def _size(request: dict[str, Any]) -> tuple[int, int]:
    """Size of the panel, within reason."""
    width, height = int(request["width"]), int(request["height"])
    return min(max(width, 16), 4096), min(max(height, 16), 4096)


def view(map: RayMap, *, state: ViewState | None = None, height: int = 720) -> Any:
    """Show the application: inline in a notebook, else in the browser.

    Parameters
    ----------
    map : an open ray map
    state : where to begin
    height : of the frame in a notebook [pixels]

    Returns
    -------
    `RunningServer`; in a notebook it displays itself. `stop()` ends it.
    """
    from viewer.server import run_in_thread

    running = run_in_thread(map, state)
    running.show(height)
    return running
