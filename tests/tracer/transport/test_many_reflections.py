"""Errors of rounding do not grow along a ray, however often it is reflected."""

from __future__ import annotations

import numpy as np
import pytest

from raymap.model.events import Event
from tests.tracer.transport.tracing import trace

SHAPES = {
    "sphere": 'kind = "sphere"\nradius = 3',
    "cylinder": 'kind = "cylinder"\nposition = [0, 0, -20]\nradius = 2\nlength = 40',
    "cone": 'kind = "cone"\nposition = [0, 0, -2]\nradius = 3\nend_radius = 1\nlength = 4',
}


@pytest.mark.parametrize("shape", SHAPES)
def test_light_stays_in_a_perfect_mirror(shape: str) -> None:
    found = trace(
        f"""
[limits]
depth = 1500
[surfaces.mirror]
kind = "mirror"
reflectance = 1.0
[bodies.shape]
{SHAPES[shape]}
surface = "mirror"
[sources.lamp]
kind = "point"
position = [0.1, 0.2, 0.3]
""",
        100,
    )
    assert found.endings(Event.DEPTH_LIMIT) == 100
    met = found.portion.object >= 0
    length = np.linalg.norm(found.portion.normal[met] / 32767.0, axis=1)
    assert np.abs(length - 1.0).max() < 5e-5


def test_a_glass_ball_keeps_its_light_by_total_reflection() -> None:
    # Chords of a sphere all have one angle: light that is born beyond the critical one never leaves
    found = trace(
        """
[limits]
depth = 800
[media.glass]
index = 1.5
[bodies.ball]
kind = "sphere"
radius = 1
medium = "glass"
[sources.lamp]
kind = "collimated"
position = [0, 0.9, 0]
direction = [1, 0, 0]
diameter = 0.1
inside = "ball"
""",
        300,
    )
    assert found.endings(Event.DEPTH_LIMIT) == 300
    assert found.count(Event.TIR) > 300 * 790
