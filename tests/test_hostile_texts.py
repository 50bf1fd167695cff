"""Whatever texts a file holds, no command lets one of them act on a terminal."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from raymap.cli.terminal import PlainStream, console, live_line, plain_streams
from raymap.model.directory import InputFile
from tests.fuzz.fuzz_values import Seed, put_together
from tests.viewer.small_map import make_directory, make_meshes, make_portion, rgb_channels
from tests.viewer.test_strange_names import is_active

ACTIVE = "\x1b]0;t\x07\x1b[2J\x7f\x9b\u202e\u2028\ufeff"
"""A title that is set, a screen that is cleared, and one of each sort of the others."""


def leaves(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of the texts in a JSON value."""
    if isinstance(value, str):
        yield place
    elif isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(each, (*place, key))


def change(value: Any, place: tuple[Any, ...]) -> None:
    """Put the characters behind the text at a place."""
    for key in place[:-1]:
        value = value[key]
    value[place[-1]] += ACTIVE


def texts_of(parts: list[Any]) -> list[tuple[Any, list[Any]]]:
    """All JSON texts of a map that is taken apart, and the streams that hold the same text."""
    found: dict[bytes, list[Any]] = {}
    for part in parts:
        for stream in part.streams:
            if stream.values.dtype == "u1" and bytes(stream.values[:1]) in (b"{", b"["):
                found.setdefault(bytes(stream.values), []).append(stream)
    values = []
    for data, streams in found.items():
        with contextlib.suppress(ValueError):
            values.append((json.loads(data), streams))
    return values


def put(streams: list[Any], value: Any) -> None:
    for stream in streams:
        stream.values = np.frombuffer(json.dumps(value).encode(), "u1")


def is_sound(path: Path) -> bool:
    try:
        with raymap.open(path, on_damage="skip") as opened:
            opened.describe()
            return not opened.damage and len(opened.portions) > 0
    except raymap.RayMapError:
        return False


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """A sound map of which every text that may hold anything acts on a terminal."""
    path = tmp_path_factory.mktemp("hostile") / "map.raymap"
    told = {"note": "a", "list": ["b"], "variants": ["c"]}
    plain = make_directory()
    objects = tuple(
        item.model_copy(update={"kind": "d", "aliases": ("e",), "parameters": told})
        for item in plain.objects
    )
    directory = plain.model_copy(
        update={
            "scene_text": "f\n\tg\n",
            "inputs": (InputFile(name="h", bytes=1, sha256="i"),),
            "parameters": told,
            "objects": objects,
            "media": tuple(x.model_copy(update={"parameters": told}) for x in plain.media),
            "sources": tuple(x.model_copy(update={"parameters": told}) for x in plain.sources),
        }
    )
    with raymap.RayMapWriter.create(path, directory, meshes=make_meshes()) as writer:
        writer.add_channel_set(rgb_channels())
        writer.start_run(seed=1, parameters=told)
        writer.append(make_portion(150))
        writer.finish()
    parts = Seed("", path).parts
    changed = 0
    for value, streams in texts_of(parts):
        sound = value
        for place in list(leaves(value)):
            tried = json.loads(json.dumps(sound))
            change(tried, place)
            put(streams, tried)
            path.write_bytes(put_together(parts))
            if is_sound(path):
                sound, changed = tried, changed + 1
        put(streams, sound)
    path.write_bytes(put_together(parts))
    return path, changed


COMMANDS = (
    "info MAP", "info MAP --streams", "info MAP --scene", "verify MAP", "query MAP",
    'query MAP hit("nothing")', "query MAP length>30 --limit 3", "query MAP all -o OUT.csv",
    "paths MAP", "paths MAP --by object", "report MAP 0", "audit MAP", "ghosts MAP",
    "illuminated MAP DET", "sweep MAP DET", "compare MAP MAP",
    "what-if MAP all --set SRC.flux=5", "what-if MAP all --set nothing.flux=5",
    "image MAP DET -o OUT.png", "image MAP nothing -o OUT.png", "chart MAP DET -o OUT.svg",
    "picture MAP -o OUT.png", "rayfile MAP DET -o OUT.sdf", "export MAP -o OUT.parquet",
    "export-3d MAP -o OUT.glb", "repair MAP -o OUT.raymap --force",
)  # fmt: skip


@pytest.mark.parametrize("line", COMMANDS)
def test_no_text_of_a_map_acts_on_a_terminal(
    run: Any, hostile: tuple[Path, int], tmp_path: Path, line: str
) -> None:
    path, changed = hostile
    assert changed > 20
    with raymap.open(path) as opened:
        detector = opened.directory.detectors[0].name
        source = opened.directory.sources[0].name
    words = []
    for word in line.split(" "):
        whole = {"MAP": str(path), "DET": detector}.get(word, word.replace("SRC", source))
        words.append(whole.replace("OUT", str(tmp_path / "out")))
    for options in ([], ["--json"]):
        code, out, err = run(*words, *options)
        assert "Traceback" not in err
        assert code in (0, 1, 2)
        for text in (out, err):
            assert not [x for x in text.replace("\n", "").replace("\t", "") if is_active(x)], words
        if options and code == 0 and out:
            json.loads(out)


def test_json_says_what_the_map_holds(run: Any, hostile: tuple[Path, int]) -> None:
    with raymap.open(hostile[0]) as opened:
        text = opened.directory.scene_text
    _, out, _ = run("info", hostile[0], "--scene", "--json")
    assert json.loads(out)["text"] == text


LENS = f"""
RDM;LEN
TITLE 'a{ACTIVE}b'
EPD 5
WL 587.6
YAN 0
SO 0 1E20
S 50 3 NBK7_SCHOTT
  STO
S -50 45
SI 0 0
GO
"""
SCENE = """
length_unit = "mm"
title = "TEXT"
[sources."TEXT"]
kind = "point"
flux = 1.0
[surfaces."TEXT"]
kind = "mirror"
reflectance = 0.5
[objects."TEXT"]
kind = "sphere"
radius = 1
material = "TEXT"
"""


@pytest.mark.parametrize("line", ["check FILE", "faces FILE", "record FILE --rays 10 --no-rays"])
@pytest.mark.parametrize("name", ["a.seq", "a.toml", "a.obj", "a.bin", f"a{ACTIVE}.toml"])
def test_no_text_of_a_scene_acts_on_a_terminal(
    run: Any, tmp_path: Path, name: str, line: str
) -> None:
    text = LENS if name == "a.seq" else SCENE.replace("TEXT", json.dumps(ACTIVE)[1:-1] + "x")
    if name.endswith(".obj"):
        text = f"v 0 0 0\nv 1 0 0\nv 0 1 0\ng a{ACTIVE}\nf 1 2 3\nusemtl b{ACTIVE}\nf 1 3 2\n"
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    output = ["-o", tmp_path / "out.raymap"] * line.startswith("record")
    for options in ([], ["--json"]):
        words = [str(path) if word == "FILE" else word for word in line.split()]
        _, out, err = run(*words, *output, *options)
        assert out + err
        assert "Traceback" not in err
        for each in (out, err):
            assert not [x for x in each.replace("\n", "").replace("\t", "") if is_active(x)], words


def test_colours_and_live_lines_are_ours(capsys: pytest.CaptureFixture[str]) -> None:
    import sys

    from rich.text import Text

    with plain_streams():
        print(f"a{ACTIVE}\tb")
        live_line(f"c{ACTIVE}")
        ours = console(force_terminal=True, color_system="truecolor", width=200)
        ours.print(Text(f"d{ACTIVE}", style="rgb(1,2,3)"))
        assert isinstance(sys.stdout, PlainStream)
        assert not hasattr(sys.stdout, "buffer")
    out, err = capsys.readouterr()
    spelt = "\\x1b]0;t\\x07\\x1b[2J\\x7f\\x9b\\u202e\\u2028\\ufeff"
    # Rich takes bells away
    shown = spelt.replace("\\x07", "")
    assert out == f"a{spelt}\tb\n\x1b[38;2;1;2;3md{shown}\x1b[0m\n"
    assert err == f"\r\x1b[Kc{spelt}"


def test_what_a_stream_cannot_write_is_spelt_out(tmp_path: Path) -> None:
    with (tmp_path / "out.txt").open("w", encoding="ascii") as file:
        PlainStream(file).writelines(["µ\x1b", "b\n"])
    assert (tmp_path / "out.txt").read_text() == "\\xb5\\x1bb\n"
