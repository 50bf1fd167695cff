"""The scene in a window of its own, drawn by VTK; a click says what is there."""

from __future__ import annotations

import math
import os
import sys
from typing import TYPE_CHECKING, Any

from raymap.model.errors import RayMapError
from viewer.drawn.camera import VIEW_ANGLE
from viewer.drawn.state import Camera, Section, ViewState
from viewer.shown.picked import Picked, Sight, pick
from viewer.shown.plotting import PlottedScene, plotted

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Window", "camera_of", "open_window"]

KEYS = "click: what is there    h: hide it    a: show all    c: cut at x = 0    f: fit    q: close"

_STILL = 3
"""Pixels that a mouse may move between press and release of a click."""


def camera_of(plotter: Any) -> Camera:
    """Where a PyVista plotter sees its scene from."""
    camera = plotter.camera
    position, focal = tuple(camera.position), tuple(camera.focal_point)
    height = 2 * camera.parallel_scale
    if not camera.parallel_projection:
        height = 2 * math.dist(position, focal) * math.tan(math.radians(0.5 * VIEW_ANGLE))
    return Camera(
        position=position,
        focal_point=focal,
        view_up=tuple(camera.up),
        height=height,
        parallel=bool(camera.parallel_projection),
    )


class Window:
    """A scene in a PyVista plotter with what mouse and keys do there.

    Parameters
    ----------
    scene : in a plotter that is not yet shown
    title : of the window
    """

    def __init__(self, scene: PlottedScene, title: str) -> None:
        self.scene, self.plotter = scene, scene.plotter
        self.plotter.title = title
        self._pressed = (0, 0)
        self._last: Picked | None = None
        self._say("")
        for key, action in (("h", self.hide), ("a", self.show_all), ("c", self.cut)):
            self.plotter.add_key_event(key, action)
        self.plotter.add_key_event("f", self.fit)
        if self.plotter.iren is not None:
            self.plotter.iren.add_observer("LeftButtonPressEvent", self._press)
            self.plotter.iren.add_observer("EndInteractionEvent", self._release)

    @property
    def state(self) -> ViewState:
        return self.scene.now.state

    def click(self, x: float, y: float) -> Picked:
        """Say what is at a pixel, counted from the upper left corner."""
        width, height = self.plotter.window_size
        sight = Sight(camera=camera_of(self.plotter), x=x, y=y, width=width, height=height)
        now, painter = self.scene.now, self.scene.painter
        shown = painter.cut(now.colored, now.state.section)
        self._last = pick(painter, now.state, shown, sight)
        self._say(self._last.words or "nothing")
        return self._last

    def hide(self) -> None:
        """Hide the object that was clicked last."""
        if self._last is not None and self._last.body is not None:
            self.scene.change(hidden=tuple(sorted({*self.state.hidden, self._last.body})))

    def show_all(self) -> None:
        """Show all objects."""
        self.scene.change(hidden=())

    def cut(self) -> None:
        """Cut bodies and rays at x = 0, or no more."""
        self.scene.change(section=Section(on=not self.state.section.on, normal=(-1.0, 0.0, 0.0)))

    def fit(self) -> None:
        """See everything."""
        self.plotter.reset_camera()

    def _say(self, text: str) -> None:
        color = "white" if self.state.dark else "black"
        self.plotter.add_text(
            f"{text}\n{KEYS}", position="lower_left", font_size=9, color=color, name="words"
        )

    def _press(self, *_: Any) -> None:
        self._pressed = tuple(self.plotter.iren.get_event_position())

    def _release(self, *_: Any) -> None:
        x, y = self.plotter.iren.get_event_position()
        if math.dist((x, y), self._pressed) <= _STILL:
            self.click(x + 0.5, self.plotter.window_size[1] - y - 0.5)


def open_window(
    ray_map: RayMap, state: ViewState, *, criterion: str | None = None, **options: Any
) -> Window:
    """Make a window; ``.plotter.show()`` opens it and returns when it is closed.

    Parameters
    ----------
    ray_map : an open map
    state : what is shown
    criterion : which rays; None takes that of ``state``
    options : of ``pyvista.Plotter``

    Raises
    ------
    MissingExtra
        PyVista is not installed.
    RayMapError
        There is no screen.
    """
    hidden = options.get("off_screen") or os.environ.get("PYVISTA_OFF_SCREEN", "").lower() == "true"
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    if sys.platform == "linux" and not hidden and not any(os.environ.get(s) for s in screens):
        raise RayMapError(
            "there is no screen for a window (DISPLAY is not set): "
            "leave out --window for the browser, or use raymap picture"
        )
    text = state.criterion if criterion is None else criterion
    scene = plotted(ray_map, text or None, rays=state.rays, state=state, **options)
    return Window(scene, f"{ray_map.path.name} – Raymap")
