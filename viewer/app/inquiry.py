"""The questions that are asked whichever panel is open, each answered as values for the page.

Everything here may run in a worker thread; nothing touches the page.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from raymap.model.doubt import FOOTNOTE, MARK, marked
from viewer.app.session import Session
from viewer.drawn.answers import Drawing, count_rays, draw_rays
from viewer.drawn.rays import DrawnRays

__all__ = ["Inquiry", "criterion_error"]

Cancel = Callable[[], bool]


def criterion_error(error: Exception) -> dict[str, str]:
    """A message, and the line with carets below it if it has one."""
    message, _, caret = str(error).partition("\n")
    return {"message": message, "caret": caret}


class Inquiry:
    """Asks for what the page shows whichever panel is open: the rays, their number and flux."""

    def __init__(self, session: Session) -> None:
        self.session = session

    def answer(self, cancel: Cancel, progress: Callable[[Any], None]) -> dict[str, Any]:
        """How many rays satisfy the criterion, and their flux."""
        text = self.session.state.criterion
        found = count_rays(self.session.map, text, cancel=cancel, progress=progress)
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

    def draw(
        self, cancel: Cancel, early: Callable[[dict[str, Any]], None] | None = None
    ) -> dict[str, Any]:
        """Read the rays to draw; ``early`` is told when some of them can be shown."""
        session = self.session
        state = session.state
        paths = [(text, session.path_names.get(text, text)) for text in state.paths]

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
