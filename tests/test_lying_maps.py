"""Whatever lies a map says, every command ends in its own words: the fuzz in its short form."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from tests.fuzz.fuzz_commands import LINES, look, one_case, run, seeds
from tests.fuzz.fuzz_values import Seed, put_together

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

NOT_ASKED = {"view": "serves until it is stopped; tests/fuzz/fuzz_page.py asks it"}


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> list[Seed]:
    return list(seeds(tmp_path_factory.mktemp("seeds")))


def test_every_command_that_takes_a_map_is_asked() -> None:
    import typer

    from raymap.cli import application

    group: Any = typer.main.get_command(application())
    takes = {
        name
        for name, command in group.commands.items()
        if any(each.name in ("map", "maps", "ray_map") for each in command.params)
    }
    assert "info" in takes
    assert takes - NOT_ASKED.keys() == {line.split()[0] for line in LINES}


@pytest.mark.parametrize("line", LINES)
def test_sound_and_lying_maps(line: str, sound: list[Seed], tmp_path: Path) -> None:
    """A sound map is answered, or refused in a line; changed ones are no other matter."""
    path = tmp_path / "map.raymap"
    dice = random.Random(line)
    for seed in dice.sample(sound, 2):
        path.write_bytes(put_together(seed.parts))
        look(line, path, dice)
    for _ in range(2):
        one_case(dice.choice(sound), dice, path, line)


def test_a_foreign_exception_is_seen(
    sound: list[Seed], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the test looks for, it finds."""

    def fails(*_: object, **__: object) -> None:
        raise IndexError("beyond")

    path = tmp_path / "map.raymap"
    path.write_bytes(put_together(sound[0].parts))
    assert run(["info", str(path)])[0] == 0
    monkeypatch.setattr("raymap.file.opening.open", fails)
    monkeypatch.setattr("raymap.open", fails)
    monkeypatch.setattr("raymap.cli.maps.open_map", fails, raising=False)
    with pytest.raises(AssertionError, match="IndexError"):
        look("info MAP", path, random.Random(1))
