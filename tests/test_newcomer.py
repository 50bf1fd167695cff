"""A file in the wrong place of any command: one clear line with the remedy, exit 1, no traceback.

Every place of every command that takes the name of a file or folder is tried with every kind of
wrong thing. Nothing may be computed before such a place is refused: the tests run no trace.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import typing
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from raymap.cli import application
from tests.raymap.foreign.test_zrd import TREES, write_zrd
from tests.test_without_extras import SCENE
from tests.viewer.small_map import write_map

LENSES = Path(__file__).parent / "data" / "lenses"
SINGLET = """
RDM;LEN
EPD 5
DIM M
WL 587.6
YAN 0
SO 0 1E20
S 50 3 NBK7_SCHOTT
  STO
S -50 45
SI 0 0
GO
"""
MAP = "<map.raymap"
COMMANDS = {
    "record": "<scene.toml -o >new.raymap --rays 10",
    "check": "<scene.toml -o >section.svg",
    "faces": "<part.step",
    "doctor": "",
    "kinds": "",
    "query": f"{MAP} all -o >rays.csv",
    "paths": MAP,
    "report": f"{MAP} 0",
    "audit": MAP,
    "ghosts": MAP,
    "illuminated": f"{MAP} sensor",
    "sweep": f"{MAP} sensor",
    "compare": f"{MAP} {MAP}",
    "histogram": f"{MAP} length",
    "what-if": f"{MAP} --scene <scene.toml",
    "sensitivity": MAP,
    "improve": f"{MAP} 'event(reflected)' --reflectance 0.2% --faces 1",
    "image": f"{MAP} sensor -o >image.png",
    "focus": f"{MAP} sensor",
    "picture": f"{MAP} -o >picture.png --session <session.json",
    "chart": f"{MAP} sensor -o >chart.svg",
    "view": f"{MAP} --no-browser --session <session.json",
    "rayfile": f"{MAP} sensor -o >rays.sdf",
    "import": "<run.zrd -o >new.raymap --names <names.toml",
    "info": MAP,
    "verify": MAP,
    "repair": f"{MAP} -o >new.raymap",
    "mix": f"{MAP} -o >both.raymix",
    "export": f"{MAP} -o >rays.parquet",
    "check-rays": "<rays.sdf -o >rays.tm25ray",
    "serve": "<served/ --token-file <token.txt --tokens <tokens.json "
    "--tls-certificate <certificate.pem --tls-key <key.pem",
    "export-3d": f"{MAP} -o >rays.glb",
    "lens-levels": "-o >plot.png",
    "lens-cone": "-o >plot.png",
    "lens-vignetting": "-o >plot.png",
    "lens-picture": "-o >picture.png",
    "microscope": "-o >picture.png",
    "verify-crystals": "-o >pictures/ --scenes <scenes/ --only pictures",
    "render": "<room.toml -o >room.png",
    "fit-scattering": "<measured.toml -o >fitted/",
    "goniophotometer": "<material.toml --thickness 1 -o >seen/ --rays 100",
    "token add": "name --tokens >tokens.json",
    "token list": "--tokens <tokens.json",
    "token remove": "name --tokens <tokens.json",
}
"""Words behind each command: ``<`` marks what is read, ``>`` what is written, ``/`` a folder."""

FORMS = {
    "faces": ("<mesh.stl", "<scene.toml", "<lens.zmx", "<lens.seq"),
    "record": ("<lens.zmx -o >new.raymap", "<lens.seq -o >new.raymap"),
    "query": tuple(f"{MAP} all -o >rays.{kind}" for kind in ("raymap", "parquet", "arrow")),
    "export": tuple(f"{MAP} -o >rays{kind}" for kind in (".csv", ".arrow", "/")),
    "image": tuple(f"{MAP} sensor -o >image.{kind}" for kind in ("csv", "npy", "exr", "tiff")),
    "export-3d": tuple(f"{MAP} -o >rays.{kind}" for kind in ("step", "dxf", "vtp")),
    "rayfile": tuple(f"{MAP} sensor -o >rays.{kind}" for kind in ("tm25ray", "dat")),
    "check-rays": ("<rays.tm25ray", "<rays.dat"),
    "render": ("<room.toml -o >room.exr",),
}
"""The same in other formats, which other modules read and write."""

CASES = [
    (command, words, place)
    for command, first in COMMANDS.items()
    for words in (first, *FORMS.get(command, ()))
    for place, word in enumerate(words.split())
    if word[0] in "<>"
]


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """Sound files of a user, in a folder that everybody may enter."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        folder.chmod(0o777)
        path = write_map(folder / "map.raymap")
        with raymap.open(path) as ray_map:
            for kind in ("sdf", "tm25ray", "dat"):
                query.write_ray_file(query.select(ray_map), folder / f"rays.{kind}", "sensor")
        for name in ("scene.toml", "room.toml", "measured.toml", "material.toml"):
            (folder / name).write_text(SCENE, encoding="utf-8")
        shutil.copy(LENSES / "US05831776-1.zmx", folder / "lens.zmx")
        (folder / "lens.seq").write_text(SINGLET, encoding="utf-8")
        write_zrd(folder / "run.zrd", TREES)
        (folder / "session.json").write_text("{}", encoding="utf-8")
        (folder / "names.toml").write_text('1 = "lamp"\n', encoding="utf-8")
        (folder / "tokens.json").write_text('{"tokens": []}', encoding="utf-8")
        (folder / "token.txt").write_text("a-token-of-many-letters", encoding="utf-8")
        for name in ("certificate.pem", "key.pem"):
            (folder / name).write_text("-----BEGIN-----\n", encoding="utf-8")
        for path in folder.iterdir():
            path.chmod(0o644)
        (folder / "tokens.json").chmod(0o600)
        for name in ("served", "scenes"):
            (folder / name).mkdir()
        (folder / "closed").mkdir(mode=0o555)
        (folder / "text").write_text("Two\nlines\n", encoding="utf-8")
        yield folder


@contextmanager
def nobody() -> Iterator[None]:
    """As a user who owns nothing; a superuser may read and write everywhere."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


def wrong_inputs(name: str) -> dict[str, tuple[str, str]]:
    """What stands at the place of a file to read: its name, and what the message says of it."""
    ending = Path(name).suffix
    if name.endswith("/"):
        return {"nothing": ("missing", "folder"), "a file": ("text", "folder")}
    return {
        "nothing": (f"missing{ending}", "there is no|does not exist|no file"),
        "nothing in no folder": (f"none/missing{ending}", "there is no|does not exist"),
        "nothing in a file": (f"text/missing{ending}", "there is no|does not exist"),
        "a folder": (f"folder{ending}", "folder"),
        "an empty file": (f"empty{ending}", "empty"),
        "a binary file": (f"binary{ending}", "."),
        "a text": (f"text{ending}", "."),
        "a locked file": (f"locked{ending}", "permission denied"),
        "a device": (f"device{ending}", "device"),
    }


def wrong_outputs(name: str) -> dict[str, tuple[str, str]]:
    """What stands at the place of a file to write."""
    ending = Path(name).suffix
    if name.endswith("/"):
        return {
            "a file": ("text/", "file"),
            "a folder in a file": ("text/new/", "file"),
            "a locked folder": ("closed/new/", "permission denied"),
            "a device": ("/dev/full/", "file|device"),
        }
    return {
        "a folder": (f"folder{ending}", "it is a folder; name a file"),
        "no folder": (f"none/new{ending}", "there is no folder none"),
        "a folder that is a file": (f"text/new{ending}", "text is no folder"),
        "a locked folder": (f"closed/new{ending}", "permission denied"),
        "a device": (f"device{ending}", "device"),
    }


def lay(folder: Path, name: str, kind: str) -> None:
    """Lay what a case asks for into the folder."""
    path = folder / name
    if "/" in name or kind.startswith("no") or path.exists():
        return
    if kind == "a folder":
        path.mkdir()
    elif kind == "a device":
        path.symlink_to("/dev/full")
    elif kind == "a binary file":
        path.write_bytes(bytes(range(256)) * 8)
    elif kind == "an empty file":
        path.write_bytes(b"")
    else:
        path.write_text("Nothing of the kind.\nTwo lines.\n", encoding="utf-8")
    if kind == "a locked file":
        path.chmod(0)


@pytest.mark.parametrize(("command", "words", "place"), CASES)
def test_what_is_wrong_is_said_in_one_line(
    command: str, words: str, place: int, folder: Path, run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    asked = [word.strip("<>/") if word[0] in "<>" else word for word in words.split()]
    marked = words.split()[place]
    is_read = marked[0] == "<"
    wrong = wrong_inputs(marked[1:]) if is_read else wrong_outputs(marked[1:])
    if command == "token add":
        del wrong["no folder"]  # it makes the folder of the user's configuration
    for kind, (name, said) in wrong.items():
        lay(folder, name, kind)
        asked[place] = name
        before = sorted(str(path) for path in folder.rglob("*"))
        if "locked" in kind:
            with nobody():
                code, out, error = run(*command.split(), *asked)
        else:
            code, out, error = run(*command.split(), *asked)
        told = [line for line in error.splitlines() if line.startswith("error: ")]
        where = (command, kind, code, out, error)
        assert code == 1, where
        assert len(told) == 1, where
        assert "Traceback" not in error, where
        assert "Errno" not in error, where
        assert re.search(said, told[0]), where
        assert Path(name).stem in told[0], where
        assert sorted(str(path) for path in folder.rglob("*")) == before, where


def test_every_place_of_every_command_is_tried() -> None:
    """Files and folders are parameters of the type `Path`, or called output."""
    found = {}
    app: Any = application()
    groups = [("", app), *((f"{g.name} ", g.typer_instance) for g in app.registered_groups)]
    for prefix, group in groups:
        for item in group.registered_commands:
            if item.hidden:
                continue
            hints = typing.get_type_hints(item.callback)
            paths = [k for k, v in hints.items() if Path in (v, *typing.get_args(v))]
            paths += [k for k in hints if k == "output" and k not in paths]
            found[f"{prefix}{item.name}"] = len(paths)
            # Maps with their factors are texts
            found[f"{prefix}{item.name}"] += item.name == "mix"
    tried = {
        name: sum(word[0] in "<>" for word in words.split()) for name, words in COMMANDS.items()
    }
    assert tried == found


TAKES_A_FILE = [name for name, words in COMMANDS.items() if words.startswith("<")]


@pytest.mark.parametrize("command", sorted(set(TAKES_A_FILE) - {"serve"}))
def test_a_missing_argument_is_named(command: str, run: Any) -> None:
    code, _, error = run(command)
    assert code == 2
    assert "Missing" in error
