"""Records scenes with the kinds of the example distribution; prints what came out, as JSON.

A process of its own: the distribution is installed for it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

import query
import raymap
from raymap.file.reader import RayMap
from tests.naive.rays import rays_of
from tracer import compile_scene, parse_scene, record

HEAD = 'length_unit = "mm"\n'
BEAM = """
[sources.beam]
kind = "collimated"
diameter = 1
position = [0, 0, 50]
axis = [0, 0, -1]
"""
PLATE = """
[surfaces.plate]
kind = "phong"
diffuse = 0.3
glossy = 0.5
exponent = 20
[bodies.plate]
kind = "rectangle"
size = [100, 100]
surface = "plate"
"""
SIDE = """
[detectors.side]
kind = "plane"
position = [30, 0, 52]
looks = [-0.5, 0, -0.866]
size = [20, 20]
cells = [1, 1]
"""
WEIGHTED = """
[trace]
mode = "weighted"
aim = ["side"]
aim_share = 0.5
min_reflection = 0.9
"""
PINHOLE = """
[detectors.eye]
kind = "pinhole"
position = {position}
looks = {looks}
cells = [4, 4]
field_deg = 10
"""


def recorded(folder: Path, text: str, rays: int) -> RayMap:
    path = folder / "kinds.raymap"
    path.unlink(missing_ok=True)
    record(parse_scene(HEAD + text), path, rays=rays, seed=5)
    return raymap.open(path)


def flux(opened: RayMap, criterion: str) -> list[float]:
    found = query.select(opened, criterion)
    return [float(np.sum(found.flux)), float(np.sum(found.flux_se))]


def total(opened: RayMap, detector: str) -> list[float]:
    image = query.detector_image(opened, detector)
    return [float(image.total), float(image.total_se)]


def main(folder: Path) -> None:
    told: dict[str, object] = {}
    with recorded(folder, BEAM + PLATE + SIDE, 400_000) as opened:
        told["phong"] = flux(opened, "event(glossy_reflection)")
        told["side"] = flux(opened, 'detected("side")')
    with recorded(folder, BEAM + PLATE + SIDE + WEIGHTED, 100_000) as opened:
        told["aimed"] = flux(opened, 'detected("side")')
    eye = PINHOLE.format(position="[30, 0, 51.96]", looks="[-0.5, 0, -0.866]")
    with recorded(folder, BEAM + PLATE + eye, 100_000) as opened:
        told["seen"] = total(opened, "eye")
    mirror = """
[surfaces.polished]
kind = "mirror"
reflectance = 1.0
scatter = { k_correlation = [20.0, 50.0, 3.0] }
[bodies.mirror]
kind = "rectangle"
size = [200, 200]
surface = "polished"
"""
    with recorded(folder, BEAM + mirror, 400_000) as opened:
        told["scattered"] = flux(opened, "event(glossy_reflection)")
        stored = opened.directory.surfaces[0]
        told["stored"] = [stored.kind, stored.parameters]
    diode = """
[sources.diode]
kind = "diode"
spread_deg = [10, 25]
"""
    eye = PINHOLE.format(position="[20, 30, 100]", looks="[-0.2, -0.3, -1]")
    with recorded(folder, diode + eye, 20_000) as opened:
        ends = np.array([ray.points[-1].position for ray in rays_of(opened)], float)
        told["slopes"] = np.std(ends[:, :2] / ends[:, 2:], axis=0).tolist()
        told["diode seen"] = total(opened, "eye")
    drum = """
[sources.lamp]
kind = "point"
[detectors.drum]
kind = "drum"
position = [0, 0, -20]
radius = 30
height = 40
cells = [36, 20]
"""
    with recorded(folder, drum, 200_000) as opened:
        told["drum"] = flux(opened, 'detected("drum")')
        told["drum picture"] = total(opened, "drum")
        measure = query.detector_image(opened, "drum").measure
        told["drum area"] = [measure.quantity, float(measure.values.sum())]
    pyramid = """
[media.glass]
index = 1.5
[bodies.pyramid]
kind = "pyramid"
base = 10
height = 12
medium = "glass"
position = [3, 4, 5]
axis = [1, 1, 1]
"""
    mesh = compile_scene(parse_scene(HEAD + BEAM + pyramid)).meshes[0]
    corners = np.asarray(mesh.vertices, float)[np.asarray(mesh.triangles)]
    told["volume"] = float(np.linalg.det(corners).sum() / 6.0)
    print(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
