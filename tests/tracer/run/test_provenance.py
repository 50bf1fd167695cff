"""What a map says of the scene that it was recorded from."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import raymap
from raymap.cli import application
from tests.tracer.scene.test_obeyed import CRYSTAL, plate
from tracer import compile_scene, load_scene
from tracer.run.recording import record
from tracer.run.trace import TRANSPORT_LAW
from tracer.transport.wavefront import Wavefront

OBJ = """v 0 0 5
v 1 0 5
v 0 1 5
v 0 0 6
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""
IES_LIKE = plate(
    more="""
[bodies.wedge]
kind = "mesh"
file = "parts/wedge.obj"
scale = 1.0
medium = "glass"
[variants.dark.sources.lamp]
flux = 0.5
"""
)


def _write(folder: Path, text: str) -> Path:
    (folder / "parts").mkdir()
    (folder / "parts" / "wedge.obj").write_text(OBJ)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def test_a_map_names_the_files_that_its_scene_read(tmp_path: Path) -> None:
    scene = _write(tmp_path, IES_LIKE)
    record(scene, tmp_path / "a.raymap", rays=64)
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        (entry,) = ray_map.directory.inputs
    assert entry.name == "parts/wedge.obj"
    assert entry.bytes == len(OBJ)
    assert entry.sha256 == hashlib.sha256(OBJ.encode()).hexdigest()
    shown = json.loads(
        CliRunner().invoke(application(), ["info", str(tmp_path / "a.raymap"), "--json"]).output
    )
    assert shown["inputs"] == [entry.model_dump()]


def test_where_files_lay_is_not_told(tmp_path: Path) -> None:
    absolute = IES_LIKE.replace("parts/wedge.obj", str(tmp_path / "parts" / "wedge.obj"))
    directory = compile_scene(load_scene(_write(tmp_path, absolute))).directory
    assert [entry.name for entry in directory.inputs] == ["wedge.obj"]


def test_the_scene_is_printed_as_it_was_written(tmp_path: Path) -> None:
    scene = _write(tmp_path, IES_LIKE)
    record(load_scene(scene, variants=["dark"]), tmp_path / "a.raymap", rays=64)
    printed = CliRunner().invoke(application(), ["info", str(tmp_path / "a.raymap"), "--scene"])
    assert printed.stdout.rstrip("\n") == scene.read_text().rstrip("\n")
    assert "dark" in printed.stderr
    (tmp_path / "again.toml").write_text(printed.stdout)
    again = compile_scene(load_scene(tmp_path / "again.toml", variants=["dark"]))
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert again.directory == ray_map.directory.model_copy(
            update={"scene_text": printed.stdout}
        )


def test_crystals_say_the_same(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(CRYSTAL)
    record(path, tmp_path / "a.raymap", rays=16)
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert ray_map.directory.scene_text == CRYSTAL
        assert ray_map.runs[0]["parameters"]["transport_law"] == TRANSPORT_LAW
        assert ray_map.runs[0]["parameters"]["raymap"] == raymap.__version__


def test_draws_are_those_of_this_transport_law() -> None:
    """Where this fails, the same seed draws other paths: raise `TRANSPORT_LAW` and its digest."""
    compilation = compile_scene(load_scene(Path(__file__).parents[3] / "samples/double_gauss.toml"))
    portion = Wavefront(compilation.arrays, 1).trace(0, 500)
    words = np.concatenate([portion.records_per_ray, portion.object, portion.event]).astype("<i4")
    digest = hashlib.sha256(words.tobytes()).hexdigest()[:16]
    assert (TRANSPORT_LAW, digest) == (2, "fcbca050f0a0d81e")
