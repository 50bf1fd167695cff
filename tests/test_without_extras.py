"""Without extras every command works, or says in one line which extra it needs.

The modules that extras bring are hidden from a process, in which every command of the command line
then runs. The slow test does the same in a new environment, where nothing but the package and what
it depends on is installed.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from raymap.cli import application
from raymap.model.extras import EXTRAS
from tests.raymap.maps import write_small

ROOT = Path(__file__).parents[1]
COMMANDS = [
    str(command.name) for command in application().registered_commands if not command.hidden
]

SCENE = """
length_unit = "mm"
[sources.lamp]
kind = "point"
[bodies.ball]
kind = "sphere"
radius = 1
position = [0, 0, 5]
surface = "absorber"
[detectors.sensor]
position = [0, 0, 1]
size = [2, 2]
cells = [4, 4]
looks = [0, 0, -1]
"""

WORDS: dict[str, list[str]] = {
    "record": ["scene.toml", "-o", "new.raymap", "--rays", "10"],
    "check": ["scene.toml", "-o", "section.svg"],
    "faces": ["part.step"],
    "query": ["a.raymap", "event(left)", "--count"],
    "paths": ["a.raymap"],
    "report": ["a.raymap", "0"],
    "audit": ["a.raymap"],
    "ghosts": ["a.raymap"],
    "illuminated": ["a.raymap", "sensor"],
    "sweep": ["a.raymap", "sensor"],
    "compare": ["a.raymap", "a.raymap"],
    "histogram": ["a.raymap", "length"],
    "what-if": ["a.raymap", "--set", "lamp.flux=2"],
    "sensitivity": ["a.raymap"],
    "improve": ["a.raymap", "event(reflected)", "--reflectance", "0.2%"],
    "image": ["a.raymap", "sensor", "-o", "a.tiff"],
    "focus": ["a.raymap", "sensor"],
    "picture": ["a.raymap", "-o", "a.png"],
    "chart": ["a.raymap", "sensor", "-o", "chart.png"],
    "view": ["a.raymap", "--no-browser"],
    "rayfile": ["a.raymap", "sensor", "-o", "b.sdf"],
    "import": ["a.zrd", "-o", "zrd.raymap"],
    "info": ["a.raymap"],
    "verify": ["a.raymap"],
    "repair": ["a.raymap", "-o", "repaired.raymap"],
    "mix": ["a.raymap:0.3", "-o", "m.raymix"],
    "export": ["a.raymap", "-o", "rays.parquet"],
    "check-rays": ["a.sdf"],
    "kinds": [],
    "doctor": [],
    # A server that starts does not end; without a folder it says so before
    "serve": ["no_folder"],
    "export-3d": ["a.raymap", "-o", "a.step"],
    "lens-levels": ["-o", "levels.png"],
    "lens-cone": ["-o", "cone.png"],
    "lens-vignetting": ["-o", "vignetting.png"],
    "lens-picture": ["-o", "picture.jpg"],
    "microscope": ["-o", "calcite.jpg"],
    "verify-crystals": ["-o", "pictures", "--only", "pictures"],
    "render": ["scene.toml", "-o", "render.png"],
    "fit-scattering": ["data.json"],
    "goniophotometer": ["material", "--thickness", "1", "-o", "plate", "--rays", "100"],
}

LONG = ("render", "verify-crystals")
"""Commands that compile for long: left to the slow tests."""

DRAWN = {
    "chart": ("matplotlib", "query.answers.images.images.detector_image"),
    "fit-scattering": ("matplotlib", "tracer.scattering.fits.fit_material.fit_material"),
    "goniophotometer": ("matplotlib", "tracer.scattering.plates.goniophotometer.measure_plate"),
    "image": ("tifffile", "query.answers.images.images.detector_images"),
    "lens-cone": ("matplotlib", "tracer.studies.lenses.cone.masked_cone"),
    "lens-levels": ("matplotlib", "tracer.studies.lenses.levels.level_shares"),
    "lens-picture": ("PIL", "tracer.studies.lenses.lens_pictures.lens_picture"),
    "lens-vignetting": ("matplotlib", "tracer.studies.lenses.vignetting.vignetting"),
    "microscope": ("PIL", "tracer.studies.microscopy.microscope.conoscopy"),
    "picture": ("PIL", "viewer.drawn.answers.draw_rays"),
}
"""Commands that draw: the module that does, and what they compute before."""

DRIVER = """
import contextlib, io, json, sys, traceback
hidden, table = json.loads(sys.argv[1])
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Hidden())
from raymap.cli import main
for command, words in table.items():
    sys.argv = ["raymap", command, *words]
    out, error, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            code = traceback.format_exc()
    print(json.dumps([command, code, error.getvalue()]), flush=True)
"""


def run_all(
    python: str | Path, folder: Path, hidden: list[str], path: str, commands: dict[str, list[str]]
) -> dict[str, Any]:
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    for name in ("part.step", "a.zrd", "a.sdf", "data.json"):
        (folder / name).write_text("nothing of the kind\n", encoding="utf-8")
    write_small(folder / "a.raymap", n_portions=1, n_rays=20)
    done = subprocess.run(
        [python, "-c", DRIVER, json.dumps([hidden, commands])],
        cwd=folder, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True,
        check=True, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    return {command: (code, error) for command, code, error in answers}


def assert_clear(answers: dict[str, Any]) -> None:
    for command, (code, error) in answers.items():
        assert code in (0, 1), f"{command}: {code} {error}"
        told = [line for line in error.splitlines() if line.startswith("error: ")]
        assert len(told) == (code == 1), f"{command}: {error}"
        assert "Traceback" not in error
    needed = {
        command: re.findall(r"pip install '?raymap\[(\w+)", error)
        for command, (_, error) in answers.items()
    }
    for command in ("view", *(set(DRAWN) - {"fit-scattering"})):
        assert needed[command] == ["view"], answers[command]
    assert needed["export-3d"] == ["cad"], answers["export-3d"]
    for command in ("record", "query", "paths", "info", "verify", "export", "rayfile"):
        assert answers[command][0] == 0, answers[command]


def test_the_table_has_every_command() -> None:
    assert set(WORDS) == set(COMMANDS)


@pytest.mark.parametrize("command", DRAWN)
def test_what_draws_is_looked_for_before_anything_is_computed(
    command: str, tmp_path: Path, run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, computed = DRAWN[command]

    def compute(*_: Any, **__: Any) -> None:
        raise AssertionError(f"{command} computes before it looks for {module}")

    monkeypatch.chdir(tmp_path)
    write_small(tmp_path / "a.raymap", n_portions=1, n_rays=20)
    monkeypatch.setattr(computed, compute)
    monkeypatch.setitem(sys.modules, module, None)
    more = ["-o", "plates"] if command == "fit-scattering" else []
    code, _, error = run(command, *WORDS[command], *more)
    assert code == 1
    assert error.startswith("error: this needs the package of the module")
    assert error.endswith(f"{module}, which is not installed: pip install 'raymap[view]'\n")


@pytest.mark.parametrize(
    "commands",
    [
        pytest.param({k: v for k, v in WORDS.items() if k not in LONG}, id="quick"),
        pytest.param(WORDS, id="all", marks=pytest.mark.slow),
    ],
)
def test_commands_where_the_modules_of_extras_are_hidden(
    tmp_path: Path, commands: dict[str, list[str]]
) -> None:
    hidden = [module for modules in EXTRAS.values() for module in modules]
    answers = run_all(sys.executable, tmp_path, hidden, str(ROOT), commands)
    assert list(answers) == list(commands)
    assert_clear(answers)


@pytest.mark.slow
def test_commands_in_an_environment_without_extras(tmp_path: Path) -> None:
    place = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    python = place / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", str(ROOT)]
    subprocess.run(install, check=True, cwd=tmp_path)
    folder = tmp_path / "work"
    folder.mkdir()
    answers = run_all(python, folder, [], "", WORDS)
    assert list(answers) == list(WORDS)
    assert_clear(answers)
