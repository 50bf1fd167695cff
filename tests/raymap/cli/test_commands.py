"""The commands of the file: JSON and nothing else, one clear line on stderr, exit codes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import raymap
from raymap.cli import application, register
from raymap.cli.options import Panel
from tests.raymap.maps import write_small

_ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("commands") / "a.raymap"
    write_small(path, n_portions=3, n_rays=40)
    return path


@pytest.fixture
def damaged(path, tmp_path):
    data = bytearray(path.read_bytes())
    with raymap.open(path) as ray_map:
        stored = ray_map.portions[1]
        data[stored.offset + stored.stored_bytes - 1] ^= 1
    other = tmp_path / "damaged.raymap"
    other.write_bytes(data)
    return other


def _run(*arguments):
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_info(path):
    result = _run("info", path, "--json")
    assert result.exit_code == 0
    said = json.loads(result.stdout)
    assert said["rays"] == 120
    assert said["portions"] == 3
    assert said["finished"] is True
    assert said["bytes"] == path.stat().st_size
    assert said["bytes_per_record"] == pytest.approx(said["bytes"] / said["records"])
    assert said["sources"] == ["lamp", "sun"]
    assert said["faces"] == ["lens.front", "lens.mesh"]
    assert said["detectors"] == ["sensor", "sky"]
    assert {"objects", "channels", "units"} <= set(said)
    assert "120 rays" in _run("info", path).stdout


def test_info_says_what_every_stream_costs(path):
    said = json.loads(_run("info", path, "--streams", "--json").stdout)
    assert sum(row["bytes"] for row in said["streams"]) == said["bytes"]
    assert {"position.x", "path_number"} <= {row["stream"] for row in said["streams"]}
    assert "position.x" in _run("info", path, "--streams").stdout


def test_verify(path, damaged):
    result = _run("verify", path, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {
        "portions": 3,
        "good": 3,
        "damaged": [],
        "rays_readable": 120,
        "finished": True,
        "torn_bytes": 0,
    }
    result = _run("verify", damaged, "--json")
    assert result.exit_code == 1
    said = json.loads(result.stdout)
    assert (said["good"], said["rays_readable"]) == (2, 80)
    assert said["damaged"][0]["portion"] == 1
    assert "portion 1" in _run("verify", damaged).stdout


def test_an_unfinished_map_is_no_damage(path, tmp_path):
    cut = tmp_path / "cut.raymap"
    cut.write_bytes(path.read_bytes()[:-100])
    result = _run("verify", cut, "--json")
    assert result.exit_code == 0
    said = json.loads(result.stdout)
    assert (said["good"], said["finished"]) == (3, False)
    assert said["torn_bytes"] > 0


def test_repair(damaged, tmp_path):
    target = tmp_path / "fixed.raymap"
    result = _run("repair", damaged, "-o", target)
    assert result.exit_code == 0
    assert "2 sound portions" in result.stdout
    assert "warning" in result.stderr
    assert _run("verify", target).exit_code == 0


def test_export(path, tmp_path):
    for name in ("a.parquet", "a.arrow", "a.csv", "folder/"):
        assert _run("export", path, "-o", f"{tmp_path}/{name}").exit_code == 0
        assert (tmp_path / name).exists()
    assert (tmp_path / "folder").is_dir()
    assert _run("export", path, "-o", tmp_path / "table", "--format", "csv").exit_code == 0
    assert (tmp_path / "table").is_file()
    assert _run("export", path, "-o", tmp_path / "c.csv", "--format", "xls").exit_code == 2
    assert _run("export", path, "-o", tmp_path / "b.parquet", "--rows", "cells").exit_code == 2


def _program(*arguments):
    command = [
        sys.executable,
        "-c",
        "from raymap.cli import main; main()",
        *map(str, arguments),
    ]
    return subprocess.run(command, capture_output=True, text=True, cwd=_ROOT, check=False)


def test_refusals_are_one_clear_line(path, damaged, tmp_path):
    for arguments, words in (
        (("info", tmp_path / "none"), "does not exist"),
        (("info", __file__), "not a ray map"),
        (("export", path, "-o", path), "exists"),
        (("export", path, "-o", tmp_path / "x.foo"), ".parquet, .arrow, .csv"),
        (("export", path, "-o", tmp_path / "x"), ".parquet, .arrow, .csv"),
    ):
        done = _program(*arguments)
        assert done.returncode == 1
        assert done.stdout == ""
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: ")
        assert words in line
    assert _program("info").returncode == 2
    assert _program("export", damaged, "-o", tmp_path / "x.csv", "--strict").returncode == 1
    done = _program("export", damaged, "-o", tmp_path / "y.csv")
    assert done.returncode == 0
    assert "portion 1" in done.stderr


@pytest.mark.parametrize("arguments", [("info",), ("info", "--json"), ("verify",)])
def test_a_reader_of_the_output_that_goes_away_is_no_failure(path, arguments):
    command = [
        sys.executable,
        "-c",
        "from raymap.cli import main; main()",
        *arguments,
        str(path),
    ]
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            command, stdout=writing, stderr=subprocess.PIPE, text=True, cwd=_ROOT, check=False
        )
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


def test_help_is_quick_and_loads_no_compiler():
    code = (
        "import sys\n"
        "import raymap\n"
        "from raymap.cli import application\n"
        "application()\n"
        "heavy = {'numba', 'pyarrow', 'vtk', 'vtkmodules', 'pyvista', 'matplotlib', 'scipy'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=_ROOT, check=True
    )
    assert done.stdout.strip() == "[]"
    assert time.perf_counter() - start < 20


def test_a_command_is_the_same_without_the_others():
    run = CliRunner().invoke
    names = [command.name for command in application().registered_commands]
    for name in names:
        alone = application(name)
        assert [command.name for command in alone.registered_commands] == [name]
    for asked in (["info", "--help"], ["info"], ["info", "--nonsense"]):
        alone, among = (run(app, asked) for app in (application("info"), application()))
        assert (alone.exit_code, alone.output) == (among.exit_code, among.output)
    for asked in ("--help", "nonsense", ""):
        assert [command.name for command in application(asked).registered_commands] == names


def test_the_list_of_commands_has_parts_in_their_order():
    commands = application().registered_commands
    panels = [list(Panel).index(command.rich_help_panel) for command in commands]
    assert panels == sorted(panels)
    assert set(panels) == set(range(len(Panel)))


def test_the_version_is_that_of_the_package():
    done = CliRunner().invoke(application(), ["--version"])
    assert (done.exit_code, done.stdout) == (0, f"raymap {raymap.__version__}\n")
    assert metadata.version("raymap") == raymap.__version__


def test_the_package_runs_as_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "raymap", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"raymap {raymap.__version__}\n"
