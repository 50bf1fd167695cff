"""The 3D view as a PyVista plotter: for windows, notebooks, and whatever PyVista can do with it.

Bodies are meshes by name, all rays are one `pyvista.PolyData`. On a machine with a graphics card
this is the view to turn and to extend; without one, software OpenGL needs seconds for a million
segments, which is why pictures and the application are painted by `viewer.paint.painter`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from raymap.model.errors import MissingExtra, RayMapError
from viewer.drawn.answers import draw_rays
from viewer.drawn.scene import load_bodies
from viewer.drawn.state import COLOR_RULES, Camera, ViewState
from viewer.paint.painter import Painter, Shown

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["plotter", "ray_mesh"]


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError:
        raise MissingExtra(
            "the PyVista view needs pyvista, which is not installed: pip install 'raymap[vtk]'"
        ) from None
    return pyvista


def ray_mesh(shown: Shown) -> Any:
    """All drawn rays as one ``pyvista.PolyData``.

    Cell data, one per segment: ``rgba`` (uint8), ``ray_id``, ``path`` and ``record`` (row within
    the drawn rays).
    """
    pyvista = _pyvista()
    lines = shown.lines
    mesh = pyvista.PolyData()
    mesh.points = lines.segments.reshape(-1, 3)
    pairs = np.arange(2 * len(lines)).reshape(-1, 2)
    mesh.lines = np.insert(pairs, 0, 2, axis=1).ravel()
    mesh.cell_data["rgba"] = shown.rgba
    mesh.cell_data["ray_id"] = shown.rays.ray_ids[lines.ray]
    mesh.cell_data["path"] = shown.rays.path[lines.ray]
    mesh.cell_data["record"] = lines.record
    return mesh


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
    pyvista = _pyvista()
    if color is not None and color not in COLOR_RULES:
        raise RayMapError(f"no colour rule {color!r}; there are {', '.join(COLOR_RULES)}")
    base = state or ViewState()
    if color is not None:
        base = replace(base, color=cast(Any, color))
    painter = Painter(load_bodies(map.directory, map.meshes), map.directory)
    drawing = draw_rays(map, criterion, rays, paths=paths)
    shown = painter.show(base, drawing.rays, drawing.labels)
    result = pyvista.Plotter(**options)
    result.set_background("#13161d" if base.dark else "white")
    for body in painter.visible(base):
        triangles = np.arange(3 * len(body.corners)).reshape(-1, 3)
        mesh = pyvista.PolyData.from_regular_faces(body.corners.reshape(-1, 3), triangles)
        result.add_mesh(
            mesh.clean(), name=body.name, color=body.color.tolist(), opacity=body.opacity,
            smooth_shading=True, split_sharp_edges=True,
        )  # fmt: skip
    if len(shown.lines):
        result.add_mesh(
            ray_mesh(shown), name="rays", scalars="rgba", rgba=True, lighting=False,
            line_width=base.width,
        )  # fmt: skip
    _look(result, painter.camera(base, shown, result.window_size[0] / result.window_size[1]))
    return result


def _look(result: Any, camera: Camera) -> None:
    """Take over the camera of the session."""
    result.camera.position = camera.position
    result.camera.focal_point = camera.focal_point
    result.camera.up = camera.view_up
    if camera.parallel:
        result.enable_parallel_projection()
        result.camera.parallel_scale = camera.height / 2
    result.reset_camera_clipping_range()
