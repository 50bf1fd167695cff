"""pvtrace's photon paths as a ray map.

pvtrace (D. Farrell, a Monte Carlo tracer for luminescent solar concentrators) follows photons
through a tree of nodes. Nodes become objects, their lights sources, and what is inside a node is
the medium of its name. Its wavelengths go to the nearest channel.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from raymap.foreign.recorder import Point, RayRecorder
from raymap.model.directory import DisplayMesh
from raymap.model.errors import MissingExtra, RayMapError
from raymap.model.events import Event

__all__ = ["record_pvtrace"]

_CHANNELS_NM = tuple(float(nm) for nm in range(300, 1101, 10))
_SAME = 1e-6
_ENDS = ("EXIT", "ABSORB", "KILL")


def record_pvtrace(
    scene: Any,
    path: str | os.PathLike[str],
    rays: int,
    *,
    flux: Mapping[str, float] | float = 1.0,
    wavelengths_nm: Sequence[float] = _CHANNELS_NM,
    max_steps: int = 1000,
    emit_method: str = "kT",
    length_unit: str = "cm",
    force: bool = False,
) -> None:
    """Trace a pvtrace scene and record every photon path.

    Random numbers are pvtrace's: NumPy's global generator.

    Parameters
    ----------
    scene : a ``pvtrace.Scene``
    path : of the map
    rays : photons, dealt to the lights in turn
    flux : of all lights together [W], or by the name of a light's node
    wavelengths_nm : channels of the map [nm]
    max_steps, emit_method : as of ``pvtrace``'s ``photon_tracer.follow``
    length_unit : of the scene; pvtrace counts absorption per centimetre
    force : replace an existing map

    Raises
    ------
    MissingExtra
        pvtrace is not installed.
    RayMapError
        The scene has no light, or nodes of one name.
    """
    try:
        tracer = import_module("pvtrace.algorithm.photon_tracer")
        version = getattr(import_module("pvtrace"), "__version__", "")
    except ImportError as error:
        raise MissingExtra(f"pvtrace cannot be imported ({error}): pip install pvtrace") from None
    root = scene.root
    nodes = {node.name: node for node in (root, *root.descendants) if node.geometry is not None}
    lights = [node.name for node in scene.light_nodes]
    if not lights:
        raise RayMapError("the scene has no light")
    if len(nodes) < sum(node.geometry is not None for node in (root, *root.descendants)):
        raise RayMapError("nodes of the scene have the same name: give each its own")
    share = flux if isinstance(flux, Mapping) else {name: flux / len(lights) for name in lights}
    center, radius = _extent(root)
    nm = np.array(wavelengths_nm, float)
    with RayRecorder(
        path,
        objects={name: () for name, node in nodes.items() if node is not root},
        sources={name: share[name] for name in lights},
        media={name: float(node.geometry.material.refractive_index)
               for name, node in nodes.items()},
        wavelengths_nm=tuple(nm),
        meshes={name: mesh for name, node in nodes.items()
                if node is not root and (mesh := _mesh(node, root)) is not None},
        center=center,
        radius=radius,
        length_unit=length_unit,
        title=f"{root.name}, traced by pvtrace",
        tracer=f"pvtrace {version}".strip(),
        force=force,
    ) as record:  # fmt: skip
        for number, ray in enumerate(scene.emit(rays)):
            history = tracer.follow(scene, ray, maxsteps=max_steps, emit_method=emit_method)
            points = _points(scene, tracer, history, nm, record)
            record.ray(points, source=lights[number % len(lights)])


def _points(scene: Any, tracer: Any, history: Any, nm: Any, record: RayRecorder) -> list[Point]:
    """Points of one history; what was hit is found again, for pvtrace does not keep it."""
    points: list[Point] = []
    hit: Any = None
    for number, (ray, event) in enumerate(history):
        last = number == len(history) - 1
        name = event.name
        reached, hit = (
            hit,
            None if name in ("EXIT", "ABSORB", "KILL") else tracer.next_hit(scene, ray),
        )
        inside = scene.root.name if hit is None else hit[1][0].name
        color = np.zeros(len(nm))
        color[int(np.argmin(np.abs(nm - ray.wavelength)))] = 1.0
        common: dict[str, Any] = {"position": ray.position, "medium": inside, "color": color}
        if name == "GENERATE":
            points.append(Point(event=Event.EMITTED, **common))
        elif name == "EXIT":
            common["medium"] = scene.root.name
            points.append(Point(event=Event.LEFT_SCENE, normal=ray.direction, **common))
        elif name == "ABSORB":
            points.append(Point(event=Event.VOLUME_ABSORPTION, **common))
        elif name == "KILL":
            points.append(Point(event=Event.DEPTH_LIMIT, **common))
        elif name in ("SCATTER", "EMIT"):
            shift = Event.FLUORESCENCE if name == "EMIT" else Event(0)
            points.append(Point(event=Event.VOLUME_SCATTER | shift, **common))
        else:
            points.append(_at_surface(scene, history[number - 1][0], ray, reached, name, common))
        if last and name not in _ENDS:
            # Nothing lies ahead: the ray leaves
            points.append(record.leave(ray.position, ray.direction, medium=inside, color=color))
    return points


def _at_surface(
    scene: Any, before: Any, ray: Any, reached: Any, name: str, common: dict[str, Any]
) -> Point:
    node, (container, adjacent), point, _ = reached
    local = node.geometry.normal(scene.root.point_to_node(point, node))
    normal = np.array(node.vector_to_node(local, scene.root))
    d_in, d_out = np.array(before.direction), np.array(ray.direction)
    cos_i = float(d_in @ normal)
    if name == "REFLECT":
        mirrored = d_in - 2 * cos_i * normal
        event = Event.DIFFUSE_REFLECTION
        if np.abs(mirrored - d_out).max() < _SAME:
            event = Event.SPECULAR_REFLECTION
            n_in = container.geometry.material.refractive_index
            n_out = adjacent.geometry.material.refractive_index if adjacent is not None else n_in
            if n_in**2 * (1 - cos_i**2) > n_out**2:
                event = Event.TIR
    else:
        event = Event.SPECULAR_REFRACTION | Event.MEDIUM_CHANGED
    return Point(event=event, object=node.name, normal=normal, **common)


def _extent(root: Any) -> tuple[Any, float]:
    """Sphere around the world."""
    geometry = root.geometry
    if hasattr(geometry, "radius") and not hasattr(geometry, "length"):
        return (0.0, 0.0, 0.0), float(geometry.radius)
    corners = np.array(getattr(geometry, "_size", None) or (1.0, 1.0, 1.0), float)
    return (0.0, 0.0, 0.0), float(0.5 * np.linalg.norm(corners)) or 1.0


def _mesh(node: Any, root: Any) -> DisplayMesh | None:
    """Triangles to draw a node with; None for shapes that are not known."""
    creation: Any = import_module("trimesh.creation")
    geometry = node.geometry
    kind = type(geometry).__name__
    if kind == "Mesh":
        mesh = geometry.trimesh
    elif kind == "Sphere":
        mesh = creation.icosphere(subdivisions=3, radius=geometry.radius)
    elif kind == "Box":
        mesh = creation.box(extents=geometry._size)
    elif kind == "Cylinder":
        mesh = creation.cylinder(radius=geometry.radius, height=geometry.length, sections=48)
    else:
        return None
    corners = [node.point_to_node(tuple(corner), root) for corner in mesh.vertices.tolist()]
    return DisplayMesh(
        vertices=np.array(corners, np.float32),
        triangles=np.array(mesh.faces, np.int32),
        face=np.zeros(len(mesh.faces), np.int32),
    )
