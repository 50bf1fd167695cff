"""Solids that touch, lie in one another flush or on open surfaces: one interface, nothing lost."""

from __future__ import annotations

import numpy as np
import pytest

from raymap.model.events import Event
from tests.tracer.transport.tracing import Trace, assert_share, compiled, trace

MEDIA = """
[media.low]
index = 1.3
[media.high]
index = 1.6
"""

STACK = """
[bodies.lower]
kind = "box"
size = [4, 4, 1]
position = [0, 0, -0.5]
medium = "low"
[bodies.upper]
kind = "box"
size = [{upper}, 1]
position = [{place}, 0.5]
{turn}
medium = "high"
"""

SUN = """
[sources.sun]
kind = "collimated"
position = [0, 0, 5]
direction = [0, 0, -1]
diameter = 1
"""

SKY = """
[sources.sky]
kind = "lambertian"
position = [0.1, 0.2, 6]
axis = [0, 0, -1]
diameter = 8
"""


def media_of(found: Trace) -> list[str]:
    return [item.name for item in found.compilation.directory.media]


def test_two_blocks_have_one_interface_between_them() -> None:
    text = MEDIA + STACK.format(upper="4, 4", place="0, 0", turn="") + SUN
    found = trace(text, 200_000)
    assert found.count(Event.GEOMETRY_ERROR) == 0
    # Straight through: air, high, low, air; never a film of air between the blocks
    straight = found.portion.records_per_ray == 5
    p = found.portion
    starts = found.offsets[:-1][straight]
    names = media_of(found)
    through = [tuple(names[p.medium[s + k]] for k in range(4)) for s in starts[:2000]]
    crossed = [way for way in through if way[1] == "high" and way[2] == "low"]
    assert len(crossed) > 1500
    r1, r2, r3 = ((a - b) ** 2 / (a + b) ** 2 for a, b in ((1, 1.6), (1.6, 1.3), (1.3, 1)))
    direct = (1 - r1) * (1 - r2) * (1 - r3)
    down = p.normal[found.last][:, 2] < 0
    assert_share(int(np.count_nonzero(straight & down)), 200_000, direct)
    # The interface is one face, that of the body named first, from both sides
    at = np.abs(p.position[:, 2]) < 1e-6
    met = {
        found.compilation.directory.objects[k].name
        for k in np.unique(p.object[at & (p.event & int(Event.EMITTED) == 0)])
    }
    assert met == {"lower"}


ARRANGEMENTS = {
    "flush": STACK.format(upper="4, 4", place="0, 0", turn=""),
    "smaller on larger": STACK.format(upper="1.7, 2.3", place="0.3, -0.2", turn=""),
    "turned": STACK.format(upper="2, 2", place="0.3, -0.2", turn="rotation = [0, 0, 33]"),
    "over the edge": STACK.format(upper="3, 3", place="1.5, 1.1", turn=""),
    "side by side on a block": STACK.format(upper="2, 4", place="-1, 0", turn="")
    + '[bodies.third]\nkind = "box"\nsize = [2, 4, 1]\nposition = [1, 0, 0.5]\nmedium = "low"\n',
    "cylinder and prism": """
[bodies.rod]
kind = "cylinder"
radius = 1.5
length = 1
medium = "high"
[bodies.roof]
kind = "prism"
outline = [[-2, -1], [2, -1], [0, 2]]
length = 1
position = [0, 0, -0.5]
medium = "low"
""",
    "flush inside": """
[bodies.shell]
kind = "box"
size = [4, 4, 2]
medium = "low"
[bodies.core]
kind = "box"
size = [2, 2, 1]
position = [0, 0, 0.5]
medium = "high"
""",
}


# The same faces in planes of no axis: every place and angle is rounded. What needs prisms
# compiles for a minute
CASES = [
    pytest.param(name, tilt, marks=[pytest.mark.slow] if "prism" in name else [])
    for name in ARRANGEMENTS
    for tilt in ("", "tilted")
    if not tilt or name not in ("turned", "cylinder and prism")
]


@pytest.mark.parametrize(("name", "tilt"), CASES)
def test_no_ray_is_lost_where_solids_touch(name: str, tilt: str) -> None:
    text = ARRANGEMENTS[name]
    if tilt:
        text = tilted(text)
    found = trace(MEDIA + "[limits]\ndepth = 400\n" + text + SKY, 60_000)
    assert found.count(Event.GEOMETRY_ERROR) == 0
    stopped = found.endings(Event.DEPTH_LIMIT)
    assert found.endings(Event.LEFT_SCENE) + stopped == 60_000
    # All light that left is outside, in air
    left = found.last[found.portion.event[found.last] & int(Event.LEFT_SCENE) != 0]
    air = media_of(found).index("air")
    assert np.all(found.portion.medium[left - 1] == air)


def tilted(text: str) -> str:
    """The boxes turned by 30 degrees about x and moved along."""
    import re

    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))

    def moved(match: re.Match[str]) -> str:
        x, y, z = (float(v) for v in match[1].split(","))
        y, z = float(c * y - s * z), float(s * y + c * z)
        return f"position = [{x!r}, {y!r}, {z!r}]\nrotation = [30, 0, 0]"

    text = re.sub(
        r'(kind = "box"\nsize = \[[^\]]*\]\n)(?!position)', r"\1position = [0, 0, 0]\n", text
    )
    return re.sub(r"position = \[([^\]]*)\]", moved, text)


def test_a_block_on_a_painted_floor_does_not_leak() -> None:
    found = trace(
        MEDIA
        + """
[surfaces.paint]
kind = "lambertian"
reflectance = 0.8
[bodies.floor]
kind = "rectangle"
size = [20, 20]
surface = "paint"
[bodies.block]
kind = "box"
size = [3, 3, 1]
position = [0, 0, 0.5]
medium = "high"
"""
        + SKY,
        100_000,
    )
    assert found.count(Event.GEOMETRY_ERROR) == 0
    last = found.portion.position[found.last]
    gone = found.portion.event[found.last] & int(Event.LEFT_SCENE) != 0
    below = gone & (last[:, 2] < -0.01) & (np.hypot(last[:, 0], last[:, 1]) < 9.0)
    assert not np.any(below)
    # Under the block the paint is met in the glass, without a film of air
    p = found.portion
    floor = np.flatnonzero(p.object == found.object("floor"))
    covered = np.all(np.abs(p.position[floor, :2]) < 1.49, axis=1)
    names = media_of(found)
    before = {names[k] for k in p.medium[floor[covered] - 1]}
    assert before == {"high"}


def test_an_absorbing_detector_on_glass_counts_each_ray_once() -> None:
    found = trace(
        MEDIA
        + """
[bodies.window]
kind = "box"
size = [6, 6, 1]
medium = "low"
[detectors.chip]
position = [0, 0, -0.5]
looks = [0, 0, 1]
size = [6, 6]
cells = [1, 1]
blocking = true
"""
        + SUN,
        50_000,
    )
    assert found.endings(Event.GEOMETRY_ERROR) == 0
    r = (0.3 / 2.3) ** 2
    assert_share(found.ended_on("chip"), 50_000, 1.0 - r)
    assert len(found.portion.descriptors.detector) == found.ended_on("chip")


def test_the_higher_priority_gives_the_surface() -> None:
    text = """
[surfaces.silver]
kind = "mirror"
reflectance = 1.0
""" + MEDIA + STACK.format(upper="4, 4", place="0, 0", turn="")  # fmt: skip
    for first, expected in (("priority = 1\n", True), ("", False)):
        changed = text.replace('medium = "high"\n', f'medium = "high"\nsurface = "silver"\n{first}')
        changed = changed.replace('surface = "silver"', 'faces = { z_min = "silver" }')
        found = trace(changed + SUN, 2_000)
        silver = found.count(Event.SPECULAR_REFLECTION) > 1_800
        assert silver == expected


def test_faces_in_a_wrong_order_are_reported_with_their_place() -> None:
    # A source that starts in a solid that it does not name
    scene = compiled(
        MEDIA
        + """
[bodies.ball]
kind = "sphere"
radius = 1
medium = "high"
[sources.ray]
kind = "collimated"
position = [0, 0, 2]
direction = [0, 0, -1]
diameter = 0.5
inside = "ball"
"""
    )
    found = trace(scene, 1_000)
    wrong = found.portion.event[found.last] & int(Event.GEOMETRY_ERROR) != 0
    assert wrong.all()
    at = found.portion.position[found.last[wrong]]
    assert np.allclose(np.linalg.norm(at, axis=1), 1.0, atol=1e-5)
    assert np.all(found.portion.object[found.last] == found.object("ball"))
