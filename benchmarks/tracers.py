"""Raymap beside other tracers, in one run: python benchmarks/tracers.py

- *lens*: the double Gauss of the samples with all its reflections, rims, colours and the detector,
  traced and recorded; beside it the double Gauss that Optiland ships, traced in the order of its
  surfaces: refraction alone, every ray one path.
- *room*: the diffuse room of the samples, traced and recorded; beside it the particle tracer of
  Mitsuba 3 among the same walls and blocks, from the same lamp, to the same depth. It keeps no
  rays; it looks for the camera from every point instead.

Tracers that are not installed are left out. ``--mitsuba`` names one of Mitsuba's variants; those of
LLVM want a library of LLVM that they can load, and abort with one that is too old.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from record import SAMPLE, machine

from tracer import Compilation, compile_scene, load_scene, record
from tracer.geometry.shapes import Rectangle
from tracer.scene.model import Scene

ROOM = SAMPLE.parent / "room.toml"
FILM = 256


def raymap_rate(compilation: Compilation, path: Path | None, rays: int, seed: int) -> float:
    """Rays a second, recorded where there is a path."""
    result = record(compilation, path, rays=rays, seed=seed, no_rays=path is None, force=True)
    return result.rays_per_second


def optiland_rate(rays: int) -> float:
    """Rays a second of Optiland's own double Gauss, on its axis, at random places of the pupil."""
    from optiland.samples.objectives import DoubleGauss

    lens = DoubleGauss()
    lens.trace(Hx=0.0, Hy=0.0, wavelength=0.5876, num_rays=1000, distribution="random")
    start = time.perf_counter()
    lens.trace(Hx=0.0, Hy=0.0, wavelength=0.5876, num_rays=rays, distribution="random")
    return rays / (time.perf_counter() - start)


def mitsuba_rate(scene: Scene, variant: str, rays: int, seed: int) -> float:
    """Rays a second of Mitsuba's particle tracer in a scene of diffuse rectangles."""
    import mitsuba as mi

    mi.set_variant(variant)
    mi.logger().clear_appenders()
    film = {"type": "hdrfilm", "width": FILM, "height": FILM}
    look = mi.ScalarTransform4f().look_at([0, 0, -3.9], [0, 0, 0], [0, 1, 0])
    room = mi.load_dict(
        {
            "type": "scene",
            **_walls(mi, scene),
            **_lamps(mi, scene),
            "camera": {"type": "perspective", "fov": 40.0, "to_world": look, "film": film},
        }
    )
    # Roulette that starts behind the last point never happens
    depth = scene.limits.depth
    particles = mi.load_dict(
        {"type": "ptracer", "max_depth": depth, "rr_depth": 10 * depth, "hide_emitters": False}
    )
    np.array(mi.render(room, integrator=particles, spp=1, seed=seed))
    per_pixel = max(1, rays // FILM**2)
    start = time.perf_counter()
    np.array(mi.render(room, integrator=particles, spp=per_pixel, seed=seed))
    return per_pixel * FILM**2 / (time.perf_counter() - start)


def _walls(mi: Any, scene: Scene) -> dict[str, Any]:
    """Every face of the bodies as a diffuse rectangle."""
    walls: dict[str, Any] = {}
    for name, body in scene.bodies.items():
        surface = scene.surfaces[body.surface]
        colour = {"type": "rgb", "value": list(surface.reflectance.rgb)}
        diffuse = {"type": "twosided", "side": {"type": "diffuse", "reflectance": colour}}
        shapes = [shape for face in body.plan() for shape in face.shapes]
        for number, shape in enumerate(shapes):
            walls[f"{name}_{number}"] = _rectangle(mi, shape) | {"bsdf": diffuse}
    return walls


def _lamps(mi: Any, scene: Scene) -> dict[str, Any]:
    """Every source, Lambertian rectangles all of them, as a rectangle that shines."""
    lamps = {}
    for name, source in scene.sources.items():
        normal = np.array(source.axis) / np.linalg.norm(source.axis)
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        u /= np.linalg.norm(u)
        face = Rectangle(np.array(source.position), u, np.cross(normal, u), source.size)
        light = {"type": "area", "radiance": {"type": "rgb", "value": list(source.spectrum.rgb)}}
        lamps[name] = _rectangle(mi, face) | {"emitter": light}
    return lamps


def _rectangle(mi: Any, shape: Rectangle) -> dict[str, Any]:
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = shape.u * shape.size[0] / 2, shape.v * shape.size[1] / 2
    matrix[:3, 2], matrix[:3, 3] = shape.normal, shape.origin
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix)}


def installed(name: str) -> str | None:
    """Version of a package, None without it."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def main() -> None:
    """Measure in turns and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rays", type=int, default=2_000_000)
    parser.add_argument("--peer-rays", type=int, default=500_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mitsuba", default="scalar_rgb", metavar="VARIANT")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    lens, room = compile_scene(load_scene(SAMPLE)), compile_scene(load_scene(ROOM))
    peers = {name: installed(name) for name in ("optiland", "mitsuba")}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "benchmark.raymap"
        few, rays, seed = 20_000, options.rays, options.seed
        runs: dict[str, Callable[[], float]] = {}
        for name, scene in (("lens", lens), ("room", room)):
            # Compile everything before the clock starts
            raymap_rate(scene, path, few, seed)
            runs[f"{name} traced"] = lambda scene=scene: raymap_rate(scene, None, rays, seed)
            runs[f"{name} recorded"] = lambda scene=scene: raymap_rate(scene, path, rays, seed)
        if peers["optiland"]:
            runs["lens optiland"] = lambda: optiland_rate(options.peer_rays)
        if peers["mitsuba"]:
            runs["room mitsuba"] = lambda: mitsuba_rate(
                room.scene, options.mitsuba, options.peer_rays, seed
            )
        measured: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(options.repeat):
            for name, run in runs.items():
                measured[name].append(run())
    rates = {name: statistics.median(values) for name, values in measured.items()}
    ratios = {
        f"{peer[5:]}, {kind}": round(rates[f"{peer[:4]} {kind}"] / rates[peer], 2)
        for peer in rates
        if peer in ("lens optiland", "room mitsuba")
        for kind in ("traced", "recorded")
    }
    report = {
        "machine": machine() | peers | {"mitsuba variant": options.mitsuba},
        "threads": os.cpu_count(),
        "seed": seed,
        "rays_per_second": {name: round(rate) for name, rate in rates.items()},
        "times_as_fast_as": ratios,
    }
    json.dump(report, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
