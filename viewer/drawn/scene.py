"""From the directory and display meshes of a map to drawable bodies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory, DisplayMesh, SceneObject, Surface
from viewer.drawn.bodies import Body, cut_body, make_body
from viewer.drawn.lines import section_plane
from viewer.drawn.state import ViewState

__all__ = ["bodies_box", "load_bodies", "material_of", "opacity_of", "scene_box", "visible_bodies"]

Box = tuple[NDArray[np.float64], NDArray[np.float64]]

MATERIALS: dict[str, tuple[tuple[int, int, int], float]] = {
    "glass": ((150, 196, 232), 0.22),
    "mirror": ((206, 210, 216), 0.85),
    "black": ((70, 74, 82), 0.55),
    "coloured": ((196, 180, 150), 0.60),
    "screen": ((120, 200, 150), 0.55),
    "plain": ((170, 175, 182), 0.40),
}
"""Colour and opacity of a body by what it is made of."""

_GLASS_TINTS = ((150, 196, 232), (140, 214, 214), (168, 180, 236), (160, 214, 184), (190, 190, 236))


def material_of(item: SceneObject, directory: Directory) -> str:
    """What an object looks like, from the surfaces of its faces: a key of `MATERIALS`."""
    detectors = {detector.object for detector in directory.detectors if detector.blocking}
    if directory.objects.index(item) in detectors:
        return "screen"
    surfaces = [directory.surfaces[face.surface] for face in item.faces if face.surface >= 0]
    words = " ".join("black" if _is_dark(entry) else entry.kind.lower() for entry in surfaces)
    for material, signs in (
        ("glass", ("fresnel", "dielectric", "coat", "refract", "glass", "transmi")),
        ("mirror", ("mirror", "reflector", "metal")),
        ("black", ("absor", "black")),
        ("coloured", ("lambert", "diffuse", "gloss", "bsdf", "scatter", "paint")),
    ):
        if any(sign in words for sign in signs):
            return material
    return "plain"


def _is_dark(surface: Surface) -> bool:
    """Paint that swallows most of the light."""
    for key in ("reflectance", "albedo"):
        numbers = _numbers(surface.parameters.get(key))
        if numbers:
            return max(numbers) < 0.25
    return "absor" in surface.kind.lower()


def _numbers(value: object) -> list[float]:
    """All numbers in a parameter: one, a list, or lists by name."""
    if isinstance(value, bool) or value is None:
        return []
    if isinstance(value, int | float):
        return [float(value)]
    parts = value.values() if isinstance(value, dict) else value
    if isinstance(value, dict | list | tuple):
        return [number for part in cast(Any, parts) for number in _numbers(part)]
    return []


def _glass_tint(item: SceneObject, directory: Directory) -> tuple[int, int, int]:
    """Different glasses differ a little in hue."""
    medium = str(item.parameters.get("medium", ""))
    names = [entry.name for entry in directory.media]
    return _GLASS_TINTS[names.index(medium) % len(_GLASS_TINTS) if medium in names else 0]


def load_bodies(directory: Directory, meshes: Mapping[int, DisplayMesh]) -> list[Body]:
    """All objects that have a display mesh, as bodies.

    A body that encloses most of the others (a barrel, a room) is drawn so faint that one sees
    what is inside.
    """
    bodies = []
    for index, item in enumerate(directory.objects):
        mesh = meshes.get(index)
        if mesh is None or len(mesh.triangles) == 0:
            continue
        material = material_of(item, directory)
        color, opacity = MATERIALS[material]
        if material == "glass":
            color = _glass_tint(item, directory)
        shade = np.array(color, np.float32) / np.float32(255)
        bodies.append(make_body(mesh, name=item.name, index=index, color=shade, opacity=opacity))
    return _fade_housings([body for body in bodies if len(body.corners)])


def _fade_housings(bodies: list[Body]) -> list[Body]:
    """Lower the opacity of bodies whose box holds the centres of at least half of the others."""
    boxes = [_box(body.corners) for body in bodies]
    centers = [0.5 * (low + high) for low, high in boxes]
    faded = []
    for number, (body, (low, high)) in enumerate(zip(bodies, boxes, strict=True)):
        others = [center for k, center in enumerate(centers) if k != number]
        inside = sum(bool(np.all((low < c) & (c < high))) for c in others)
        encloses = len(others) >= 2 and inside >= 0.5 * len(others)
        faded.append(replace(body, opacity=0.10) if encloses else body)
    return faded


def _box(corners: NDArray[np.float32]) -> Box:
    points = corners.reshape(-1, 3).astype(np.float64)
    return points.min(axis=0), points.max(axis=0)


def bodies_box(bodies: Iterable[Body]) -> Box | None:
    """Corners of the box around bodies."""
    boxes = [_box(body.corners) for body in bodies if len(body.corners)]
    if not boxes:
        return None
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)


def scene_box(bodies: Sequence[Body], directory: Directory, points: NDArray[np.float32]) -> Box:
    """What a fitted camera shows: the bodies, else the rays, else the bounding sphere."""
    box = bodies_box(bodies)
    if box is not None:
        return box
    if len(points):
        flat = points.reshape(-1, 3).astype(np.float64)
        return flat.min(axis=0), flat.max(axis=0)
    center = np.array(directory.bounding_sphere.center)
    radius = directory.bounding_sphere.radius
    return center - radius, center + radius


def opacity_of(body: Body, state: ViewState) -> float:
    """Opacity of a body, 0 … 1: its own where the session gives it one."""
    own = state.opacities.get(body.name)
    opacity = own if own is not None else body.opacity * state.body_opacity
    return float(np.clip(opacity, 0, 1))


def visible_bodies(bodies: Iterable[Body], state: ViewState) -> list[Body]:
    """Bodies as the session shows them: without the hidden, with their opacities, cut."""
    shown = []
    for body in bodies:
        if body.name in state.hidden:
            continue
        body = replace(body, opacity=opacity_of(body, state))
        if state.section.on:
            body = cut_body(body, *section_plane(state.section))
        shown.append(body)
    return shown
