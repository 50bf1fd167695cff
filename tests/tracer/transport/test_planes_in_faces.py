"""Rounding where planes and faces coincide, and far from the origin."""

from __future__ import annotations

import pytest

from tests.tracer.transport.tracing import compiled
from tracer.run.recording import record

# A turned plate and a white wall, each with a virtual plane just before it and one in its face
PLATE = """
[media.glass]
index = 1.5
[surfaces.white]
kind = "lambertian"
reflectance = 0.7
[bodies.plate]
kind = "cylinder"
radius = 6
length = 2
axis = [0.3, -0.4, 0.8]
medium = "glass"
[bodies.wall]
kind = "disc"
outer = 6
axis = [0.3, -0.4, 0.8]
position = [1.5899915, -2.1199887, 4.2399774]
surface = "white"
[sources.lamp]
kind = "lambertian"
diameter = 1
cone_deg = 20
axis = [0.3, -0.4, 0.8]
position = [-0.3, 0.4, -0.8]
"""
NORMAL = (0.3 / 0.89**0.5, -0.4 / 0.89**0.5, 0.8 / 0.89**0.5)


def test_a_plane_in_a_face_counts_what_arrives_there_once() -> None:
    wall = 1.5899915 / NORMAL[0]
    text = PLATE
    for name, height in (("front", 0.0), ("back", 2.0), ("wall", wall)):
        for place, shift in (("in", 0.0), ("before", -1e-5)):
            position = [(height + shift) * n for n in NORMAL]
            text += f"""
[detectors.{name}_{place}]
position = {position}
looks = [-0.3, 0.4, -0.8]
size = [9, 9]
cells = [1, 1]
"""
    result = record(compiled(text), rays=20_000, no_rays=True, threads=1)
    for name in ("front", "back", "wall"):
        found, expected = (result.detectors[f"{name}_{place}"].total for place in ("in", "before"))
        assert found == pytest.approx(expected, rel=1e-3), name


# A core flush with the top of its block, 50,000 times its width away from the origin
FLUSH = """
[media.low]
index = 1.5
[media.high]
index = 1.8
[bodies.block]
kind = "box"
size = [2, 2, 1]
medium = "low"
rotation = [-76, -31, 114]
position = [100000, -70000, 30000]
[bodies.core]
kind = "box"
size = [1, 1.2, 0.5]
medium = "high"
rotation = [-76, -31, 114]
position = [99999.79106743014, -70000.12712041636, 30000.051841884557]
[sources.lamp]
kind = "lambertian"
position = [99994.9856183233, -70003.05088999271, 30001.24420522939]
axis = [0.8357302794485266, 0.5084816654516923, -0.20736753823190537]
diameter = 3
cone_deg = 30
"""


def test_no_ray_is_caught_far_from_the_origin() -> None:
    result = record(compiled(FLUSH), rays=20_000, no_rays=True, threads=1)
    assert result.audit["lamp"]["left"] == 20_000
