"""The page about scene files: its scenes compile, its commands and its Python run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from raymap.cli import application
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene

PAGE = (Path(__file__).parents[2] / "docs" / "scenes.md").read_text(encoding="utf-8")
SCENES = [text for text in re.findall(r"```toml\n(.*?)```", PAGE, re.S) if "length_unit" in text]


@pytest.mark.parametrize("number", range(len(SCENES)))
def test_scenes_of_the_page_compile(number: int) -> None:
    compile_scene(parse_scene(SCENES[number]))


def test_python_of_the_page_runs() -> None:
    for text in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        names: dict[str, object] = {}
        exec(text, names)
        if "scene" in names:
            assert compile_scene(names["scene"]).directory.sources[0].flux > 0.0  # type: ignore[arg-type]


def test_commands_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (scene,) = [text for text in SCENES if "[detectors.eye]" in text]
    (tmp_path / "luminaire.toml").write_text(scene, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^\$ raymap ((?:record|image|chart) luminaire.*)$", PAGE, re.M)
    assert len(commands) == 5
    for command in commands:
        words = shlex.split(command.replace("1000000", "2000"))
        result = CliRunner().invoke(application(), words)
        assert result.exit_code == 0, (command, result.exception, result.stderr)
    assert (tmp_path / "eye.png").stat().st_size > 1_000
