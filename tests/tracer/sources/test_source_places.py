"""Sources stand where the scene says: outside all solids, or inside the one they name."""

from __future__ import annotations

from pathlib import Path

import pytest

import raymap
from query import select
from raymap.model.errors import SceneError
from tracer.run.recording import StoppedLight, record
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene
from tracer.transport.source_check import MisplacedLight

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


POCKET = """
length_unit = "mm"
[media.glass]
index = 1.5
[bodies.block]
kind = "box"
size = [20, 20, 20]
medium = "glass"
[bodies.pocket]
kind = "box"
size = [8, 8, 8]
medium = "air"
[bodies.bead]
kind = "sphere"
radius = 2
medium = "glass"
[sources.lamp]
kind = "point"
cone_deg = 2
"""


def test_light_of_a_source_in_a_pocket_goes_through_all_the_solids_around_it(
    tmp_path: Path,
) -> None:
    scene = parse_scene(POCKET + 'inside = ["block", "pocket", "bead"]')
    result = record(scene, tmp_path / "a.raymap", rays=4_000, threads=1)
    assert result.audit["lamp"]["errors"] == 0
    # Three faces near the normal, R = 0.04 each
    with raymap.open(tmp_path / "a.raymap") as found:
        straight = select(found, "count(event(reflected)) == 0").matched
    share = 0.96**3
    assert straight == pytest.approx(4_000 * share, abs=4 * (4_000 * share * (1 - share)) ** 0.5)


def test_a_solid_around_the_pocket_that_is_not_named_is_warned_about(tmp_path: Path) -> None:
    scene = parse_scene(POCKET + 'inside = ["pocket", "bead"]')
    said = r"""leaves the solid 'block' .* say inside = \["block", "pocket", "bead"\]"""
    with pytest.warns(MisplacedLight, match=said), pytest.warns(StoppedLight):
        record(scene, tmp_path / "a.raymap", rays=100, threads=1)


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ('["pocket", "pocket"]', "names 'pocket' twice"),
        ('["block", "pockett"]', "there is no solid 'pockett'; did you mean 'pocket'"),
    ],
)
def test_names_of_solids_around_a_source_are_checked(inside: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        compile_scene(parse_scene(POCKET + f"inside = {inside}"))


def test_of_solids_around_a_source_the_one_of_higher_priority_counts() -> None:
    """Whatever the order in which they are named."""
    text = POCKET.replace('medium = "air"', 'medium = "air"\npriority = 1')
    one = compile_scene(parse_scene(text + 'inside = ["block", "pocket"]')).arrays.source_i
    other = compile_scene(parse_scene(text + 'inside = ["pocket", "block"]')).arrays.source_i
    assert one.tolist() == other.tolist()


ON_A_BOARD = """
length_unit = "mm"
[surfaces.black]
kind = "absorber"
[bodies.board]
{board}
axis = [-0.3, 0.4, -0.8]
position = [3.3, -1.7, 0.9]
surface = "black"
[sources.lamp]
{lamp}
axis = [0.3, -0.4, 0.8]
position = [3.3, -1.7, 0.9]
"""


@pytest.mark.parametrize(
    "board", ['kind = "disc"\nouter = 8', 'kind = "cylinder"\nradius = 8\nlength = 2']
)
@pytest.mark.parametrize(
    "lamp",
    [
        'kind = "lambertian"\ndiameter = 2',
        'kind = "collimated"\nsize = [2, 1]',
        'kind = "point"\ncone_deg = 90',
        'kind = "intensity"\ndiameter = 1\nintensity = { gamma_deg = [0, 90], value = [1, 1] }',
    ],
)
def test_a_chip_on_its_board_shines_away_from_it(lamp: str, board: str) -> None:
    # Rounding put half of the places behind the board, as it is turned
    scene = parse_scene(ON_A_BOARD.format(board=board, lamp=lamp))
    result = record(scene, rays=2_000, no_rays=True, threads=1)
    assert result.audit["lamp"]["left"] == 2_000, result.audit


def test_solids_may_lie_in_one_another_six_deep() -> None:
    text = 'length_unit = "mm"\n'
    for k in range(6):
        text += f"""
[media.m{k}]
index = {1.1 + 0.1 * k}
[bodies.b{k}]
kind = "sphere"
radius = {6 - k}
medium = "m{k}"
"""
    text += '[sources.lamp]\nkind = "collimated"\nposition = [0, 0, -9]\ndiameter = 9\n'
    result = record(parse_scene(text), rays=2_000, no_rays=True, threads=1)
    assert result.audit["lamp"]["left"] == 2_000, result.audit
