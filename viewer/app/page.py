"""The application: its page, and the functions that the page calls."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from raymap.model.errors import RayMapError
from raymap.model.events import FAMILIES
from viewer.app.actions_gestures import GestureActions
from viewer.app.actions_results import ResultActions
from viewer.app.core import CLIP, LOOK, RAY_STEPS, SECTION
from viewer.drawn.state import COLOR_RULES, ViewState
from viewer.panels.panel import PANELS
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


class Application(GestureActions, ResultActions):
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

        self.page.trame__title = f"{self.session.map.path.name} – Raymap"
        self.page.update(
            {
                "version": 0, "messages": [], "searching": False, "progress": 0.0, "answered": 0,
                "menu": False, "panel_busy": False, "file": None, "address": "", "parallel": True,
                "render": self.render, "can_undo": False, "can_redo": False,
                "up": "y",
                "criterion_error": None, "answer_text": "", "answer_flux": "", "answer_title": "",
                "drawn_text": "", "legend": {"title": "", "scale": False, "entries": []},
                "color_rules": [
                    {"value": rule, "title": rule.replace("_", " ").replace("ending", "last event")}
                    for rule in COLOR_RULES
                ],
                "ray_steps": [f"{n:,}" for n in RAY_STEPS],
                "clip_events": list(FAMILIES),
                "exports": [
                    {"kind": kind, "title": title, "icon": icon} for kind, title, icon in EXPORTS
                ],
                "panels": [{"word": panel.word, "title": panel.title} for panel in PANELS.kinds()],
            }
        )  # fmt: skip
        for panel in PANELS.kinds():
            self.page.update(panel.fields(self))
        self.page.client_only("menu", "save_name")
        markup = template("page")
        for part in ("controls", "view"):
            markup = markup.replace(f"@{part}@", template(part))
        markup = markup.replace("@panels@", "\n".join(p.on_page() for p in PANELS.kinds()))
        with VAppLayout(self.server) as layout:
            layout.root.add_child(markup)

    def _connect(self) -> None:
        """Hang the functions that the page calls on the server."""
        calls: dict[str, Callable[..., Any]] = {
            "frame": self.frame, "hurry": self.hurry,
            "scene": self.scene, "chunk": self.chunk, "eye": self.eye,
            "pick": self.pick, "hover": self.hover, "camera": self.look,
            "criterion": self.set_criterion, "complete": self.complete, "cancel": self.cancel,
            "restore": self.restore, "load": self.load, "hello": self.hello,
            "rays": self.set_rays, "object": self.toggle_object, "opacity": self.set_opacity,
            "export": self.export, "dismiss": self.dismiss, "offer": self.offer,
            "gesture": self.gesture, "undo": self.undo, "redo": self.redo,
        }  # fmt: skip
        for panel in PANELS.kinds():
            for name, action in panel.actions.items():
                if name in calls:
                    raise RayMapError(
                        f"panel {panel.word!r}: there is an action {name!r} already; rename it"
                    )
                calls[name] = self._of_panel(action)
        for name, function in calls.items():
            self.server.controller.trigger(f"rm_{name}")(self._guarded(function))
        change = self.page.change
        change(*LOOK)(self._guarded(self._take_look))
        change(*SECTION)(self._guarded(self._take_section))
        change(*CLIP)(self._guarded(self._take_clip))
        change("panel")(self._guarded(self._take_panel))
        for panel in PANELS.kinds():
            for fields, changed in panel.changes.items():
                change(*fields)(self._guarded(self._of_panel(changed)))
        self.server.controller.on_server_ready.add(self._begin)

    def _of_panel(self, action: Callable[..., Any]) -> Callable[..., Any]:
        """What a panel does, with this application in its first place."""
        if not asyncio.iscoroutinefunction(action):
            return lambda *arguments: action(self, *arguments)

        async def call(*arguments: Any) -> Any:
            return await action(self, *arguments)

        return call

    def _begin(self, **_: Any) -> None:
        """Once the server runs: look for the first answer, watch a growing map."""
        self._spawn(self._answer())
        if not self._told[1]:
            self._spawn(self._watch())
