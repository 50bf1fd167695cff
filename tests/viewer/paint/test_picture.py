"""Pictures: those kept for comparison, the commands, and exports read by other programs."""

from __future__ import annotations

import json
import struct
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import raymap
from query import hit
from raymap.model.events import FAMILIES
from tests.viewer.small_map import write_map
from viewer import ViewState, picture, save_state
from viewer.cli import parse_section
from viewer.drawn.answers import draw_rays
from viewer.drawn.scene import load_bodies
from viewer.drawn.state import Section, StateError
from viewer.export.gltf import to_glb
from viewer.export.vtp import to_vtp
from viewer.paint.painter import Painter
from viewer.paint.rendering import NothingDrawn

KEPT = Path(__file__).parents[2] / "data" / "pictures"

SCENES = {
    "side": {"criterion": "", "view": "side", "state": ViewState()},
    "ghost": {
        "criterion": 'count(hit("L1", reflected)) == 2',
        "view": "tilted",
        "color": "source",
        "state": ViewState(dark=False, section=Section(on=True), width=2.0),
    },
}


def distance(one: np.ndarray, two: np.ndarray) -> float:
    """Mean difference of pictures that are blurred over 4 x 4 pixels, 0 … 255."""

    def blur(pixels: np.ndarray) -> np.ndarray:
        h, w = pixels.shape[0] // 4, pixels.shape[1] // 4
        return pixels[: 4 * h, : 4 * w].reshape(h, 4, w, 4, 3).astype(float).mean(axis=(1, 3))

    return float(np.abs(blur(one) - blur(two)).mean())


@pytest.mark.parametrize("name", SCENES)
def test_pictures_look_as_they_did(small_map: raymap.RayMap, name: str, tmp_path: Path) -> None:
    arguments = dict(SCENES[name])
    pixels = picture(
        small_map, arguments.pop("criterion") or None, size=(320, 200), rays=80, legend=False,
        out=tmp_path / "now.png", **arguments,
    )  # fmt: skip
    with Image.open(KEPT / f"{name}.png") as image:
        kept = np.asarray(image.convert("RGB"))
    assert distance(pixels, kept) < 1.0
    # and the measure tells a picture without rays apart
    with pytest.warns(NothingDrawn, match="no ray satisfies the criterion"):
        empty = picture(
            small_map, 'source("star") & source("lamp")', size=(320, 200), legend=False, **arguments
        )
    assert distance(empty, kept) > 2.0


def test_the_command_paints(run: Any, map_path: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    status, text, said = run(
        "picture", map_path, 'detected("sensor")', "-o", out, "--width", 200, "--height", 120,
        "--color", "ending", "--view", "tilted", "--section", "-x=1", "--hide", "tube", "--json",
    )  # fmt: skip
    assert status == 0, said
    answer = json.loads(text)
    assert (answer["width"], answer["height"]) == (200, 120)
    with Image.open(out) as image:
        assert image.size == (200, 120)
    session = tmp_path / "session.json"
    save_state(ViewState(criterion='hit("L1")', hidden=("tube",), rays=30), session)
    assert run("picture", map_path, "-o", out, "--session", session, "--width", 100)[0] == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (['hit("L9")'], "L9"),
        (['hit("L1"'], "never closed"),
        (["--color", "plaid"], "plaid"),
        (["--view", "inside"], "inside"),
        (["--hide", "tub"], "tube"),
        (["--section", "q"], "+x"),
        (["--width", "1"], "16 to"),
        (["--session", "/nowhere.json"], "nowhere"),
    ],
)
def test_the_command_refuses_in_one_line(
    run: Any, map_path: Path, tmp_path: Path, arguments: list[str], says: str
) -> None:
    out = tmp_path / "a.png"
    status, _, text = run("picture", map_path, "-o", out, *arguments)
    assert status == 1
    assert text.startswith("error: ")
    assert says in text
    assert not out.exists()
    assert list(tmp_path.iterdir()) == [] or not any(tmp_path.glob("*.png"))


def test_a_picture_that_cannot_be_written_leaves_nothing(
    small_map: raymap.RayMap, tmp_path: Path
) -> None:
    with pytest.raises(raymap.RayMapError, match="cannot be written"):
        picture(small_map, size=(64, 64), out=tmp_path / "no" / "a.png")
    (tmp_path / "taken.png").mkdir()
    with pytest.raises(raymap.RayMapError, match="cannot be written"):
        picture(small_map, size=(64, 64), out=tmp_path / "taken.png")
    assert [entry.name for entry in tmp_path.iterdir() if entry.is_file()] == []


def test_a_damaged_map_is_painted_without_its_lost_portion(run: Any, tmp_path: Path) -> None:
    path = write_map(tmp_path / "hurt.raymap", portions=3, rays=100)
    with raymap.open(path) as ray_map:
        middle = ray_map.portions[1].offset + ray_map.portions[1].stored_bytes // 2
    data = bytearray(path.read_bytes())
    data[middle] ^= 0xFF
    path.write_bytes(data)
    status, _, text = run("picture", path, "-o", tmp_path / "a.png", "--width", 80, "--height", 60)
    assert status == 0, text
    assert "warning" in text


@pytest.mark.parametrize(
    ("text", "normal", "offset"),
    [("+x", (1, 0, 0), 0), ("-y=2.5", (0, -1, 0), -2.5), (" +z = 4", (0, 0, 1), 4)],
)
def test_sections_are_read(text: str, normal: tuple, offset: float) -> None:
    section = parse_section(text)
    assert section == Section(on=True, normal=normal, offset=offset)


@pytest.mark.parametrize("text", ["", "x", "+q", "+xy", "+x=two"])
def test_wrong_sections_are_refused(text: str) -> None:
    with pytest.raises(StateError, match=r"write \+x"):
        parse_section(text)


# -- exports -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scene(small_map: raymap.RayMap) -> tuple:
    painter = Painter(load_bodies(small_map.directory, small_map.meshes), small_map.directory)
    shown = painter.show(ViewState(), draw_rays(small_map, "", 50).rays)
    return painter, shown


def test_glb_is_sound(scene: tuple) -> None:
    painter, shown = scene
    data = to_glb(painter.bodies, shown.lines, shown.rgba)
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    names = [node["name"] for node in document["nodes"]]
    assert names == ["L1", "tube", "sensor", "rays"]
    binary = data[28 + size :]
    assert document["buffers"][0]["byteLength"] == len(binary)
    rays = document["meshes"][-1]["primitives"][0]
    accessor = document["accessors"][rays["attributes"]["POSITION"]]
    view = document["bufferViews"][accessor["bufferView"]]
    points = np.frombuffer(binary, np.float32, 3 * accessor["count"], view["byteOffset"])
    np.testing.assert_array_equal(points.reshape(-1, 2, 3), shown.lines.segments)
    assert rays["mode"] == 1
    for entry in document["accessors"]:
        assert entry["count"] > 0


def test_vtp_is_sound(scene: tuple) -> None:
    _, shown = scene
    data = to_vtp(shown.rays, shown.lines, shown.rgba)
    head, _, rest = data.partition(b'<AppendedData encoding="raw">_')
    root = ET.fromstring(head + b"</VTKFile>")
    arrays = {entry.get("Name"): entry for entry in root.iter("DataArray")}

    def values(name: str, kind: type) -> np.ndarray:
        offset = int(arrays[name].get("offset") or 0)
        size = struct.unpack_from("<Q", rest, offset)[0]
        return np.frombuffer(rest, kind, size // np.dtype(kind).itemsize, offset + 8)

    points = values("Points", np.float32).reshape(-1, 2, 3)
    np.testing.assert_array_equal(points, shown.lines.segments)
    np.testing.assert_array_equal(values("ray_id", np.int64), shown.rays.ray_ids[shown.lines.ray])
    assert values("offsets", np.int64)[-1] == 2 * len(shown.lines)
    assert (values("step", np.int32)[:2] == [0, 1]).all()


def test_nothing_shown_is_exported_as_empty_files(small_map: raymap.RayMap) -> None:
    painter = Painter([], small_map.directory)
    shown = painter.show(
        ViewState(), draw_rays(small_map, 'source("star") & source("lamp")', 5).rays
    )
    assert to_glb([], shown.lines, shown.rgba).startswith(b"glTF")
    assert b'NumberOfLines="0"' in to_vtp(shown.rays, shown.lines, shown.rgba)


@pytest.mark.peers
def test_other_programs_read_the_exports(scene: tuple, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    pyvista = pytest.importorskip("pyvista")
    painter, shown = scene
    (tmp_path / "a.glb").write_bytes(to_glb(painter.bodies, shown.lines, shown.rgba))
    loaded = trimesh.load(tmp_path / "a.glb", process=False)
    triangles = sum(len(body.corners) for body in painter.bodies)
    assert sum(len(g.faces) for g in loaded.geometry.values() if hasattr(g, "faces")) == triangles
    (tmp_path / "a.vtp").write_bytes(to_vtp(shown.rays, shown.lines, shown.rgba))
    lines = pyvista.read(tmp_path / "a.vtp")
    assert lines.n_lines == len(shown.lines)
    np.testing.assert_array_equal(lines.cell_data["ray_id"], shown.rays.ray_ids[shown.lines.ray])
    np.testing.assert_array_equal(lines.points.reshape(-1, 2, 3), shown.lines.segments)


def test_every_spelling_of_a_criterion_draws_the_same_rays(small_map):
    tree = hit("*", FAMILIES["reflected"])
    expected = draw_rays(small_map, str(tree), 30).rays.ray_ids
    assert len(expected)
    for spelling in (tree, tree.to_json()):
        np.testing.assert_array_equal(draw_rays(small_map, spelling, 30).rays.ray_ids, expected)
        alone = draw_rays(small_map, spelling, 30, paths=[('hit("*")', "met")]).rays.ray_ids
        np.testing.assert_array_equal(alone, expected)
