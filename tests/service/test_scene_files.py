"""Whatever key of a scene names a file, no file outside the served folder is read for a client."""

from __future__ import annotations

import importlib
import os
import pkgutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel

import tracer
from raymap.model.errors import RayMapError, SceneError
from service.files.confine import OutsideFolder, ServedFolder
from service.files.mirror import SceneMirror
from tests.scenes import MIRROR_BALL
from tracer.description.named_files import named_file, reading_through
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene

CUBE = "solid s\n" + "".join(
    "facet normal 0 0 0\nouter loop\n"
    + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
    + "endloop\nendfacet\n"
    for corners in (
        ((0, 0, 0), (0, 1, 0), (1, 0, 0)),
        ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
        ((0, 0, 0), (0, 0, 1), (0, 1, 0)),
        ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    )
) + "endsolid s\n"  # fmt: skip

LIGHT = """
[sources.lamp]
kind = "collimated"
diameter = 2
position = [0, 0, -10]
direction = [0, 0, 1]
"""
MESH = 'kind = "mesh"\nfile = {file}\nscale = 1\nsurface = "absorber"\n'
KEYS = {
    "bodies": LIGHT + '[bodies.secret]\n' + MESH,
    "title": LIGHT + '[bodies.title]\n' + MESH,
    "copies": LIGHT + '[bodies.note]\n' + MESH + "copies = {{ count = 2, step = [5, 0, 0] }}\n",
    "variant": LIGHT + '[variants.v.bodies.title]\n' + MESH,
    "source": '[sources.description]\nkind = "intensity"\nfile = {file}\n',
    "picture": '[sources.comment]\nkind = "picture"\nfile = {file}\nsize = [1, 1]\n',
    "cad": LIGHT + "[cad_files.title]\nfile = {file}\n",
    "lens": LIGHT + "[lens_files.title]\nfile = {file}\n",
}  # fmt: skip
SUFFIX = {"source": ".ies", "picture": ".npy", "cad": ".step", "lens": ".zmx"}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A served folder with links, and secrets beside it."""
    folder = tmp_path / "served"
    (folder / "sub").mkdir(parents=True)
    np.save(tmp_path / "secret.npy", np.ones((2, 2)))
    for suffix in (".stl", ".ies", ".step", ".zmx"):
        (tmp_path / f"secret{suffix}").write_text(CUBE)
    (folder / "inside.stl").write_text(CUBE)
    (folder / ".hidden.stl").write_text(CUBE)
    for suffix in (".stl", ".ies", ".step", ".zmx", ".npy"):
        (folder / f"link{suffix}").symlink_to(tmp_path / f"secret{suffix}")
    (folder / "out").symlink_to(tmp_path)
    return folder


def read(place: Path, text: str, folder: str = ".", **options: Any) -> Any:
    """As a worker process reads the text of a scene that lies in a folder of the served one."""
    private = Path(tempfile.mkdtemp(dir=place.parent))
    mirror = SceneMirror(ServedFolder(place), private, 10**6)
    if "length_unit" not in text:
        text = f'length_unit = "mm"\n{text}'
    with reading_through(mirror):
        scene = parse_scene(text, folder=mirror.place / folder, **options)
        return compile_scene(scene)


@pytest.mark.parametrize("key", KEYS)
def test_no_key_reaches_out(place: Path, key: str) -> None:
    suffix = SUFFIX.get(key, ".stl")
    secret = f"{place.parent.name}/secret{suffix}"
    climb = "../" * 400 + str(place.parent).lstrip("/") + f"/secret{suffix}"
    options = {"variants": ["v"]} if key == "variant" else {}
    assert len(climb) > 1000
    for name in (
        f"../secret{suffix}", f"../../{secret}", str(place.parent / f"secret{suffix}"), climb,
        f"link{suffix}", f"out/secret{suffix}", f"sub/../../secret{suffix}", "x" * 5000 + suffix,
        f"~/secret{suffix}", "/etc/passwd" + suffix, "/dev/zero", f".hidden{suffix}",
    ):  # fmt: skip
        with pytest.raises(OutsideFolder, match="outside the served folder") as refused:
            read(place, KEYS[key].format(file=f"'{name}'"), **options)
        # It says the name that the scene gives, and whether the file exists it does not say
        assert str(place.parent) not in str(refused.value) or str(place.parent) in name
    with pytest.raises(OutsideFolder):
        read(place, KEYS[key].format(file=f"'../../secret{suffix}'"), folder="sub", **options)


def test_files_inside_are_read(place: Path) -> None:
    for key in ("bodies", "title", "variant"):
        options = {"variants": ["v"]} if key == "variant" else {}
        for name, folder in (
            ("inside.stl", "."), ("sub/../inside.stl", "."), ("../inside.stl", "sub"),
            (str(place / "inside.stl"), "."),
        ):  # fmt: skip
            made = read(place, KEYS[key].format(file=f"'{name}'"), folder, **options)
            assert len(made.directory.objects) == 1
    with pytest.raises(SceneError, match="there is no mesh file") as refused:
        read(place, KEYS["bodies"].format(file="'sub/none.stl'"))
    assert "sub/none.stl" in str(refused.value)


def test_titles_are_no_paths(place: Path) -> None:
    assert read(place, f'title = "/etc/passwd"\n{MIRROR_BALL}').directory.title == "/etc/passwd"


def test_files_that_files_name(place: Path) -> None:
    """Materials of OBJ, buffers of glTF, documents of STEP."""
    (place.parent / "secret.bin").write_bytes(b"\0" * 4096)
    (place.parent / "secret.mtl").write_text("newmtl m\nKd 1 0 0\n")
    (place / "a.gltf").write_text(GLTF % "../secret.bin")
    with pytest.raises(SceneError, match="outside the served folder"):
        read(place, KEYS["bodies"].format(file="'a.gltf'"))
    opened = []

    def look(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[0], str | bytes):
            opened.append(os.fsdecode(arguments[0]))

    sys.addaudithook(look)
    (place / "a.obj").write_text(
        "mtllib ../secret.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
        "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    assert read(place, KEYS["bodies"].format(file="'a.obj'")).directory.objects
    assert opened
    assert not any("secret" in name for name in opened)
    (place / "a.step").write_text(
        "ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=DOCUMENT_FILE('/etc/x.stp','','',$,'',$);\n"
        "ENDSEC;\nEND-ISO-10303-21;\n"
    )
    with pytest.raises(SceneError, match="names other files"):
        read(place, KEYS["cad"].format(file="'a.step'"))


GLTF = """{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
"bufferViews": [{"buffer": 0, "byteLength": 36}],
"buffers": [{"uri": "%s", "byteLength": 36}]}"""


def test_archives_and_xml_are_not_read(place: Path) -> None:
    for suffix in (".3mf", ".dae", ".zae", ".xaml", ".zip", ".3dxml"):
        (place / f"a{suffix}").write_bytes(b"PK\3\4")
        with pytest.raises(SceneError, match="not read"):
            read(place, KEYS["bodies"].format(file=f"'a{suffix}'"))


def test_swapped_links(place: Path) -> None:
    """While a file and a folder become links and files again, only what lies inside is read."""
    (place / "sub" / "mesh.stl").write_text("inside")
    (place.parent / "elsewhere").mkdir()
    (place.parent / "elsewhere" / "mesh.stl").write_text("secret")
    folder, done = ServedFolder(place), threading.Event()

    def swap() -> None:
        link, real = place / "link_to", place / "real"
        link.symlink_to(place.parent / "elsewhere")
        while not done.is_set():
            os.rename(place / "sub", real)
            os.rename(link, place / "sub")
            os.rename(place / "sub", link)
            os.rename(real, place / "sub")

    thread = threading.Thread(target=swap)
    thread.start()
    seen = {"inside": 0, "refused": 0}
    try:
        for number in range(400):
            private = place.parent / f"private{number}"
            private.mkdir()
            mirror = SceneMirror(folder, private, 10**6)
            try:
                copy = mirror(mirror.place / "sub" / "mesh.stl")
                text = copy.read_text() if copy.exists() else "refused"
            except RayMapError:
                text = "refused"
            seen[text] += 1
    finally:
        done.set()
        thread.join()
    assert sum(seen.values()) == 400
    assert seen["inside"]
    # A descriptor is compared with what lies inside, whatever its name was when it was opened
    (place / "own.stl").write_text("own")
    with open(place.parent / "elsewhere" / "mesh.stl", "rb") as outer:
        status = os.fstat(outer.fileno())
        assert not folder.same(place / "own.stl", (status.st_dev, status.st_ino))
    status = (place / "own.stl").stat()
    assert folder.same(place / "own.stl", (status.st_dev, status.st_ino))


def test_pipes_and_sizes(place: Path) -> None:
    if hasattr(os, "mkfifo"):
        os.mkfifo(place / "pipe.stl")
        with pytest.raises(OutsideFolder):
            read(place, KEYS["bodies"].format(file="'pipe.stl'"))
    (place / "big.stl").write_bytes(b" " * 2_000_000)
    with pytest.raises(SceneError, match="more than the 1000000 bytes"):
        read(place, KEYS["bodies"].format(file="'big.stl'"))


NAMES = {
    "aim", "angle_weights", "between", "bodies", "cemented", "color", "contacts", "crystal",
    "detectors", "digest", "face", "face_colors", "faces", "files", "folder", "glass", "glasses",
    "illuminant", "inside", "kind", "law", "leave_out", "left_out", "media", "medium", "name",
    "origin", "part", "path", "rim", "simulation", "sources", "specular", "surface",
    "surfaces", "text", "title", "use", "variants", "walls",
}  # fmt: skip
"""Keys of text that name things of the scene, or that no scene file can set."""

FILES = {"file", "picture", "flux"}
"""Keys that name files (``flux``: tables of measurements, which the service does not read)."""


def _models(of: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for model in of.__subclasses__():
        yield model
        yield from _models(model)


def _takes_text(annotation: Any) -> bool:
    return annotation is str or any(_takes_text(item) for item in get_args(annotation))


def test_every_key_of_text_is_known() -> None:
    """Who adds a key that names files asks the door for them, and says so here."""
    for found in pkgutil.walk_packages(tracer.__path__, "tracer."):
        if not found.name.startswith(("tracer.studies", "tracer.cli")):
            importlib.import_module(found.name)
    keys = {
        name
        for model in _models(BaseModel)
        if model.__module__.startswith("tracer.") and "studies" not in model.__module__
        for name, field in model.model_fields.items()
        if _takes_text(field.annotation)
    }
    assert keys <= NAMES | FILES
    assert keys >= FILES


def test_a_reader_that_forgets_to_ask(place: Path) -> None:
    """In a worker process Python opens nothing of the folder but through the door."""
    code = """
import sys, pathlib
sys.path[:] = eval(sys.argv[2])
from service.files.bounds import read_only_from
from service.files.confine import OutsideFolder
from service.files.mirror import SceneMirror
from service.files.confine import ServedFolder
served = pathlib.Path(sys.argv[1]) / "served"
private = pathlib.Path(sys.argv[1]) / "own"
private.mkdir()
mirror = SceneMirror(ServedFolder(served), private, 10**6)
read_only_from(served, [private])
for place in (served / "inside.stl", served.parent / "secret.stl", served / "link.stl", "/etc/hosts"):
    try:
        open(place).close()
    except OutsideFolder as error:
        print("refused", error)
    else:
        print("OPENED", place)
print(mirror(private / "inside.stl").read_text()[:5])
"""  # noqa: E501
    done = subprocess.run(
        [sys.executable, "-c", code, str(place.parent), repr(sys.path)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.count("refused") == 4, done.stdout
    assert "OPENED" not in done.stdout
    assert done.stdout.endswith("solid\n")


def test_without_a_door(tmp_path: Path) -> None:
    assert named_file(tmp_path, "a/b.stl") == tmp_path / "a" / "b.stl"
