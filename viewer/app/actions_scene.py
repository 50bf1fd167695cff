"""What the page asks of the 3D panel and its controls."""

from __future__ import annotations

import threading
from typing import Any

from viewer.app.core import LOOK, RAY_STEPS, Core
from viewer.app.session import MOST_PIXELS_ACROSS
from viewer.drawn.state import Camera, Clip, StateError, read_camera
from viewer.paint.interrupt import Interrupted
from viewer.panels.scene import section_fields, section_of

__all__ = ["SceneActions", "sight_of"]


class SceneActions(Core):
    """The mouse in the scene, and the controls beside it."""

    hurried = threading.Event()
    """Gives up the picture that was asked for last."""

    def _take_look(self) -> None:
        if not self.quiet and self.change(**{name: self.page[name] for name in LOOK}):
            self.repaint(legend=self.session.legend(), objects=self.session.objects())

    def _take_section(self) -> None:
        side, place = str(self.page.section_side), float(self.page.section_place)
        section = section_of(
            side, place, on=bool(self.page.section_on), rays=bool(self.page.section_rays)
        )
        if not self.quiet and self.change(section=section):
            fields = section_fields(self.session.state, self.session.map.directory)
            self.repaint(**fields, **self.inquiry.drawn())

    def _take_clip(self) -> None:
        clip = Clip(
            event=str(self.page.clip_event),
            after=int(self.page.clip_after or 0),
            until=int(self.page.clip_until or 0),
        )
        if not self.quiet and self.change(clip=clip):
            self.repaint(**self.inquiry.drawn())

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
        self.hurried = hurried = threading.Event()
        size = (width, height, ratio)
        try:
            image = await self.paint(
                lambda: self.session.frame(*size, coarse=coarse, cancel=hurried.is_set)
            )
        except Interrupted:
            return {"image": None, "coarse": coarse}
        if not coarse:
            with self.page:
                self.settled()
        return {"image": image, "type": "image/jpeg", "coarse": coarse}

    def hurry(self) -> None:
        """Give up the picture that is being painted: its page wants another one."""
        self.hurried.set()

    async def scene(self, request: dict[str, Any]) -> dict[str, Any]:
        """The parts of the scene that a page holds another revision of, or none."""
        have = {str(name): int(number) for name, number in dict(request.get("have", {})).items()}
        self._size = size = _size(request)
        found: dict[str, Any] = await self.ask(lambda: self.session.scene(*size).message(have))
        return found

    async def chunk(self, name: str, revision: int, start: int) -> bytes | None:
        """Bytes of a large part; None where it is not what holds any more."""
        held = str(name), int(revision), int(start)
        data: bytes | None = await self.ask(self.session.live.chunk, *held)
        return data

    def eye(self, request: dict[str, Any]) -> None:
        """A page that draws by itself has moved the camera."""
        self._size = _size(request)
        self.session.take_camera(request["camera"])
        with self.page:
            self.settled()

    async def pick(self, request: dict[str, Any]) -> None:
        """A click in the scene: open the report of the ray there."""
        found = await self.ask(self.session.pick, *sight_of(request))
        if found.ray is not None:
            await self.open_ray(str(found.ray[0]), found.ray[1])

    async def hover(self, request: dict[str, Any]) -> str:
        """What is under the mouse."""
        found = await self.ask(self.session.pick, *sight_of(request))
        return str(found.words)

    def look(self, name: str) -> None:
        """A standard view, fit, parallel or perspective."""
        self.session.look(str(name), *self._size)
        self.repaint()

    async def set_rays(self, step: int) -> None:
        """How many rays are drawn."""
        number = RAY_STEPS[min(max(int(step), 0), len(RAY_STEPS) - 1)]
        if self.session.update(rays=number):
            with self.page:
                self.page.rays_text, self.page.ray_step = f"{number:,}", int(step)
            await self.redraw()

    def toggle_object(self, name: str) -> None:
        """Hide or show an object."""
        self.session.toggle_object(str(name))
        self.repaint(objects=self.session.objects())

    def set_opacity(self, name: str, opacity: float) -> None:
        """Opacity of one object."""
        self.session.set_opacity(str(name), float(opacity))
        self.repaint(objects=self.session.objects())


def _pair(values: Any) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))


def sight_of(request: dict[str, Any]) -> tuple[float, float, int, int, Camera | None]:
    """The pixel that a request speaks of, the size of its picture, and where that is seen from."""
    return float(request["x"]), float(request["y"]), *_size(request), _camera(request)


def _camera(request: dict[str, Any]) -> Camera | None:
    """Where a page that draws by itself sees the scene from."""
    return None if request.get("camera") is None else read_camera(request["camera"])


def _size(request: dict[str, Any]) -> tuple[int, int]:
    """Size of the panel [pixels of the page].

    Raises
    ------
    StateError
        No screen has such a panel.
    """
    width, height = request["width"], request["height"]
    for value in (width, height):
        if not isinstance(value, int) or not 1 <= value <= MOST_PIXELS_ACROSS:
            raise StateError(
                f"the picture must have 1 to {MOST_PIXELS_ACROSS} pixels across, not {value!r}"
            )
    return max(width, 16), max(height, 16)
