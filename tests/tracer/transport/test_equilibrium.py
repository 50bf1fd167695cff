"""Among evenly glowing walls radiance is the same everywhere, whatever lossless bodies stand there.

The walls of a room emit natural light by Lambert's law and absorb all that comes back. In thermal
equilibrium every place of every wall gets back what it emits, in every channel, and every plane in
between sees the same radiance from all directions: that holds only where all that reflects,
refracts and scatters is reciprocal, loses nothing, and where no ray is lost at edges and coincident
faces.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.tracer.transport.tracing import compiled
from tracer.run.recording import record

HALF = 5.0
RAYS = 300_000
ANGLES = (20, 45, 90)

MATERIALS = """
[limits]
depth = 20000
[media.glass]
index = { rgb = [1.5, 1.6, 1.7] }
[media.dense]
index = 2.2
[media.milk]
index = 1.4
scattering = { mean_free_path = 0.8, phase = { kind = "henyey_greenstein", g = 0.6 } }
[surfaces.satin]
kind = "rough_dielectric"
roughness = 0.4
[surfaces.brushed]
kind = "rough_mirror"
reflectance = 1
roughness = 0.5
[surfaces.polish]
kind = "dielectric"
scatter = { abg = [0.008, 0.3, 1.5] }
[surfaces.half]
kind = "dielectric"
reflectance = { rgb = [0.3, 0.5, 0.1] }
[surfaces.coated]
kind = "dielectric"
[surfaces.coated.coating]
between = ["air", "glass"]
layers = [{ index = 1.38, thickness_nm = 99.5 }, { index = 2.3, thickness_nm = 150 }]
[surfaces.opal]
kind = "lambertian"
reflectance = 0.3
transmittance = 0.7
"""

SLAB = """
[bodies.slab]
kind = "box"
size = [8.8, 8.8, 1]
medium = "{medium}"
surface = "{surface}"
"""

CROWD = """
[bodies.block]
kind = "box"
size = [4, 3, 2]
rotation = [20, 30, 40]
position = [-1, 0, 0]
medium = "glass"
faces = { x_min = "coated", y_max = "half" }
[bodies.ball]
kind = "sphere"
radius = 1.6
position = [0.5, 0.4, 0.3]
medium = "milk"
priority = 1
[bodies.core]
kind = "cylinder"
radius = 0.5
length = 1
position = [0.5, 0.4, 0]
medium = "dense"
priority = 2
surface = "satin"
[bodies.lower]
kind = "box"
size = [2, 2, 0.7]
position = [2.2, -2.5, -2.35]
medium = "dense"
[bodies.upper]
kind = "cylinder"
radius = 0.8
length = 1
position = [2.3, -2.5, -2]
medium = "glass"
surface = "polish"
[bodies.lens]
kind = "lens"
thickness = 1.2
position = [2, 2, 1]
axis = [0.3, 0.2, 1]
medium = "glass"
rim = "bare"
front = { radius = 3, conic = -1.2, semi_diameter = 1.4 }
back = { radius = -6, semi_diameter = 1.3, aspheric = [0.003] }
[bodies.sheet]
kind = "rectangle"
size = [3, 2]
position = [-2, -2, -2]
axis = [1, 1, 0.5]
surface = "opal"
[bodies.tube]
kind = "cone"
radius = 1
end_radius = 0.4
length = 2
open = true
position = [-2, 2, -3]
surface = "brushed"
"""

SCENES = {
    "rough glass": SLAB.format(medium="dense", surface="satin"),
    "scattering polish": SLAB.format(medium="glass", surface="polish"),
    "coated glass": SLAB.format(medium="glass", surface="coated"),
    "milk": SLAB.format(medium="milk", surface="bare"),
    "crowd": CROWD,
}


def room() -> str:
    """Walls that emit 1 each and register what comes back; planes that look at what is inside."""
    text = ""
    for axis in range(3):
        for side in (-1, 1):
            place, inwards = np.zeros(3), np.zeros(3)
            place[axis], inwards[axis] = side * HALF, -side
            up = np.roll(np.abs(inwards), 1)
            name = f"{'xyz'[axis]}{side + 1}"
            lies = f"up = {up.tolist()}\nlooks = "
            text += f"""
[sources.{name}]
kind = "lambertian"
position = {place.tolist()}
axis = {inwards.tolist()}
size = [{2 * HALF}, {2 * HALF}]
[detectors.wall_{name}]
position = {place.tolist()}
{lies}{inwards.tolist()}
size = [{2 * HALF}, {2 * HALF}]
cells = [3, 3]
blocking = true
"""
            text += "".join(
                f"""
[detectors.plane_{name}_{angle}]
position = {(0.9 * place).tolist()}
{lies}{(-inwards).tolist()}
size = [{HALF}, {HALF}]
cells = [1, 1]
acceptance_deg = {angle}
"""
                for angle in ANGLES
            )
    return text


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in ("rough glass", "crowd") else [pytest.mark.slow])
        for name in SCENES
    ],
)
def test_radiance_is_the_same_everywhere(name: str) -> None:
    result = record(compiled(MATERIALS + SCENES[name] + room()), rays=RAYS, no_rays=True)
    for audit in result.audit.values():
        assert audit["detected"] == audit["emitted"], audit
    z = []
    for detector, count in result.detectors.items():
        expected = 1.0 / 9.0
        if detector.startswith("plane"):
            expected = 0.25 * np.sin(np.radians(int(detector.rpartition("_")[2]))) ** 2
        error = np.sqrt(expected * 6.0 / RAYS)
        z.append(((count.flux - expected) / error).ravel())
        # A channel has a third of the light, and at worst the rays of one channel alone
        z.append(((count.channels - expected / 3.0) / error).ravel())
    found = np.concatenate(z)
    assert np.abs(found).max() < 4.7, found
    assert (found**2).mean() < 1.4, found
