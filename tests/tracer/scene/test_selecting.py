"""What takes part in a simulation, by name."""

from __future__ import annotations

import pytest

from raymap.model.errors import SceneError
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene

TEXT = """
length_unit = "mm"
{top}
[surfaces.black]
kind = "absorber"
[bodies.L1]
kind = "disc"
outer = 3
surface = "black"
[bodies.L2]
kind = "disc"
position = [0, 0, 2]
outer = 3
surface = "black"
[bodies.hood]
kind = "disc"
position = [0, 0, 4]
outer = 3
surface = "black"
[sources.beam]
kind = "collimated"
diameter = 5
[sources.lamp]
kind = "collimated"
position = [0, 0, -3]
diameter = 2
[detectors.screen]
position = [0, 0, 50]
looks = [0, 0, -1]
size = [20, 20]
cells = [100, 100]
[variants.wide.sources.lamp]
diameter = 4
[simulations.lenses]
use = ["L?"]
[simulations.night]
use = ["lamp"]
leave_out = ["h*d"]
variants = ["wide"]
[simulations.dark]
leave_out = ["screen"]
"""


def names(simulation: str | None, top: str = "") -> tuple[list[str], list[str], list[str]]:
    scene = parse_scene(TEXT.format(top=top), simulation=simulation)
    return list(scene.bodies), list(scene.sources), list(scene.detectors)


def test_without_a_simulation_all_take_part() -> None:
    assert names(None) == (["L1", "L2", "hood"], ["beam", "lamp"], ["screen"])


def test_kinds_that_no_pattern_speaks_of_stay_whole() -> None:
    assert names("lenses") == (["L1", "L2"], ["beam", "lamp"], ["screen"])
    assert names("night") == (["L1", "L2"], ["lamp"], ["screen"])
    assert names("dark") == (["L1", "L2", "hood"], ["beam", "lamp"], [])


def test_a_simulation_lays_its_variants_over_the_scene() -> None:
    assert parse_scene(TEXT.format(top=""), simulation="night").sources["lamp"].diameter == 4.0


def test_what_the_scene_leaves_out_stays_out() -> None:
    assert names("dark", 'leave_out = ["L*"]') == (["hood"], ["beam", "lamp"], [])
    # The simulation's use goes before that of the scene
    assert names("lenses", 'use = ["hood"]')[0] == ["L1", "L2"]
    assert names(None, 'use = ["hood"]')[0] == ["hood"]


def test_the_directory_remembers() -> None:
    directory = compile_scene(parse_scene(TEXT.format(top=""), simulation="night")).directory
    assert [item.name for item in directory.objects] == ["L1", "L2"]
    assert directory.parameters["simulation"] == {
        "simulation": "night",
        "use": ["lamp"],
        "leave_out": ["h*d"],
        "left_out": {"bodies": ["hood"], "sources": ["beam"]},
    }
    other = compile_scene(parse_scene(TEXT.format(top=""), simulation="lenses")).directory
    assert other.scene_hash != directory.scene_hash


@pytest.mark.parametrize(
    ("simulation", "top", "words"),
    [
        ("nigth", "", "no simulation 'nigth'; did you mean 'night'"),
        (None, 'use = ["L9"]', "scene: use: no body, source or detector is called 'L9'"),
        (None, 'leave_out = ["hod"]', "did you mean 'hood'"),
        (None, 'leave_out = "hood"', "leave_out: "),
        (None, "[simulations.x]\nuses = []", "simulations.x.uses: unknown key; did you mean 'use'"),
        ("x", '[simulations.x]\nleave_out = ["b"]', "simulations.x.leave_out: no body, source"),
    ],
)
def test_slips_are_named(simulation: str | None, top: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        names(simulation, top)
