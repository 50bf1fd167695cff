"""Solids that touch along spheres, cylinders, cones, lenses: one interface, no film of air."""

from __future__ import annotations

import numpy as np
import pytest

from raymap.model.events import Event
from tests.tracer.transport.tracing import assert_share, trace

MEDIA = """
[media.low]
index = 1.3
[media.high]
index = 1.6
"""

# A plano-concave lens whose back is the front of a ball lens, not said to be cemented
SOCKET = """
[bodies.socket]
kind = "lens"
medium = "low"
position = [0, 0, 0]
thickness = 1
front = { radius = inf, semi_diameter = 1.5 }
back = { radius = 4, semi_diameter = 1.5 }
[bodies.ball]
kind = "sphere"
radius = 4
position = [0, 0, 5]
medium = "high"
"""

BEAM = """
[sources.sun]
kind = "collimated"
position = [0, 0, -3]
direction = [0, 0, 1]
diameter = 0.01
"""

SKY = """
[sources.sky]
kind = "lambertian"
position = [0.1, 0.2, -6]
diameter = 12
"""


def _reflectance(a: float, b: float) -> float:
    return ((a - b) / (a + b)) ** 2


@pytest.mark.parametrize("turn", ["", "axis = [0, 0, -1]\n"])
def test_a_ball_in_a_socket_has_one_interface(turn: str) -> None:
    ball = SOCKET.replace('medium = "high"', f'{turn}medium = "high"')
    found = trace(MEDIA + ball + BEAM, 100_000)
    assert found.count(Event.GEOMETRY_ERROR) == 0
    p = found.portion
    straight = p.records_per_ray == 5
    down = p.normal[found.last][:, 2] > 0
    through = np.prod([1 - _reflectance(a, b) for a, b in ((1, 1.3), (1.3, 1.6), (1.6, 1))])
    assert_share(int(np.count_nonzero(straight & down)), 100_000, float(through))
    names = [item.name for item in found.compilation.directory.media]
    starts = found.offsets[:-1][straight & down]
    ways = {tuple(names[p.medium[s + k]] for k in range(5)) for s in starts[:2_000]}
    assert ways == {("air", "low", "high", "air", "air")}


# A plate with a bore that holds a rod of the same glass is the plate without a bore
BORED = """
[bodies.plate]
kind = "lens"
medium = "high"
position = [0, 0, 0]
thickness = 2
rim = "bare"
hole = 3
front = { radius = inf, semi_diameter = 30 }
back = { radius = inf, semi_diameter = 30 }
[bodies.rod]
kind = "cylinder"
radius = 1.5
length = 2
medium = "high"
[sources.sun]
kind = "collimated"
aim = [0, 0, 1]
distance = 6
direction = [0.57735026919, 0, 1]
diameter = 3.2
"""


def _plate_transmittance(index: float, angle_deg: float) -> float:
    """All inner reflections of a plate, each of natural light: (1 - R) / (1 + R)."""
    ci = np.cos(np.radians(angle_deg))
    ct = np.sqrt(1.0 - (np.sin(np.radians(angle_deg)) / index) ** 2)
    rs = (ci - index * ct) / (ci + index * ct)
    rp = (index * ci - ct) / (index * ci + ct)
    r = 0.5 * (rs**2 + rp**2)
    return float((1.0 - r) / (1.0 + r))


def test_a_rod_in_a_bore_of_its_glass_is_not_there() -> None:
    found = trace(MEDIA + BORED, 60_000)
    assert found.count(Event.GEOMETRY_ERROR) == 0
    # A film of air would reflect totally what crosses the side of the rod
    assert found.count(Event.TIR) == 0
    p = found.portion
    left = p.event[found.last] & int(Event.LEFT_SCENE) != 0
    forward = left & (p.normal[found.last][:, 2] > 0)
    assert_share(int(forward.sum()), 60_000, _plate_transmittance(1.6, 30.0))
    crossing = p.object == found.object("plate")
    crossing &= np.abs(np.hypot(p.position[:, 0], p.position[:, 1]) - 1.5) < 1e-5
    assert crossing.sum() > 10_000


def test_a_black_tube_on_a_rod_takes_what_meets_its_side() -> None:
    # Nothing is reflected at the side, so the far end gets the view factor of two equal discs
    text = """
[bodies.rod]
kind = "cylinder"
radius = 2
length = 2
medium = "high"
[bodies.tube]
kind = "cylinder"
radius = 2
length = 2
open = true
surface = "absorber"
[bodies.far]
kind = "disc"
outer = 2
position = [0, 0, 2]
surface = "absorber"
[sources.near]
kind = "lambertian"
diameter = 4
position = [0, 0, 1e-6]
inside = "rod"
"""
    found = trace(MEDIA + text, 100_000)
    assert found.count(Event.GEOMETRY_ERROR) == 0
    assert found.count(Event.TIR) == 0
    assert_share(found.ended_on("far"), 100_000, (3.0 - np.sqrt(5.0)) / 2.0)
    assert found.ended_on("tube") + found.ended_on("far") == 100_000


ARRANGEMENTS = {
    "ball in a socket": SOCKET,
    "rod in a bore": BORED.partition("[sources")[0].replace('"high"', '"low"', 1),
    "ball in a shell": """
[bodies.ball]
kind = "sphere"
radius = 1
medium = "high"
[bodies.skin]
kind = "sphere"
radius = 1
axis = [1, 0, 0]
medium = "low"
priority = -1
""",
    "lenses that touch": """
[bodies.one]
kind = "lens"
medium = "low"
thickness = 2
front = { radius = inf, semi_diameter = 3 }
back = { radius = 9, conic = -0.7, semi_diameter = 3, aspheric = [1e-4] }
[bodies.two]
kind = "lens"
medium = "high"
thickness = 2
position = [0, 0, 2]
front = { radius = 9, conic = -0.7, semi_diameter = 2.5, aspheric = [1e-4] }
back = { radius = inf, semi_diameter = 2.5 }
""",
    "lenses of one conic": """
[bodies.one]
kind = "lens"
medium = "low"
thickness = 2
front = { radius = inf, semi_diameter = 3 }
back = { radius = 9, conic = -0.7, semi_diameter = 3 }
[bodies.two]
kind = "lens"
medium = "high"
thickness = 2
position = [0, 0, 4]
axis = [0, 0, -1]
front = { radius = inf, semi_diameter = 2.5 }
back = { radius = -9, conic = -0.7, semi_diameter = 2.5 }
""",
    "plug in a funnel": """
[bodies.plug]
kind = "cone"
radius = 1
end_radius = 2
length = 2
medium = "high"
[bodies.funnel]
kind = "cone"
position = [0, 0, 3]
axis = [0, 0, -1]
radius = 2.5
end_radius = 1
length = 3
medium = "low"
priority = -1
""",
}


@pytest.mark.parametrize("name", ARRANGEMENTS)
@pytest.mark.parametrize("tilt", ["", "tilted"])
def test_no_ray_is_lost_where_curved_solids_touch(name: str, tilt: str) -> None:
    text = MEDIA + "[limits]\ndepth = 400\n" + ARRANGEMENTS[name]
    sky = SKY
    if tilt:
        text, sky = _tilted(text), SKY.replace("diameter = 12", "diameter = 20")
    if "lenses" in name:
        text = text.replace("thickness = 2\n", 'thickness = 2\nrim = "bare"\n')
    found = trace(text + sky, 60_000)
    coincident = found.compilation.arrays.coincident
    assert coincident is not None
    assert len(coincident.face) > 0
    # Rays that graze a surface at less than the rounding of its place may be lost: counted
    assert found.count(Event.GEOMETRY_ERROR) <= 2
    p = found.portion
    left = found.last[p.event[found.last] & int(Event.LEFT_SCENE) != 0]
    air = [item.name for item in found.compilation.directory.media].index("air")
    assert np.all(p.medium[left - 1] == air)


def _tilted(text: str) -> str:
    """The bodies turned by 30 degrees about x and moved along."""
    import re

    c, s = float(np.cos(np.radians(30.0))), float(np.sin(np.radians(30.0)))
    bodies = text.split("[bodies.")
    for k, body in enumerate(bodies[1:], 1):
        z = 0.0
        if found := re.search(r"position = \[0, 0, (\S+)\]\n", body):
            z = float(found[1])
            body = body.replace(found[0], "")
        if "axis = [0, 0, -1]\n" in body:
            turn = f"axis = [0, {s!r}, {-c!r}]"
            body = body.replace("axis = [0, 0, -1]\n", "")
        elif "axis = [1, 0, 0]\n" in body:
            turn = "axis = [1, 0, 0]"
            body = body.replace("axis = [1, 0, 0]\n", "")
        else:
            turn = f"axis = [0, {-s!r}, {c!r}]"
        bodies[k] = body + f"position = [0, {-s * z!r}, {c * z!r}]\n{turn}\n"
    return "[bodies.".join(bodies)
