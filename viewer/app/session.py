"""One person's session: the map, what is shown of it, and what the mouse does to it.

Knows nothing of pages and servers, so that everything but the widgets is tested without a browser.
The state is an immutable `ViewState`; pictures are made from it in any thread.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from viewer.drawn.answers import Drawing
from viewer.drawn.camera import STANDARD_VIEWS, UPWARD, fit, orbit, pan, zoom
from viewer.drawn.rays import DrawnRays, no_rays
from viewer.drawn.scene import load_bodies, scene_box
from viewer.drawn.state import Camera, ViewState, check_camera, read_camera
from viewer.paint.interrupt import Cancel
from viewer.paint.overlay import draw_legend
from viewer.paint.painter import Colored, Painter, Shown
from viewer.paint.rendering import encode_jpeg, encode_png
from viewer.shown.live import LiveScene, Snapshot
from viewer.shown.picked import Picked, Sight, pick

if TYPE_CHECKING:
    from raymap.file.reader import RayMap
    from raymap.model.directory import Detector
    from viewer.drawn.bodies import Body

__all__ = ["MOST_PIXELS", "MOST_PIXELS_ACROSS", "Session"]

MOST_PIXELS = 2**23
"""Of a picture for the page: a screen of 3840 × 2160."""

MOST_PIXELS_ACROSS = 16_384
"""Of the panel of a page."""


class Session:
    """A map and what is shown of it.

    Parameters
    ----------
    ray_map : an open map
    state : where to begin
    bodies : of the scene, where they are loaded already

    Attributes
    ----------
    state : what is shown
    drawing : the rays of the selection that are drawn
    chosen : the ray that stands out, or None
    path_names : short names of paths by their criteria, as far as a table has told them
    live : the scene for those who draw it themselves
    """

    def __init__(
        self,
        ray_map: RayMap,
        state: ViewState | None = None,
        bodies: Sequence[Body] | None = None,
    ) -> None:
        ray_map.need_rays()
        self.map = ray_map
        self.state = state or ViewState()
        loaded = load_bodies(ray_map.directory, ray_map.meshes) if bodies is None else bodies
        self.painter = Painter(loaded, ray_map.directory)
        self.drawing = Drawing(rays=no_rays(), labels={})
        self.chosen: DrawnRays | None = None
        self.path_names: dict[str, str] = {}
        self.live = LiveScene(self.painter.bodies, ray_map.directory)
        self._colored: tuple[object, Colored] | None = None
        self._shown: tuple[object, Shown] | None = None
        self._lock = threading.Lock()

    # -- what is shown -------------------------------------------------------------------------

    def update(self, **changes: Any) -> bool:
        """Change fields of the state; true if anything changed."""
        before = self.state
        self.state = replace(before, **changes)
        return self.state != before

    def detector(self) -> Detector | None:
        """The detector that is shown: the first one unless another is chosen."""
        detectors = self.map.directory.detectors
        chosen = [entry for entry in detectors if entry.name == self.state.detector]
        return next(iter([*chosen, *detectors]), None)

    def colored(self) -> Colored:
        """The rays with their colours, remembered until something about them changes."""
        state, drawing = self.state, self.drawing
        key = (drawing, state.clip, state.color, state.opacity, state.fade, state.dark)
        with self._lock:
            if self._colored is None or self._colored[0] != key:
                colored = self.painter.color(state, drawing.rays, drawing.labels)
                self._colored = (key, colored)
            return self._colored[1]

    def shown(self) -> Shown:
        """The same, cut by the section."""
        colored, section = self.colored(), self.state.section
        with self._lock:
            if self._shown is None or self._shown[0] != (colored, section):
                self._shown = ((colored, section), self.painter.cut(colored, section))
            return self._shown[1]

    def scene(self, width: int, height: int) -> LiveScene:
        """The scene as it is now, for a panel of this size [pixels of the page]."""
        snapshot = Snapshot(
            state=self.state,
            colored=self.colored(),
            camera=self.camera(width, height),
            chosen=self.chosen,
        )
        self.live.update(snapshot)
        return self.live

    def camera(self, width: int, height: int) -> Camera:
        """The camera, also before anyone has moved it."""
        return self.painter.camera(self.state, self.shown(), width / max(height, 1))

    # -- the mouse -----------------------------------------------------------------------------

    def move(
        self,
        width: int,
        height: int,
        *,
        turn: tuple[float, float] | None = None,
        shift: tuple[float, float] | None = None,
        enlarge: float = 1.0,
        at: tuple[float, float] | None = None,
    ) -> None:
        """Turn, shift and enlarge by what the mouse did [pixels]; senseless values are ignored."""
        camera = self.camera(width, height)
        numbers = [*(turn or ()), *(shift or ()), *(at or ()), enlarge]
        if not np.isfinite(numbers).all() or not 1e-3 < enlarge < 1e3:
            return
        if turn is not None:
            camera = orbit(camera, *turn, height)
        if shift is not None:
            camera = pan(camera, *shift, height)
        if enlarge != 1.0:
            x, y = at if at is not None else (width / 2, height / 2)
            camera = zoom(camera, enlarge, x, y, width, height)
        check_camera(camera)
        self.update(camera=camera)

    def take_camera(self, values: Any) -> Camera:
        """Take over where a page that draws by itself sees the scene from.

        Raises
        ------
        StateError
            No camera can stand there.
        """
        camera = read_camera(values)
        self.update(camera=camera)
        self.live.told_camera(camera)
        return camera

    def look(self, name: str, width: int, height: int) -> None:
        """Go to a standard view, "fit", "parallel" or "perspective"; "up" takes the next axis."""
        camera = self.camera(width, height)
        aspect = width / max(height, 1)
        state = self.state
        if name in STANDARD_VIEWS:
            camera = self.painter.standard(name, self.shown(), aspect, camera.parallel, state.up)
        elif name == "up":
            axes = tuple(UPWARD)
            state = replace(state, up=axes[(axes.index(state.up) + 1) % len(axes)])
            camera = self.painter.standard(None, self.shown(), aspect, camera.parallel, state.up)
        elif name == "fit":
            box = scene_box(self.painter.bodies, self.map.directory, self.shown().lines.segments)
            camera = fit(camera, box, aspect=aspect)
        elif name in ("parallel", "perspective"):
            camera = replace(camera, parallel=name == "parallel")
        self.update(camera=camera, up=state.up)

    def pick(
        self, x: float, y: float, width: int, height: int, camera: Camera | None = None
    ) -> Picked:
        """What is under a pixel.

        Parameters
        ----------
        camera : of the picture; None is the session's
        """
        seen_from = camera or self.camera(width, height)
        sight = Sight(camera=seen_from, x=x, y=y, width=width, height=height)
        return pick(self.painter, self.state, self.shown(), sight)

    # -- pictures ------------------------------------------------------------------------------

    def frame(
        self, width: int, height: int, ratio: float, *, coarse: bool, cancel: Cancel | None = None
    ) -> bytes:
        """The picture of the 3D panel as JPEG.

        Parameters
        ----------
        width, height : of the panel [pixels of the page]
        ratio : device pixels per pixel of the page
        coarse : quickly, while the camera moves
        cancel : gives the picture up

        Raises
        ------
        Interrupted
            ``cancel`` became true.
        """
        state, shown = self.state, self.shown()
        camera = self.camera(width, height)
        # A larger picture is painted with fewer pixels, which the page enlarges
        most = math.sqrt(MOST_PIXELS / (width * height))
        scale = min(1.0, 700 / max(width, height)) if coarse else min(ratio, most)
        size = max(16, round(width * scale)), max(16, round(height * scale))
        fine = coarse or ratio > 1.4 or 2 * size[0] * size[1] > MOST_PIXELS
        pixels = self.painter.paint(
            replace(state, width=max(0.6, state.width * scale)), shown, camera, *size,
            coarse=coarse, supersampling=1 if fine else 2,
            chosen=self.chosen, point=state.point, cancel=cancel,
        )  # fmt: skip
        return encode_jpeg(pixels, 70 if coarse else 92)

    def picture(self, width: int, height: int) -> bytes:
        """The picture with its legend as PNG; a larger one is made with fewer pixels."""
        shrink = min(1.0, math.sqrt(MOST_PIXELS / (width * height)))
        width, height = max(16, round(width * shrink)), max(16, round(height * shrink))
        shown = self.shown()
        pixels = self.painter.paint(
            self.state, shown, self.camera(width, height), width, height, supersampling=2,
            chosen=self.chosen, point=self.state.point,
        )  # fmt: skip
        size = max(11, round(height / 56))
        return encode_png(draw_legend(pixels, shown.legend, dark=self.state.dark, size=size))

    def objects(self) -> list[dict[str, Any]]:
        """The objects with what the list of objects shows of them."""
        rows = []
        drawn = {body.index: body for body in self.painter.bodies}
        for index, item in enumerate(self.map.directory.objects):
            body = drawn.get(index)
            own = self.state.opacities.get(item.name)
            shown = own if own is not None else (body.opacity if body is not None else 0.0)
            color = np.rint(255 * body.color).astype(int) if body is not None else (90, 90, 90)
            rows.append(
                {
                    "name": item.name,
                    "drawn": body is not None,
                    "visible": body is not None and item.name not in self.state.hidden,
                    "opacity": round(float(shown), 2),
                    "color": "#" + "".join(f"{int(part):02x}" for part in color),
                }
            )
        return rows

    def toggle_object(self, name: str) -> None:
        """Hide or show an object."""
        hidden = self.state.hidden
        if name in hidden:
            self.update(hidden=tuple(other for other in hidden if other != name))
        else:
            self.update(hidden=(*hidden, name))

    def set_opacity(self, name: str, opacity: float) -> None:
        """Give one object its own opacity."""
        value = float(np.clip(opacity, 0, 1))
        self.update(opacities={**self.state.opacities, name: value})

    def legend(self) -> dict[str, Any]:
        """The legend of the rays, for the page."""
        legend = self.shown().legend
        return {
            "title": legend.title,
            "scale": legend.scale,
            "entries": [
                {"label": entry.label, "color": f"rgb{cast(Any, entry.rgb)}"}
                for entry in legend.entries
            ],
        }
