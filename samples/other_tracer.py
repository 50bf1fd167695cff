"""Another tracer's light in a ray map: Mitsuba 3 traces, Raymap records and answers.

``python samples/other_tracer.py [out.raymap] [rays]`` needs ``pip install 'raymap[mitsuba]'``.

A spot lamp shines through a glass ball onto a grey floor between two coloured walls. Mitsuba finds
the surfaces and samples the materials; this program turns what it says into plain NumPy columns,
portion by portion, and hands them to `raymap.RayMapWriter`, which checks them. From then on it is a
ray map like any other: ``raymap info``, ``raymap query``, ``raymap paths``, ``raymap picture``.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import raymap
from raymap.model.events import Event

PORTION = 2000
MAX_POINTS = 64
RADIUS = 10.0
EVENTS = {
    "DiffuseReflection": Event.DIFFUSE_REFLECTION,
    "GlossyReflection": Event.GLOSSY_REFLECTION,
    "DeltaReflection": Event.SPECULAR_REFLECTION,
    "DeltaTransmission": Event.SPECULAR_REFRACTION | Event.MEDIUM_CHANGED,
    "GlossyTransmission": Event.GLOSSY_TRANSMISSION | Event.MEDIUM_CHANGED,
}


def make_scene(mi: Any) -> Any:
    """A glass ball over a floor between a red and a green wall."""
    turn, shift = mi.ScalarTransform4f().rotate, mi.ScalarTransform4f().translate
    size = mi.ScalarTransform4f().scale([3, 3, 1])

    def wall(place: Any, color: list[float]) -> dict[str, Any]:
        material = {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}
        return {"type": "rectangle", "to_world": place @ size, "bsdf": material}

    return mi.load_dict(
        {
            "type": "scene",
            "ball": {
                "type": "sphere",
                "center": [0, 0, 1.5],
                "radius": 1.0,
                "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
            },
            "floor": wall(shift([0, 0, 0]), [0.5, 0.5, 0.5]),
            "red": wall(shift([-3, 0, 3]) @ turn([0, 1, 0], 90), [0.6, 0.05, 0.05]),
            "green": wall(shift([3, 0, 3]) @ turn([0, 1, 0], -90), [0.05, 0.6, 0.05]),
        }
    )


def make_directory(names: list[str]) -> raymap.Directory:
    """What the columns' indices speak about; shapes are given where they are known.

    The ball is a quadric, so that the file need not store its normals nor one coordinate.
    """
    ball = raymap.Quadric(coefficients=(1, 1, 1, 0, 0, 0, 0, 0, -3.0, 1.25), solve_axis=2)
    shapes = {
        "ball": raymap.Face(name="surface", quadrics=(ball,)),
        "floor": raymap.Face(name="surface", quadrics=(_plane(0, 0, 1, 0),)),
        "red": raymap.Face(name="surface", quadrics=(_plane(1, 0, 0, 3, axis=0),)),
        "green": raymap.Face(name="surface", quadrics=(_plane(-1, 0, 0, 3, axis=0),)),
    }
    return raymap.Directory(
        length_unit="m",
        sources=(raymap.Source(name="lamp", flux=100.0, kind="spot"),),
        objects=tuple(raymap.SceneObject(name=name, faces=(shapes[name],)) for name in names),
        media=(raymap.Medium(name="air"), raymap.Medium(name="glass")),
        bounding_sphere=raymap.BoundingSphere(radius=RADIUS),
        scene_hash="mitsuba: ball over a floor, 1",
        title="A glass ball, traced by Mitsuba 3",
    )


def _plane(x: float, y: float, z: float, one: float, axis: Any = 2) -> raymap.Quadric:
    """The plane x X + y Y + z Z + one = 0 with outward normal (x, y, z)."""
    return raymap.Quadric(coefficients=(0, 0, 0, 0, 0, 0, x, y, z, one), solve_axis=axis)


class Columns:
    """Records of some rays, point by point, and the portion that they make."""

    def __init__(self, first_ray: int) -> None:
        self.first_ray = first_ray
        self.counts: list[int] = []
        self.rows: list[tuple[Any, ...]] = []

    def ray(self, points: list[tuple[Any, ...]]) -> None:
        """Points are (position, normal, object, event, medium, colour)."""
        self.counts.append(len(points))
        self.rows += points

    def portion(self) -> raymap.Portion:
        position, normal, item, event, medium, color = zip(*self.rows, strict=True)
        shares = np.array(color, float)
        shares /= shares.sum(axis=1, keepdims=True)
        stored = np.rint(shares * 65535).astype(np.int64)
        stored[:, 2] = 65535 - stored[:, 0] - stored[:, 1]
        table, codes = np.unique(stored, axis=0, return_inverse=True)
        n = len(item)
        objects = np.array(item, np.int16)
        return raymap.Portion(
            emitted=np.array([len(self.counts)]),
            source=np.zeros(len(self.counts), np.int16),
            records_per_ray=np.array(self.counts, np.int32),
            position=np.array(position, np.float32),
            normal=np.rint(np.array(normal, float) * 32767).astype(np.int16),
            object=objects,
            triangle=np.where(objects < 0, -1, 0).astype(np.int32),
            event=np.array([int(each) for each in event], np.int32),
            medium=np.array(medium, np.int16),
            color_code=(codes.reshape(n) + 3).astype(np.int32),
            color_table=table.astype(np.uint16),
            descriptor_count=np.zeros(n, np.uint16),
            descriptors=raymap.Descriptors(
                detector=np.empty(0, np.int16),
                cell=np.empty((0, 2), np.uint16),
                cosine=np.empty(0, np.int16),
                uv=np.empty((0, 2), np.uint16),
                registered=np.empty(0, np.bool_),
            ),
            first_ray=self.first_ray,
        )


def trace_ray(mi: Any, scene: Any, sampler: Any, names: list[str]) -> list[tuple[Any, ...]]:
    """Follow one ray through Mitsuba's scene; roulette by its albedo keeps the flux equal."""
    context = mi.BSDFContext(mi.TransportMode.Importance)
    flags = [(int(getattr(mi.BSDFFlags, name)), event) for name, event in EVENTS.items()]
    u, v = np.array(sampler.next_2d()).ravel()
    place = np.array([0.0, 0.0, 6.0])
    slope = 0.5 * np.sqrt(u) * np.array([np.cos(2 * np.pi * v), np.sin(2 * np.pi * v)])
    direction = np.array([*slope, -1.0]) / np.sqrt(1.0 + slope @ slope)
    color = np.ones(3)
    points: list[tuple[Any, ...]] = [(place, np.zeros(3), -1, Event.EMITTED, 0, color)]
    medium = 0
    while True:
        hit = scene.ray_intersect(mi.Ray3f(place.tolist(), direction.tolist()))
        if not hit.is_valid():
            b = place @ direction
            end = place + (np.sqrt(b * b - place @ place + RADIUS**2) - b) * direction
            points.append((end, direction, -1, Event.LEFT_SCENE, medium, color))
            return points
        item = names.index(hit.shape.id())
        place, normal = np.array(hit.p).ravel(), np.array(hit.n).ravel()
        sample, weight = hit.bsdf().sample(context, hit, sampler.next_1d(), sampler.next_2d())
        after = color * np.array(weight).ravel()
        survival = min(1.0, float(after.sum() / color.sum()))
        if sampler.next_1d() >= survival:
            points.append((place, normal, item, Event.SURFACE_ABSORPTION, medium, color))
            return points
        color = after / after.max()
        event = next(word for flag, word in flags if int(sample.sampled_type) & flag)
        if len(points) + 1 == MAX_POINTS:
            points.append((place, normal, item, event | Event.DEPTH_LIMIT, medium, color))
            return points
        if event & Event.MEDIUM_CHANGED:
            medium = 1 - medium
        points.append((place, normal, item, event, medium, color))
        direction = np.array(hit.to_world(sample.wo)).ravel()
        place = place + 1e-5 * direction


def record(path: Path, rays: int, seed: int = 1) -> None:
    """Trace with Mitsuba, write a ray map."""
    try:
        import mitsuba as mi
    except ImportError:
        raise SystemExit("this sample needs Mitsuba 3: pip install 'raymap[mitsuba]'") from None
    mi.set_variant("scalar_rgb")
    scene = make_scene(mi)
    names = [shape.id() for shape in scene.shapes()]
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, 1)
    channels = raymap.ChannelSet(
        kind="rgb",
        wavelengths_nm=(610.0, 550.0, 465.0),
        luminous=(0.2126, 0.7152, 0.0722),
        display_rgb=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        refractive_index=((1.0, 1.0, 1.0), (1.5, 1.5, 1.5)),
        absorption=((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        source_colors=((1 / 3, 1 / 3, 1 / 3),),
    )
    with raymap.RayMapWriter.create(path, make_directory(names), force=True) as writer:
        writer.add_channel_set(channels)
        writer.start_run(seed=seed, parameters={"tracer": f"Mitsuba {mi.__version__}"})
        for first in range(0, rays, PORTION):
            columns = Columns(first)
            for _ in range(min(PORTION, rays - first)):
                columns.ray(trace_ray(mi, scene, sampler, names))
            writer.append(columns.portion())


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("ball.raymap")
    record(path, int(sys.argv[2]) if len(sys.argv) > 2 else 20_000)
    import query

    with raymap.open(path) as ray_map:
        print(f"{path}: {ray_map.rays} rays, {ray_map.records} records, {ray_map.bytes} bytes")
        for criterion in (
            'hit("ball", refracted) -> hit("ball", refracted) -> hit("floor")',
            'count(hit("ball", reflected)) >= 1',
            'hit("red") -> hit("green")',
        ):
            selection = query.select(ray_map, criterion)
            print(f"{criterion}: {len(selection.ray_ids)} rays")


if __name__ == "__main__":
    main()
