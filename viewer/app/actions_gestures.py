"""What a right click in the scene offers for the face and the ray under it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from query.atoms.hit import hit
from query.atoms.last import last
from query.expression.names import escape
from raymap.model.errors import RayMapError
from viewer.app.actions_scene import SceneActions, sight_of
from viewer.drawn.answers import join_criteria, path_of_ray
from viewer.drawn.state import StateError

__all__ = ["FACE_CRITERIA", "GestureActions"]

FACE_CRITERIA: dict[str, tuple[str, Callable[[str], Any]]] = {
    "must": ("Must hit it", lambda face: hit(face)),
    "never": ("Must not hit it", lambda face: ~hit(face)),
    "reflected": ("Reflected here", lambda face: hit(face, "reflected")),
    "ended": ("Ended here", lambda face: last(hit(face))),
}
"""Conditions on a face: what the menu says, and the condition of the face as criteria name it."""

_VISIBILITY = {"hide": "Hide", "isolate": "Show it alone"}
_RAY = {"report": "Report", "path": "Select its path", "not_path": "Leave out its path"}


class GestureActions(SceneActions):
    """A menu at the place of a click, and what its entries do."""

    async def offer(self, request: dict[str, Any]) -> dict[str, Any]:
        """What can be done with what is under the mouse, in groups of (what, which, words)."""
        found = await self.ask(self.session.pick, *sight_of(request))
        groups = []
        if found.body is not None:
            face = _pattern(found.body, found.face_name)
            entries = [(do, face, words) for do, (words, _) in FACE_CRITERIA.items()]
            entries += [(do, found.body, words) for do, words in _VISIBILITY.items()]
            groups.append({"title": found.face, "entries": entries})
        if found.ray is not None:
            number = str(found.ray[0])
            entries = [(do, number, words) for do, words in _RAY.items()]
            groups.append({"title": f"ray {number}", "entries": entries})
        if self.session.state.hidden:
            groups.append({"title": "", "entries": [("show", "", "Show all objects")]})
        return {"groups": groups}

    async def gesture(self, do: str, which: str) -> None:
        """Do what an entry of the menu says.

        Raises
        ------
        StateError
            There is no such entry.
        """
        do, which = str(do), str(which)
        criterion = self.session.state.criterion
        if do in FACE_CRITERIA:
            await self.set_criterion(join_criteria(criterion, str(FACE_CRITERIA[do][1](which))))
        elif do in ("path", "not_path"):
            path = await self.ask(path_of_ray, self.session.map, _number(which))
            added = path if do == "path" else f"!({path})"
            await self.set_criterion(join_criteria(criterion, added))
        elif do == "report":
            await self.open_ray(which)
        elif do in ("hide", "isolate", "show"):
            self._show(do, which)
        else:
            raise StateError(f"there is no gesture {do!r}")

    def _show(self, do: str, which: str) -> None:
        names = [body.name for body in self.session.painter.bodies]
        if do != "show" and which not in names:
            raise StateError(f"no object is called {which!r}")
        hidden = {
            "hide": (*(name for name in self.session.state.hidden if name != which), which),
            "isolate": tuple(name for name in names if name != which),
            "show": (),
        }[do]
        self.session.update(hidden=hidden)
        self.repaint(objects=self.session.objects())


def _pattern(body: str, face: str) -> str:
    """A face as criteria name it."""
    return f"{escape(body)}.{escape(face)}" if face else escape(body)


def _number(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise RayMapError(f"{text!r} is no ray number") from None
