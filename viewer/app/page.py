"""The application: its page, and the functions that the page calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from raymap.model.events import FAMILIES
from viewer.app.actions_results import ResultActions
from viewer.app.actions_scene import SceneActions
from viewer.app.core import CLIP, DETECTOR, LOOK, RAY_STEPS, SECTION
from viewer.drawn.falsecolor import COLORMAPS
from viewer.drawn.state import COLOR_RULES, ViewState
from viewer.panels.criterion import choices
from viewer.templates import template

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Application"]

EXPORTS = (
    ("session", "Save this session", "mdi-content-save-outline"),
    ("png", "Picture (PNG)", "mdi-image-outline"),
    ("glb", "Scene with rays (glTF)", "mdi-cube-outline"),
    ("vtp", "Rays (VTK PolyData)", "mdi-vector-polyline"),
)


class Application(SceneActions, ResultActions):
    """One map on the pages of one browser; the parameters are those of `Core`."""

    def __init__(
        self, server: Any, ray_map: RayMap, state: ViewState | None = None, **options: Any
    ) -> None:
        super().__init__(server, ray_map, state, **options)
        self._page()
        self._connect()
        self._push()

    def _page(self) -> None:
        """The markup, and every name that it uses."""
        from trame.ui.vuetify3 import VAppLayout

        directory = self.session.map.directory
        self.page.trame__title = f"{self.session.map.path.name} – Raymap"
        self.page.update(
            {
                "version": 0, "messages": [], "searching": False, "progress": 0.0, "answered": 0,
                "menu": False, "panel_busy": False, "file": None, "address": "", "parallel": True,
                "up": "y",
                "criterion_error": None, "answer_text": "", "answer_flux": "", "answer_title": "",
                "drawn_text": "", "legend": {"title": "", "scale": False, "entries": []},
                "tree": [], "tree_place": None, "atom_kind": "hit", "atom_event": "reflected",
                "count_compare": ">=", "count_value": 2, "save_name": "",
                "path_table": [], "paths_note": "", "paths_message": "", "paths_by": "face",
                "ghosts_only": False, "sort": "flux", "checked_paths": [], "ghost_matrix": "",
                "ghost_note": "", "ghost_reason": "",
                "many_sources": len(directory.sources) > 1,
                "detectors": [entry.name for entry in directory.detectors], "shape": "rect",
                "detector_cells": None, "image_selected": "", "image_full": "", "image_low": "",
                "image_high": "", "image_gradient": "", "image_peaks": ["", ""], "binned": 1,
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
        self.server.controller.on_server_ready.add(self._begin)

    def _begin(self, **_: Any) -> None:
        """Once the server runs: look for the first answer, watch a growing map."""
        self._spawn(self._answer())
        if not self.session.map.finished:
            self._spawn(self._watch())
