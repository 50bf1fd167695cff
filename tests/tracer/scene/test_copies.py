"""Rows and grids: the same scene as written out one by one."""

from __future__ import annotations

import pytest

from raymap.model.errors import SceneError
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene

HEAD = """
length_unit = "mm"
[media.glass]
index = 1.5
"""
BEAD = 'kind = "sphere"\nradius = 1\nmedium = "glass"\n'
LAMP = 'kind = "lambertian"\nsize = [1, 1]\nflux = 3\n'


def test_a_row_and_a_grid_are_what_they_would_be_written_out() -> None:
    short = parse_scene(
        f"""{HEAD}
[bodies.bead]
{BEAD}position = [1, 0, 10]
copies = {{ count = 3, step = [4, 0, 0] }}
[bodies.last]
{BEAD}position = [0, 50, 10]
[sources.led]
{LAMP}copies = {{ count = [2, 2], step = [[5, 0, 0], [0, 7, 1]] }}
[sources.beam]
kind = "collimated"
diameter = 1
direction = [0, 0, 1]
aim = [0, 0, 9]
distance = 30
copies = {{ count = 2, step = [0, 3, 0] }}
"""
    )
    text = HEAD
    for k in range(3):
        text += f"[bodies.bead_{k + 1}]\n{BEAD}position = [{1 + 4 * k}, 0, 10]\n"
    text += f"[bodies.last]\n{BEAD}position = [0, 50, 10]\n"
    for i in range(2):
        for j in range(2):
            place = f"position = [{5 * i}, {7 * j}, {j}]"
            text += f"[sources.led_{i + 1}_{j + 1}]\n{LAMP}{place}\n"
    for k in range(2):
        text += f'[sources.beam_{k + 1}]\nkind = "collimated"\ndiameter = 1\ndistance = 30\n'
        text += f"direction = [0, 0, 1]\naim = [0, {3 * k}, 9]\n"
    long = parse_scene(text)
    assert list(short.bodies) == list(long.bodies)
    assert list(short.sources) == list(long.sources)
    assert compile_scene(short).directory.scene_hash == compile_scene(long).directory.scene_hash


def test_copies_are_chosen_by_their_names() -> None:
    scene = parse_scene(
        f"""leave_out = ["bead_2"]
{HEAD}
[bodies.bead]
{BEAD}copies = {{ count = 3, step = [4, 0, 0] }}
"""
    )
    assert list(scene.bodies) == ["bead_1", "bead_3"]


@pytest.mark.parametrize(
    ("copies", "message"),
    [
        (
            "{ count = 0, step = [1, 0, 0] }",
            r"^scene: bodies\.bead\.copies\.count\S*: .*\(it is 0\)",
        ),
        ("{ count = [2, 2], step = [1, 0, 0] }", r"copies: 2 counts need as many steps, not 1"),
        ("{ count = 2, steps = [1, 0, 0] }", r"copies\.steps: unknown key; did you mean 'step'"),
        ("{ count = 2 }", r"copies\.step: is missing"),
        ("{ count = [200, 200], step = [[1, 0, 0], [0, 1, 0]] }", "40,000 copies are too many"),
        ("3", r"bodies\.bead\.copies: "),
    ],
)
def test_what_cannot_be_copied_is_refused(copies: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        parse_scene(f"{HEAD}[bodies.bead]\n{BEAD}copies = {copies}\n")


def test_a_name_that_is_there_already_and_a_place_that_is_none_are_refused() -> None:
    row = "copies = { count = 2, step = [1, 0, 0] }\n"
    text = f"{HEAD}[bodies.bead_2]\n{BEAD}[bodies.bead]\n{BEAD}{row}"
    with pytest.raises(SceneError, match=r"bodies\.bead\.copies: makes 'bead_2'"):
        parse_scene(text)
    with pytest.raises(SceneError, match=r"bodies\.bead\.position: must be three numbers"):
        parse_scene(f"{HEAD}[bodies.bead]\n{BEAD}position = [1, 2]\n{row}")
