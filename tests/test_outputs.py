"""One rule for all files that commands write: whole or not at all, and what is replaced.

Tables, pictures, plots and drawings replace an existing file. Ray maps, ray files and 3D models,
which may be somebody's original, are replaced only with ``--force``.
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main

import raymap
from raymap.cli import application
from raymap.model.errors import RayMapError
from raymap.pictures.files import write_chart, write_pixels
from raymap.tables.exr import write_exr
from tests.viewer.small_map import write_map
from tracer.render.images import write_animation
from tracer.scattering.fits.material_file import write_result
from tracer.scene.load import parse_scene
from tracer.studies.section import draw_section
from viewer import ViewState, save_state

REPLACED = [
    *(("query MAP -o", f"a.{kind}") for kind in ("csv", "parquet", "arrow")),
    *(("export MAP -o", f"a.{kind}") for kind in ("csv", "parquet", "arrow")),
    *(("image MAP sensor -o", f"a.{kind}") for kind in ("png", "tiff", "exr", "csv", "npy")),
    ("picture MAP --width 64 --height 48 -o", "a.png"),
]
ASKED_FOR = [
    ("query MAP -o", "a.raymap"),
    ("repair MAP -o", "a.raymap"),
    *(("export-3d MAP -o", f"a.{kind}") for kind in ("glb", "gltf", "vtp", "dxf", "step")),
    *(("rayfile MAP sensor -o", f"a.{kind}") for kind in ("tm25ray", "dat", "sdf")),
    *(("check-rays RAYS -o", f"a.{kind}") for kind in ("tm25ray", "dat", "sdf")),
]
SCENE = """
length_unit = "mm"
[sources.lamp]
kind = "point"
[bodies.wall]
kind = "rectangle"
size = [10, 10]
position = [0, 0, 20]
surface = "absorber"
"""


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What the words in capitals stand for."""
    from query import select
    from query.answers.reports.rays_at_place import write_ray_file

    folder = tmp_path_factory.mktemp("originals")
    path = write_map(folder / "small.raymap")
    with raymap.open(path) as ray_map:
        write_ray_file(select(ray_map), folder / "light.tm25ray", "sensor")
    return {"MAP": str(path), "RAYS": str(folder / "light.tm25ray")}


@contextmanager
def no_room() -> Iterator[None]:
    """Files end after a few bytes, as on a full disk, whoever writes them."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def words(command: str, originals: dict[str, str], target: Path) -> list[str]:
    return [*(originals.get(word, word) for word in command.split()), str(target)]


@pytest.mark.parametrize(("command", "name"), [*REPLACED, *ASKED_FOR])
def test_a_full_disk_leaves_the_old_file(
    run: Any, originals: dict[str, str], tmp_path: Path, command: str, name: str
) -> None:
    target = tmp_path / name
    asked = words(command, originals, target)
    assert run(*asked)[0] == 0
    old = target.read_bytes()
    force = ["--force"] if (command, name) in ASKED_FOR else []
    with no_room():
        code, _, said = run(*asked, *force)
    assert code == 1, said
    assert said.startswith("error: ")
    assert "Traceback" not in said
    assert target.read_bytes() == old
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(("command", "name"), REPLACED)
def test_what_can_be_made_again_is_replaced(
    run: Any, originals: dict[str, str], tmp_path: Path, command: str, name: str
) -> None:
    target = tmp_path / name
    target.write_bytes(b"old")
    assert run(*words(command, originals, target))[0] == 0
    assert len(target.read_bytes()) > 3
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(("command", "name"), ASKED_FOR)
def test_what_may_be_an_original_is_replaced_when_asked_for(
    run: Any, originals: dict[str, str], tmp_path: Path, command: str, name: str
) -> None:
    target = tmp_path / name
    target.write_bytes(b"old")
    code, _, said = run(*words(command, originals, target))
    assert code == 1
    assert f"{target} exists" in said
    assert "--force" in said
    assert target.read_bytes() == b"old"
    assert run(*words(command, originals, target), "--force")[0] == 0
    assert len(target.read_bytes()) > 3


@pytest.mark.parametrize("command", ["picture MAP -o", "export MAP --format csv -o"])
def test_a_map_is_no_place_for_other_outputs(
    run: Any, originals: dict[str, str], tmp_path: Path, command: str
) -> None:
    target = tmp_path / "recorded.raymap"
    target.write_bytes(b"hours of work")
    assert run(*words(command, originals, target))[0] == 1
    assert target.read_bytes() == b"hours of work"


def test_help_says_what_happens_to_an_existing_file() -> None:
    commands: dict[str, Any] = vars(typer.main.get_command(application()))["commands"]
    writers = set()
    for name, command in commands.items():
        options = [option for option in command.params if option.param_type_name == "option"]
        shown = {option.name for option in options if not option.hidden}
        for option in options:
            if "-o" in option.opts:
                writers.add(name)
                assert "force" in shown or "replaced" in (option.help or ""), name
    tried = {command.split()[0] for command, _ in [*REPLACED, *ASKED_FOR]}
    assert tried < writers


def _figure() -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.0, 1.0))
    figure.subplots().plot([0, 1])
    return figure


PIXELS = np.arange(300, dtype=np.uint8).reshape(10, 10, 3)
WRITERS: dict[str, Callable[[Path], object]] = {
    "a.svg": lambda path: draw_section(parse_scene(SCENE), path),
    "plot.png": lambda path: write_chart(_figure(), path),
    "plot.pdf": lambda path: write_chart(_figure(), path),
    "picture.jpg": lambda path: write_pixels(path, PIXELS / 255.0),
    "a.png": lambda path: write_pixels(path, PIXELS),
    "a.tiff": lambda path: write_pixels(path, PIXELS),
    "film.png": lambda path: write_animation(path, [PIXELS, PIXELS], seconds_per_frame=0.1),
    "a.exr": lambda path: write_exr(path, {"Y": PIXELS[:, :, 0].astype(np.float32)}),
    "fit.csv": lambda path: write_result(path, 100 * "1,2,3\n"),
    "session.json": lambda path: save_state(ViewState(criterion="any"), path),
}


@pytest.mark.parametrize("name", WRITERS)
def test_other_writers_keep_the_rule(tmp_path: Path, name: str) -> None:
    target = tmp_path / name
    WRITERS[name](target)
    whole = target.read_bytes()
    target.write_bytes(b"old")
    with no_room(), pytest.raises(RayMapError, match="cannot be written"):
        WRITERS[name](target)
    assert target.read_bytes() == b"old"
    WRITERS[name](target)
    assert len(target.read_bytes()) == len(whole)
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_endings_that_nobody_writes_are_refused(tmp_path: Path) -> None:
    for name in ("scene.toml", "plot", "plot.xyz"):
        for write in (
            lambda path: write_chart(_figure(), path),
            lambda path: write_pixels(path, PIXELS / 255.0),
            lambda path: draw_section(parse_scene(SCENE), path),
        ):
            with pytest.raises(RayMapError, match="not "):
                write(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_parts_of_a_table_change_all_at_once(
    run: Any, originals: dict[str, str], tmp_path: Path
) -> None:
    folder = tmp_path / "table"
    export = ["export", originals["MAP"], "-o", f"{folder}/"]
    assert run(*export)[0] == 0
    first = (folder / "part-00000.parquet").read_bytes()
    # A part that this table has no more, and a file that is none of its parts
    (folder / "part-00007.parquet").write_bytes(first)
    (folder / "notes.txt").write_text("mine")
    with no_room():
        assert run(*export)[0] == 1
    assert (folder / "part-00000.parquet").read_bytes() == first
    assert (folder / "part-00007.parquet").exists()
    assert run(*export)[0] == 0
    assert sorted(entry.name for entry in folder.iterdir()) == ["notes.txt", "part-00000.parquet"]
