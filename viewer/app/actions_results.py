"""Which panel is open, and files to save."""

from __future__ import annotations

import json
from typing import Any

from viewer.app.actions_criterion import CriterionActions
from viewer.drawn.state import StateError, state_to_json
from viewer.export.gltf import to_glb
from viewer.export.vtp import to_vtp

__all__ = ["ResultActions"]


class ResultActions(CriterionActions):
    """What the page asks beside panels, scene and criterion."""

    async def _take_panel(self) -> None:
        if not self.quiet and self.change(panel=self.page.panel):
            await self.fill_panel(self.stopping)
            self.repaint()

    # -- files -----------------------------------------------------------------------------------

    async def export(self, kind: str) -> None:
        """Make a file for the person at the page."""
        name = self.session.map.path.stem
        data, mime = await self.ask(self._file, str(kind))
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
