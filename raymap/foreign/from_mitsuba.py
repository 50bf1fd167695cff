"""Mitsuba 3's light paths as a ray map.

Mitsuba finds surfaces and samples emitters and materials; this module follows light from the
emitters, one ray after the other, and records it. Shapes become objects by their ids, emitters
sources. Needs a scalar RGB variant: ``mi.set_variant("scalar_rgb")``.

Roulette by what a material takes keeps the flux of a ray constant, so that absorbed light is
recorded where it ends. The flux of a ray is the sum of its R, G and B, in whatever unit the scene's
emitters have.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

import numpy as np

from raymap.foreign.recorder import Point, RayRecorder
from raymap.model.directory import DisplayMesh
from raymap.model.errors import MissingExtra, RayMapError
from raymap.model.events import Event

__all__ = ["record_mitsuba"]

_EVENTS = {
    "DiffuseReflection": Event.DIFFUSE_REFLECTION,
    "GlossyReflection": Event.GLOSSY_REFLECTION,
    "DeltaReflection": Event.SPECULAR_REFLECTION,
    "DiffuseTransmission": Event.DIFFUSE_TRANSMISSION | Event.MEDIUM_CHANGED,
    "DeltaTransmission": Event.SPECULAR_REFRACTION | Event.MEDIUM_CHANGED,
    "GlossyTransmission": Event.GLOSSY_TRANSMISSION | Event.MEDIUM_CHANGED,
    "Null": Event.SPECULAR_REFRACTION,
}
_OUTSIDE = "outside"


def record_mitsuba(
    scene: Any,
    path: str | os.PathLike[str],
    rays: int,
    *,
    seed: int = 1,
    depth: int = 64,
    length_unit: str = "m",
    force: bool = False,
) -> None:
    """Follow light through a Mitsuba scene and record every path.

    Parameters
    ----------
    scene : as ``mitsuba.load_file`` or ``load_dict`` give it, in a scalar RGB variant
    path : of the map
    rays : from all emitters together, sampled as Mitsuba samples them
    seed : of Mitsuba's sampler
    depth : most points of a ray
    length_unit : of the scene
    force : replace an existing map

    Raises
    ------
    MissingExtra
        Mitsuba is not installed.
    RayMapError
        Another variant is set, the scene has no emitter or light at infinity only, or shapes of one
        id.
    """
    mi = _mitsuba()
    shapes = list(scene.shapes())
    ids = [shape.id() for shape in shapes]
    if len(set(ids)) < len(ids):
        raise RayMapError("shapes of the scene have the same id: give each its own")
    emitters = list(scene.emitters())
    if not emitters:
        raise RayMapError("the scene has no emitter")
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, 1)
    starts = [_emit(scene, emitters, sampler) for _ in range(rays)]
    flux = np.zeros(len(emitters))
    counts = np.zeros(len(emitters), np.int64)
    for number, _, _, color in starts:
        flux[number] += color.sum() / rays
        counts[number] += 1
    names = _source_names(emitters, shapes)
    mean = flux * rays / np.maximum(counts, 1)
    box = scene.bbox()
    low, high = np.array(box.min).ravel(), np.array(box.max).ravel()
    clear = {name for name, shape in zip(ids, shapes, strict=True) if _transmits(mi, shape)}
    with RayRecorder(
        path,
        objects=dict.fromkeys(ids, ()),
        sources=dict(zip(names, flux.tolist(), strict=True)),
        media={_OUTSIDE: 1.0} | {f"in {name}": 1.0 for name in ids if name in clear},
        meshes=_meshes(mi, scene, shapes),
        center=(0.5 * (low + high)).tolist(),
        radius=max(float(np.linalg.norm(high - low)), 1e-6),
        length_unit=length_unit,
        title="traced by Mitsuba",
        tracer=f"Mitsuba {mi.__version__}",
        seed=seed,
        force=force,
    ) as record:
        for number, place, along, color in starts:
            if not color.sum() > 0:
                continue
            points = _follow(mi, scene, sampler, record, place, along, color, depth)
            record.ray(points, source=names[number], weight=float(color.sum() / mean[number]))


def _mitsuba() -> Any:
    try:
        mi = import_module("mitsuba")
    except ImportError as error:
        raise MissingExtra(
            f"Mitsuba cannot be imported ({error}): pip install 'raymap[mitsuba]'"
        ) from None
    if mi.variant() != "scalar_rgb":
        raise RayMapError(
            f"Mitsuba's variant is {mi.variant()}; call mitsuba.set_variant('scalar_rgb') before "
            "the scene is loaded"
        )
    return mi


def _emit(scene: Any, emitters: list[Any], sampler: Any) -> tuple[int, Any, Any, Any]:
    """Number of the emitter, place, direction and R, G, B of a ray."""
    ray, weight, emitter = scene.sample_emitter_ray(
        0.0, sampler.next_1d(), sampler.next_2d(), sampler.next_2d(), True
    )
    place, along = np.array(ray.o).ravel(), np.array(ray.d).ravel()
    color = np.maximum(np.array(weight).ravel(), 0.0)
    if not np.isfinite(place).all():
        raise RayMapError("light that comes from infinity cannot be recorded; use an area emitter")
    return next(k for k, each in enumerate(emitters) if each == emitter), place, along, color


def _source_names(emitters: list[Any], shapes: list[Any]) -> list[str]:
    """Ids of the shapes that shine, or of the emitters themselves."""
    names: list[str] = []
    for emitter in emitters:
        own = (shape.id() for shape in shapes if shape.is_emitter() and shape.emitter() == emitter)
        name = next(own, emitter.id() or "emitter")
        names.append(name if name not in names else f"{name} {len(names)}")
    return names


def _transmits(mi: Any, shape: Any) -> bool:
    return bool(int(shape.bsdf().flags()) & int(mi.BSDFFlags.Transmission))


def _follow(
    mi: Any,
    scene: Any,
    sampler: Any,
    record: RayRecorder,
    place: Any,
    along: Any,
    color: Any,
    depth: int,
) -> list[Point]:
    """Points of one ray."""
    context = mi.BSDFContext(mi.TransportMode.Importance)
    flags = [(int(getattr(mi.BSDFFlags, name)), event) for name, event in _EVENTS.items()]
    medium = _OUTSIDE
    points = [Point(position=place, event=Event.EMITTED, medium=medium, color=color)]
    while True:
        hit = scene.ray_intersect(mi.Ray3f(place.tolist(), along.tolist()))
        if not hit.is_valid():
            points.append(record.leave(place, along, medium=medium, color=color))
            return points
        name = hit.shape.id()
        place, normal = np.array(hit.p).ravel(), np.array(hit.n).ravel()
        where: dict[str, Any] = {"position": place, "normal": normal, "object": name}
        bsdf = hit.bsdf()
        sample, weight = bsdf.sample(context, hit, sampler.next_1d(), sampler.next_2d())
        after = color * np.maximum(np.array(weight).ravel(), 0.0)
        survival = min(1.0, float(after.sum() / color.sum()))
        if sampler.next_1d() >= survival:
            end = Event.SURFACE_ABSORPTION
            points.append(Point(event=end, medium=medium, color=color, **where))
            return points
        color = after / after.sum() * color.sum()
        event = next((word for flag, word in flags if int(sample.sampled_type) & flag), Event(0))
        if len(points) + 1 >= depth:
            event |= Event.DEPTH_LIMIT
            points.append(Point(event=event, medium=medium, color=color, **where))
            return points
        entering = float(along @ normal) < 0
        along = np.array(hit.to_world(sample.wo)).ravel()
        if event & Event.MEDIUM_CHANGED:
            medium = f"in {name}" if entering else _OUTSIDE
        points.append(Point(event=event, medium=medium, color=color, **where))
        place = place + 1e-5 * max(1.0, float(np.abs(place).max())) * along


def _meshes(mi: Any, scene: Any, shapes: list[Any]) -> dict[str, DisplayMesh]:
    """Triangles to draw the shapes with; spheres, rectangles, discs and cubes by their frames."""
    parameters = mi.traverse(scene)
    found = {}
    for shape in shapes:
        name = shape.id()
        if shape.is_mesh():
            own = mi.traverse(shape)
            vertices = np.array(own["vertex_positions"], np.float64).reshape(-1, 3)
            triangles = np.array(own["faces"], np.int32).reshape(-1, 3)
        else:
            unit = _UNIT.get(type(shape).__name__, _UNIT.get(_kind(shape)))
            key = f"{name}.to_world"
            if unit is None or key not in parameters:
                continue
            vertices, triangles = unit()
            frame = np.array(parameters[key].matrix, np.float64).reshape(4, 4)
            vertices = vertices @ frame[:3, :3].T + frame[:3, 3]
        found[name] = DisplayMesh(
            vertices=vertices.astype(np.float32),
            triangles=triangles,
            face=np.zeros(len(triangles), np.int32),
        )
    return found


def _kind(shape: Any) -> str:
    """The kind of a shape as it prints itself."""
    return str(shape).partition("[")[0].strip()


def _sphere() -> tuple[Any, Any]:
    rows, columns = 24, 48
    v, u = np.meshgrid(
        np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij"
    )
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1).reshape(-1, 3)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    a, b, c, d = first, first + 1, first + columns + 1, first + columns + 2
    return points, np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)]).astype(np.int32)


def _square() -> tuple[Any, Any]:
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    return points, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def _disc() -> tuple[Any, Any]:
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros(48)], 1)
    points = np.concatenate([np.zeros((1, 3)), rim])
    k = np.arange(48)
    return points, np.stack([np.zeros(48), 1 + k, 1 + (k + 1) % 48], 1).astype(np.int32)


_UNIT = {"Sphere": _sphere, "Rectangle": _square, "Disk": _disc}
