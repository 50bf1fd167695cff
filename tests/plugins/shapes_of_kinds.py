"""Records scenes with the shape of the example distribution; prints what came out, as JSON.

A process of its own: the distribution is installed for it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from tests.naive.rays import rays_of
from tests.plugins.laws_of_kinds import HEAD, flux, recorded, total
from tracer import compile_scene, parse_scene

TORUS = """
[bodies.torus]
kind = "torus"
ring = 10
tube = 3
position = [1, 2, 60]
axis = [{axis}]
{what}
"""
BEAM = """
[sources.beam]
kind = "collimated"
position = [1, 2, 0]
{spot}
"""
BLACK = 'surface = "black"\n[surfaces.black]\nkind = "absorber"'
GREY = 'medium = "grey"\n[media.grey]\nindex = 1.0\nabsorption = 0.05'
GLASS = 'medium = "glass"\n[media.glass]\nindex = 1.5'
SHINY = 'surface = "shiny"\n[surfaces.shiny]\nkind = "mirror"\nreflectance = 1.0'
WHITE = 'surface = "white"\n[surfaces.white]\nkind = "lambertian"\nreflectance = 0.8'
SIDE = """
[detectors.side]
kind = "plane"
position = [61, 2, 0]
looks = [-0.707, 0, 0.707]
size = [20, 20]
cells = [1, 1]
"""
WEIGHTED = '[trace]\nmode = "weighted"\naim = ["side"]\naim_share = 0.5\n'
EYE = """
[detectors.eye]
kind = "pinhole"
position = [61, 2, 0]
looks = [-0.707, 0, 0.707]
cells = [8, 8]
field_deg = 40
"""


def main(folder: Path) -> None:
    told: dict[str, object] = {}
    wide, flat = BEAM.format(spot="diameter = 40"), BEAM.format(spot="size = [6, 28]")
    with recorded(folder, wide + TORUS.format(axis="0, 0, 1", what=BLACK), 100_000) as opened:
        told["shadow"] = flux(opened, 'hit("torus")')
    with recorded(folder, flat + TORUS.format(axis="1, 0, 0", what=GREY), 100_000) as opened:
        told["absorbed"] = flux(opened, "event(volume_absorption)")
    tilted = TORUS.format(axis="0.3, -0.5, 0.8", what=SHINY)
    with recorded(folder, wide + tilted, 4_000) as opened:
        _, frame = parse_scene(HEAD + wide + tilted).bodies["torus"].frame()
        told["frame"] = frame.tolist()
        told["ways"] = [
            [point.position for point in ray.points]
            for ray in rays_of(opened)
            if len(ray.points) > 2
        ]
        told["normals"] = [
            [point.normal for point in ray.points[1:-1]]
            for ray in rays_of(opened)
            if len(ray.points) > 2
        ]
    clear = TORUS.format(axis="0.3, -0.5, 0.8", what=GLASS)
    for name, light in (("natural", ""), ("polarised", '[trace]\nlight = "polarised"\n')):
        with recorded(folder, wide + clear + light, 20_000) as opened:
            told[f"{name} errors"] = flux(opened, "event(geometry_error)")[0]
            told[f"{name} reflected"] = flux(opened, 'hit("torus") & bounces == 1')
    white = TORUS.format(axis="0, 1, 1", what=WHITE)
    with recorded(folder, wide + white + SIDE, 400_000) as opened:
        told["side"] = flux(opened, 'detected("side")')
    with recorded(folder, wide + white + SIDE + WEIGHTED, 50_000) as opened:
        told["aimed"] = flux(opened, 'detected("side")')
    with recorded(folder, wide + white + SIDE.replace("20, 20", "2, 2") + EYE, 200_000) as opened:
        told["seen"] = total(opened, "eye")
    mesh = compile_scene(parse_scene(HEAD + wide + tilted)).meshes[0]
    corners = np.asarray(mesh.vertices, float)[np.asarray(mesh.triangles)]
    told["volume"] = float(np.linalg.det(corners).sum() / 6.0)
    print(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
