"""Records scenes whose media are kinds of the example distribution; prints what came out, as JSON.

A process of its own: the distribution is installed for it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from raymap.file.reader import RayMap
from raymap.model.events import Event
from tests.naive.rays import rays_of
from tests.plugins.laws_of_kinds import flux, recorded, total
from tracer import compile_scene, parse_scene

DUST = """
[media.dust]
index = 1.0
scattering = {{ mean_free_path = {path}, albedo = 0.9, phase = {{ kind = "draine", g = {g}, alpha = {alpha} }} }}
[world]
medium = "dust"
[sources.beam]
kind = "collimated"
diameter = 0.01
"""  # noqa: E501
SIDE = """
[detectors.side]
kind = "plane"
position = [30, 0, 40]
looks = [-1, 0, 0]
size = [20, 40]
cells = [1, 1]
[bodies.wall]
kind = "sphere"
radius = 200
surface = "black"
[surfaces.black]
kind = "absorber"
"""
WEIGHTED = """
[trace]
mode = "weighted"
aim = ["side"]
aim_share = 0.5
"""
PINHOLE = """
[detectors.eye]
kind = "pinhole"
position = [80, 0, 40]
looks = [-1, 0, 0]
cells = [8, 8]
field_deg = 80
"""
SLAB = """
[spectrum]
kind = "spectral"
wavelengths_nm = [450, 550, 650]
[media.glass]
conrady = [1.49, 0.012, 0.0008]
kappa = { wavelength_nm = [400, 700], value = [2e-6, 8e-6] }
[surfaces.bare]
kind = "dielectric"
[bodies.slab]
kind = "box"
size = [100, 100, 20]
position = [0, 0, 50]
medium = "glass"
surface = "bare"
[sources.beam]
kind = "collimated"
diameter = 0.01
"""


def first_cosines(opened: RayMap) -> list[float]:
    """Of the angles by which rays are scattered for the first time."""
    found = []
    for ray in rays_of(opened):
        for k, point in enumerate(ray.points[1:-1], start=1):
            if point.event & Event.VOLUME_SCATTER:
                a, b, c = (np.array(ray.points[i].position, float) for i in (k - 1, k, k + 1))
                before, after = b - a, c - b
                lengths = float(np.linalg.norm(before) * np.linalg.norm(after))
                found.append(float(before @ after) / lengths)
                break
    return found


def main(folder: Path) -> None:
    told: dict[str, object] = {}
    for name, g, alpha in (("dust", 0.5, 1.0), ("sharp", 0.95, 2.0), ("back", -0.4, 0.3)):
        text = DUST.format(path=1e4, g=g, alpha=alpha)
        # Ways of 1e4 mm to the first scattering are known well enough as float32
        with recorded(folder, text + SIDE.replace("200", "1e6"), 40_000) as opened:
            told[name] = first_cosines(opened)
            told[f"{name} law"] = opened.laws().media[-1].phase.model_dump(exclude_unset=True)
    text = DUST.format(path=60.0, g=0.5, alpha=1.0)
    with recorded(folder, text + SIDE, 400_000) as opened:
        told["side"] = flux(opened, 'detected("side")')
    with recorded(folder, text + SIDE + WEIGHTED, 100_000) as opened:
        told["aimed"] = flux(opened, 'detected("side")')
    with recorded(folder, text.replace("60.0", "20000.0") + SIDE + PINHOLE, 200_000) as opened:
        told["seen"] = total(opened, "eye")
    compiled = compile_scene(parse_scene('length_unit = "cm"\n' + SLAB))
    told["index"] = compiled.channel_set.refractive_index[-1]
    told["absorption"] = compiled.channel_set.absorption[-1]
    with recorded(folder, SLAB, 200_000) as opened:
        told["absorbed"] = flux(opened, "event(volume_absorption)")
        told["kind"] = opened.directory.media[-1].kind
    print(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
