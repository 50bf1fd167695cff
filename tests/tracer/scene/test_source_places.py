"""Sources stand where the scene says: outside all solids, or inside the one they name."""

from __future__ import annotations

from pathlib import Path

import pytest

from raymap.errors import SceneError
from tracer.recording import StoppedLight, record
from tracer.scene.load import parse_scene
from tracer.scene.source_check import MisplacedLight

BALL = """
[media.glass]
index = 1.5
[bodies.ball]
kind = "sphere"
radius = 5
medium = "glass"
[sources.lamp]
kind = "{kind}"
position = [0, 0, {z}]
{rest}
"""


@pytest.mark.parametrize(
    ("z", "rest", "message"),
    [
        (1, "", r"sources\.lamp: starts inside the solid 'ball', for example at \(0, 0, 1\); move"),
        (
            -20,
            'cone_deg = 5\ninside = "ball"',
            r"is said to be inside 'ball' but starts outside 'ball', for example at \(0, 0, -20\)",
        ),
    ],
)
def test_a_source_in_the_wrong_place_is_refused(
    z: int, rest: str, message: str, tmp_path: Path
) -> None:
    scene = parse_scene('length_unit = "mm"\n' + BALL.format(kind="point", z=z, rest=rest))
    target = tmp_path / "a.raymap"
    with pytest.raises(SceneError, match=message):
        record(scene, target, rays=100, threads=1)
    assert not target.exists()


def test_a_source_partly_in_a_solid_is_warned_about(tmp_path: Path) -> None:
    rest = "axis = [0, 0, 1]\nsize = [30, 30]"
    text = 'length_unit = "mm"\n' + BALL.format(kind="lambertian", z=1, rest=rest)
    with (
        pytest.warns(MisplacedLight, match=r"of its light starts inside the solid 'ball'"),
        pytest.warns(StoppedLight),
    ):
        record(parse_scene(text), tmp_path / "a.raymap", rays=2_000, threads=1)


def test_a_source_where_it_belongs_is_not(tmp_path: Path) -> None:
    text = 'length_unit = "mm"\n' + BALL.format(kind="point", z=1, rest='inside = "ball"')
    record(parse_scene(text), tmp_path / "a.raymap", rays=100, threads=1)
