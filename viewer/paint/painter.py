"""One scene with its rays, painted and picked: what the application and `picture` share."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory
from viewer.drawn.bodies import Body
from viewer.drawn.camera import (
    screen_ray,
    standard_view,
    view_axes,
    view_matrix,
)
from viewer.drawn.colors import Legend, color_lines
from viewer.drawn.lines import Lines, build_lines, cut_lines
from viewer.drawn.rays import DrawnRays
from viewer.drawn.scene import scene_box, visible_bodies
from viewer.drawn.state import Camera, Clip, Section, Upward, ViewState
from viewer.paint.interrupt import Cancel
from viewer.paint.overlay import draw_names
from viewer.paint.paint import Layer, finish, paint_bodies, paint_edges, paint_rays
from viewer.paint.picking import pick_segment, pick_triangle
from viewer.paint.raster import draw_segments

__all__ = ["COARSE_SEGMENTS", "Colored", "Painter", "Shown"]

COARSE_SEGMENTS = 60_000
"""While the camera moves at most about this many segments are drawn."""

_HIGHLIGHT = {True: (255, 255, 255, 255), False: (20, 20, 20, 255)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Colored:
    """Rays with their colours, before a section cuts them.

    Attributes
    ----------
    lines : the segments that the clip leaves
    rgba : (n_records, 4) uint8 of the segment that starts there; what is not drawn has none
    """

    rays: DrawnRays
    lines: Lines
    rgba: NDArray[np.uint8]
    legend: Legend


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """Rays as they are seen: their segments, colours and legend."""

    rays: DrawnRays
    lines: Lines
    rgba: NDArray[np.uint8]
    legend: Legend


class Painter:
    """Paints one scene; safe to use from several threads.

    Parameters
    ----------
    bodies : all bodies of the scene
    directory : names and units
    """

    def __init__(self, bodies: Sequence[Body], directory: Directory) -> None:
        self.bodies = list(bodies)
        self.directory = directory
        self._layers: OrderedDict[object, Layer] = OrderedDict()
        self._cut: tuple[object, list[Body]] | None = None
        self._lock = threading.Lock()

    # -- what is seen --------------------------------------------------------------------------

    def visible(self, state: ViewState) -> list[Body]:
        """The bodies as the session shows them."""
        key = (state.section, state.hidden, tuple(sorted(state.opacities.items())),
               state.body_opacity)  # fmt: skip
        cached = self._cut
        if cached is None or cached[0] != key:
            cached = self._cut = (key, visible_bodies(self.bodies, state))
        return cached[1]

    def color(
        self, state: ViewState, rays: DrawnRays, path_labels: dict[int, str] | None = None
    ) -> Colored:
        """Segments of the rays, clipped and coloured as the session says."""
        lines = build_lines(rays, state.clip)
        rgba, legend = color_lines(
            rays, lines, state.color, self.directory,
            opacity=state.opacity, fade=state.fade, dark=state.dark, path_labels=path_labels,
        )  # fmt: skip
        by_record = np.zeros((rays.n_records, 4), np.uint8)
        by_record[lines.record] = rgba
        return Colored(rays=rays, lines=lines, rgba=by_record, legend=legend)

    def cut(self, colored: Colored, section: Section) -> Shown:
        """What a section leaves of coloured rays."""
        lines = cut_lines(colored.lines, section)
        rgba = colored.rgba[lines.record]
        return Shown(rays=colored.rays, lines=lines, rgba=rgba, legend=colored.legend)

    def show(
        self, state: ViewState, rays: DrawnRays, path_labels: dict[int, str] | None = None
    ) -> Shown:
        """Segments of the rays, clipped, cut and coloured as the session says."""
        return self.cut(self.color(state, rays, path_labels), state.section)

    def camera(self, state: ViewState, shown: Shown | None, aspect: float) -> Camera:
        """The camera of the session, or one that sees the whole scene from the side."""
        if state.camera is not None:
            return state.camera
        return self.standard(None, shown, aspect, up=state.up)

    def standard(
        self,
        name: str | None,
        shown: Shown | None,
        aspect: float,
        parallel: bool = True,
        up: Upward = "y",
    ) -> Camera:
        """A standard view of everything; without a name, the side if the scene is long in z."""
        points = shown.lines.segments if shown is not None else np.empty((0, 2, 3), np.float32)
        box = scene_box(self.bodies, self.directory, points)
        if name is None:
            size = box[1] - box[0]
            name = "side" if up == "y" and size[2] >= 0.8 * size[:2].max() else "tilted"
        return standard_view(name, box, aspect=aspect, parallel=parallel, up=up)

    # -- painting ------------------------------------------------------------------------------

    def paint(
        self,
        state: ViewState,
        shown: Shown,
        camera: Camera,
        width: int,
        height: int,
        *,
        supersampling: int = 1,
        coarse: bool = False,
        chosen: DrawnRays | None = None,
        point: int | None = None,
        cancel: Cancel | None = None,
    ) -> NDArray[np.uint8]:
        """Paint the scene.

        Parameters
        ----------
        width, height : [pixels]
        supersampling : paints larger and averages
        coarse : fewer rays, for a camera in motion
        chosen : one ray to stand out, and the index of its marked ``point``
        cancel : gives the picture up

        Returns
        -------
        (height, width, 3) uint8

        Raises
        ------
        Interrupted
            ``cancel`` became true.
        """
        bodies = self.visible(state)
        fine = (width * supersampling, height * supersampling)
        layer = self._layer(state, bodies, camera, *fine, keep=not coarse, cancel=cancel).copy()
        segments, rgba = shown.lines.segments, shown.rgba
        if coarse and len(segments) > COARSE_SEGMENTS:
            # Whole rays, every k-th, more opaque in exchange
            every = -(-len(segments) // COARSE_SEGMENTS)
            kept = shown.lines.ray % every == 0
            segments, rgba = segments[kept], rgba[kept]
        paint_rays(layer, segments, rgba, width=state.width * supersampling, cancel=cancel)
        paint_edges(layer, bodies, camera, dark=state.dark)
        if chosen is not None and chosen.n_rays:
            self._mark(layer, chosen, point, camera, state, supersampling, height)
        picture = finish(layer, supersampling)
        if state.names:
            picture = draw_names(
                picture, bodies, layer.matrix, dark=state.dark, supersampling=supersampling
            )
        return picture

    def _layer(
        self,
        state: ViewState,
        bodies: list[Body],
        camera: Camera,
        width: int,
        height: int,
        *,
        keep: bool,
        cancel: Cancel | None,
    ) -> Layer:
        """Background and bodies, remembered while only the rays change."""
        key = (camera, width, height, state.dark, state.section, state.hidden,
               tuple(sorted(state.opacities.items())), state.body_opacity)  # fmt: skip
        with self._lock:
            if key in self._layers:
                return self._layers[key]
        layer = paint_bodies(bodies, camera, width, height, dark=state.dark, cancel=cancel)
        if keep:
            with self._lock:
                self._layers[key] = layer
                while len(self._layers) > 2:
                    self._layers.popitem(last=False)
        return layer

    def _mark(
        self,
        layer: Layer,
        chosen: DrawnRays,
        point: int | None,
        camera: Camera,
        state: ViewState,
        scale: int,
        height: int,
    ) -> None:
        """The chosen ray over everything, with a ring around the chosen point."""
        lines = cut_lines(build_lines(chosen, Clip()), replace(state.section, rays=False))
        color = np.array(_HIGHLIGHT[state.dark], np.uint8)
        nothing = np.full(layer.depth.shape, np.inf, np.float32)
        rgba = np.tile(color, (len(lines), 1))
        draw_segments(
            lines.segments, rgba, layer.matrix,
            width=(state.width + 1.2) * scale, depth=nothing, image=layer.image,
        )  # fmt: skip
        if point is None or not 0 <= point < chosen.n_records:
            return
        right, up, _ = view_axes(camera)
        center = chosen.position[point].astype(np.float64)
        depth = layer.matrix[3] @ np.append(center, 1.0)
        radius = 7.0 * camera.height / height * depth
        angle = np.linspace(0, 2 * np.pi, 33)[:, None]
        ring = (center + radius * (np.cos(angle) * right + np.sin(angle) * up)).astype(np.float32)
        circle = np.stack([ring[:-1], ring[1:]], axis=1)
        tone = np.tile(np.array([255, 92, 92, 255], np.uint8), (len(circle), 1))
        draw_segments(
            circle, tone, layer.matrix, width=2.5 * scale, depth=nothing, image=layer.image
        )

    # -- picking -------------------------------------------------------------------------------

    def pick_ray(
        self, shown: Shown, camera: Camera, x: float, y: float, width: int, height: int
    ) -> tuple[int, int] | None:
        """(index of the drawn ray, step of its nearer point) under a pixel."""
        matrix = view_matrix(camera, width, height, 1.0)
        found = pick_segment(shown.lines.segments, shown.rgba, matrix, x, y)
        if found is None:
            return None
        ray = int(shown.lines.ray[found.segment])
        step = int(shown.lines.record[found.segment] - shown.rays.offsets[ray])
        return ray, step + int(found.fraction > 0.5)

    def pick_body(
        self, state: ViewState, camera: Camera, x: float, y: float, width: int, height: int
    ) -> tuple[str, str] | None:
        """Names of the body and of its face nearest under a pixel; a face may have none."""
        origin, direction = screen_ray(camera, x, y, width, height)
        # Start well before the scene: a parallel camera may stand inside a body
        reach = 2 * self.directory.bounding_sphere.radius if camera.parallel else 0.0
        best: tuple[float, tuple[str, str]] | None = None
        for body in self.visible(state):
            if len(body.corners) == 0:
                continue
            triangles = np.arange(3 * len(body.corners), dtype=np.int32).reshape(-1, 3)
            corners = body.corners.reshape(-1, 3)
            found = pick_triangle(corners, triangles, origin - reach * direction, direction)
            if found is not None and (best is None or found[1] < best[0]):
                faces = self.directory.objects[body.index].faces
                number = int(body.face[found[0]])
                face = faces[number].name if 0 <= number < len(faces) else ""
                best = (found[1], (body.name, face))
        return best[1] if best is not None else None
