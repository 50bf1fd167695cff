"""The scene as a PyVista plotter: for windows, notebooks, and whatever PyVista can do with it.

Bodies are meshes by name, all rays are one `pyvista.PolyData`. The plotter is a renderer of the
scene's parts (`viewer.shown.live`) as the page is: it takes what has changed and leaves the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MissingExtra, RayMapError
from viewer.drawn.answers import Drawing, draw_rays
from viewer.drawn.camera import eye
from viewer.drawn.rays import DrawnRays, no_rays
from viewer.drawn.scene import load_bodies
from viewer.drawn.state import COLOR_RULES, Camera, Section, ViewState
from viewer.paint.painter import Painter
from viewer.shown.live import LiveScene, Snapshot

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["RAYS", "PlottedScene", "plotted", "plotter"]

RAYS = "rays"
"""Name of the actor of all rays; a body of that name is the actor "body rays"."""

_CUT, _CHOSEN = "section", "chosen ray"
_GROUND = {True: ("#090b0f", "#13171d"), False: ("#edf1f5", "white")}
_EDGE_TONE = {True: (0.75, 0.25), False: (0.35, 0.0)}


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError:
        raise MissingExtra(
            "the PyVista view needs pyvista, which is not installed: pip install 'raymap[vtk]'"
        ) from None
    return pyvista


def plotter(
    map: RayMap,
    criterion: Any = None,
    *,
    rays: int = 500,
    color: str | None = None,
    state: ViewState | None = None,
    paths: Sequence[tuple[str, str]] = (),
    **options: Any,
) -> Any:
    """A PyVista plotter with the scene of a map and the rays of a selection; call ``.show()``.

    Parameters
    ----------
    map : an open ray map
    criterion : text, tree or JSON; None selects every ray
    rays : draw at most so many, the same ones every time
    color : one of `viewer.drawn.state.COLOR_RULES`; None takes the rule of ``state``
    state : everything else (section, clip, opacities, camera …)
    paths : (criterion, label) of paths to be shown alone, one colour each
    options : of ``pyvista.Plotter``: ``off_screen``, ``window_size`` …

    Returns
    -------
    pyvista.Plotter; bodies are actors by their names, the rays the actor "rays"

    Raises
    ------
    MissingExtra
        PyVista is not installed.
    """
    return plotted(
        map, criterion, rays=rays, color=color, state=state, paths=paths, **options
    ).plotter


def plotted(
    map: RayMap,
    criterion: Any = None,
    *,
    rays: int = 500,
    color: str | None = None,
    state: ViewState | None = None,
    paths: Sequence[tuple[str, str]] = (),
    **options: Any,
) -> PlottedScene:
    """The same, to be changed afterwards; the parameters are `plotter`'s."""
    pyvista = _pyvista()
    if color is not None and color not in COLOR_RULES:
        raise RayMapError(f"no colour rule {color!r}; there are {', '.join(COLOR_RULES)}")
    base = state or ViewState()
    if color is not None:
        base = replace(base, color=cast(Any, color))
    painter = Painter(load_bodies(map.directory, map.meshes), map.directory)
    drawing = draw_rays(map, criterion, rays, paths=paths)
    scene = PlottedScene(pyvista.Plotter(**options), painter)
    scene.show(base, drawing)
    return scene


class PlottedScene:
    """Keeps a PyVista plotter at what a session shows.

    Parameters
    ----------
    plotter : of ``pyvista.Plotter``, which may hold meshes of others, too
    painter : knows the bodies, gives rays their colours

    Attributes
    ----------
    live : the scene
    now : what is shown
    """

    now: Snapshot

    def __init__(self, plotter: Any, painter: Painter) -> None:
        self.plotter, self.painter = plotter, painter
        self.live = LiveScene(painter.bodies, painter.directory)
        self.drawing = Drawing(rays=no_rays(), labels={})
        self._have: dict[str, int] = {}
        self._actors = {body.name: _actor_name(body.name) for body in painter.bodies}

    def show(self, state: ViewState, drawing: Drawing) -> tuple[str, ...]:
        """Show rays as a session says; the camera stays where the state has none of its own.

        Returns
        -------
        the parts that had changed
        """
        before = getattr(self, "now", None)
        colored = self.painter.color(state, drawing.rays, drawing.labels)
        camera = state.camera
        if camera is None and before is not None:
            camera = before.camera
        if camera is None:
            shown = self.painter.cut(colored, state.section)
            width, height = self.plotter.window_size
            camera = self.painter.camera(state, shown, width / height)
        self.drawing = drawing
        return self.update(Snapshot(state=state, colored=colored, camera=camera))

    def change(self, **changes: Any) -> tuple[str, ...]:
        """Change fields of the state."""
        return self.show(replace(self.now.state, **changes), self.drawing)

    def update(self, now: Snapshot) -> tuple[str, ...]:
        """Show what the session shows now; returns the parts that had changed."""
        self.now = now
        self.live.update(now)
        changed = self.live.changed(self._have)
        if "bodies" in changed:
            self._bodies()
        if "rays" in changed or "colors" in changed:
            self._rays(now, moved="rays" in changed)
        if "looks" in changed:
            self._looks()
        if "cut" in changed or "style" in changed:
            self._cut_lines(now.state)
        if "chosen" in changed or "style" in changed:
            self._chosen(now)
        if "section" in changed or "bodies" in changed or "rays" in changed:
            self._section(now.state.section)
        if "style" in changed:
            self._style(now.state)
        if "camera" in changed:
            _look(self.plotter, now.camera)
        self._have |= changed
        if changed:
            self.plotter.render()
        return tuple(changed)

    def _bodies(self) -> None:
        pyvista = _pyvista()
        for body in self.live.bodies:
            triangles = np.arange(3 * len(body.corners)).reshape(-1, 3)
            mesh = pyvista.PolyData.from_regular_faces(body.corners.reshape(-1, 3), triangles)
            mesh.point_data["normals"] = body.normals.reshape(-1, 3)
            mesh.cell_data["face"] = body.face
            mesh.point_data.active_normals_name = "normals"
            self.plotter.add_mesh(
                mesh, name=self._actors[body.name], color=body.color.tolist(),
                opacity=body.opacity, smooth_shading=True, reset_camera=False,
            )  # fmt: skip

    def _looks(self) -> None:
        rgba = self.live.part("looks").arrays["rgba"]
        for body, look in zip(self.live.bodies, rgba.tolist(), strict=True):
            actor = self.plotter.actors[self._actors[body.name]]
            actor.visibility = look[3] > 0
            actor.prop.opacity = look[3] / 255

    def _rays(self, now: Snapshot, *, moved: bool) -> None:
        """One mesh of all segments; new colours of the same segments change the colours alone."""
        actor = self.plotter.actors.get(RAYS)
        record = now.colored.lines.record
        if not moved and actor is not None:
            mesh = actor.mapper.dataset
            if np.array_equal(mesh.cell_data["record"], record):
                mesh.cell_data["rgba"][:] = now.colored.rgba[record]
                mesh.cell_data.GetArray("rgba").Modified()
                mesh.Modified()
                return
        if actor is not None:
            self.plotter.remove_actor(RAYS, reset_camera=False)
        if len(record):
            self.plotter.add_mesh(
                _ray_mesh(now.colored.rays, now.colored.lines.ray, record, now.colored.rgba),
                name=RAYS, scalars="rgba", rgba=True, lighting=False,
                line_width=now.state.width, reset_camera=False,
            )  # fmt: skip
            self._section(now.state.section)

    def _section(self, section: Section) -> None:
        """A plane that the graphics card cuts at: no mesh changes."""
        part = self.live.part("section").header
        cut = [*self._actors.values(), *([RAYS] if section.rays else [])]
        for name in (*self._actors.values(), RAYS):
            actor = self.plotter.actors.get(name)
            if actor is None:
                continue
            actor.mapper.RemoveAllClippingPlanes()
            if part["on"] and name in cut:
                actor.mapper.AddClippingPlane(_plane(part, self.live.center))

    def _cut_lines(self, state: ViewState) -> None:
        arrays = self.live.part("cut").arrays
        scale, lift = _EDGE_TONE[state.dark]
        looks = self.live.part("looks").arrays["rgba"]
        owner = arrays["body"][::2]
        tone = np.clip(looks[owner, :3] * scale + 255 * lift, 0, 255).astype(np.uint8)
        shown = looks[owner, 3] > 0
        points = (arrays["position"] + self.live.center).reshape(-1, 2, 3)[shown]
        self._lines(_CUT, points.reshape(-1, 3), tone[shown], width=1.5)

    def _chosen(self, now: Snapshot) -> None:
        points = self.live.part("chosen").arrays["position"] + self.live.center
        ends = np.repeat(points, 2, axis=0)[1:-1] if len(points) else points
        tone = (255, 255, 255) if now.state.dark else (20, 20, 20)
        rgb = np.tile(np.array(tone, np.uint8), (len(ends) // 2, 1))
        self._lines(_CHOSEN, ends, rgb, width=now.state.width + 1.2)

    def _lines(
        self, name: str, ends: NDArray[Any], rgb: NDArray[np.uint8], *, width: float
    ) -> None:
        if name in self.plotter.actors:
            self.plotter.remove_actor(name, reset_camera=False)
        if len(ends):
            mesh = _segments(ends)
            mesh.cell_data["rgb"] = rgb
            self.plotter.add_mesh(
                mesh, name=name, scalars="rgb", rgb=True, lighting=False, line_width=width,
                reset_camera=False, pickable=False,
            )  # fmt: skip

    def _style(self, state: ViewState) -> None:
        bottom, top = _GROUND[state.dark]
        self.plotter.set_background(bottom, top=top)
        if RAYS in self.plotter.actors:
            self.plotter.actors[RAYS].prop.line_width = state.width


def _actor_name(body: str) -> str:
    return f"body {body}" if body in (RAYS, _CUT, _CHOSEN) else body


def _segments(ends: NDArray[Any]) -> Any:
    mesh = _pyvista().PolyData()
    mesh.points = np.ascontiguousarray(ends)
    pairs = np.arange(len(ends)).reshape(-1, 2)
    mesh.lines = np.insert(pairs, 0, 2, axis=1).ravel()
    return mesh


def _ray_mesh(
    rays: DrawnRays, ray: NDArray[np.int32], record: NDArray[np.int64], rgba: NDArray[np.uint8]
) -> Any:
    """All drawn rays as one ``pyvista.PolyData`` whose points are those of the rays.

    Cell data, one per segment: ``rgba`` (uint8), ``ray_id``, ``path`` and ``record`` (row within
    the drawn rays, and number of the point where the segment starts).
    """
    mesh = _pyvista().PolyData()
    mesh.points = rays.position
    mesh.lines = np.stack([np.full(len(record), 2), record, record + 1], axis=1).ravel()
    mesh.cell_data["rgba"] = rgba[record]
    mesh.cell_data["ray_id"] = rays.ray_ids[ray]
    mesh.cell_data["path"] = rays.path[ray]
    mesh.cell_data["record"] = record
    return mesh


def _plane(section: Any, center: NDArray[np.float64]) -> Any:
    """VTK keeps what lies on the side of the normal."""
    from vtkmodules.vtkCommonDataModel import vtkPlane

    normal = np.array(section["normal"])
    plane = vtkPlane()
    plane.SetNormal(*(-normal))
    plane.SetOrigin(*(center + section["offset"] * normal))
    return plane


def _look(result: Any, camera: Camera) -> None:
    """Take over the camera of the session."""
    own = result.camera
    own.parallel_projection = camera.parallel
    own.parallel_scale = camera.height / 2
    own.position = tuple(eye(camera))
    own.focal_point = camera.focal_point
    own.up = camera.view_up
    result.reset_camera_clipping_range()
