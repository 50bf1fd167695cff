"""Every criterion of the pages is read, printed, translated to JSON and answered on a map."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from query.expression.grammar import parse
from query.expression.json_form import from_json
from raymap import Detector, Directory, Face, Medium, SceneObject, Source, Surface
from raymap.model.events import FAMILIES
from tests.docs.blocks import blocks
from tests.naive.interpreter import Interpreter
from tests.naive.rays import rays_of
from tests.query.random_maps import write_random_map

PAGE = (Path(__file__).parents[3] / "docs" / "criteria.md").read_text(encoding="utf-8")


CRITERIA, TREES = blocks("criteria"), blocks("json")
BLOCKS = [*CRITERIA, *TREES]
EXAMPLES = [line for block in CRITERIA for line in block.text.splitlines() if line.strip()]


def lens(name: str) -> SceneObject:
    faces = [Face(name=f, first_primitive=k, surface=k) for k, f in enumerate(["front", "back"])]
    return SceneObject(name=name, faces=(*faces, Face(name="rim", first_primitive=2, surface=2)))


DIRECTORY = Directory(
    sources=(Source(name="lamp"), Source(name="sun")),
    objects=(
        lens("L1"),
        lens("L2"),
        SceneObject(name="key_1", faces=(Face(name="top", surface=2),)),
        SceneObject(name="mesh", faces=(Face(name="skin", primitive_count=200, surface=2),)),
        SceneObject(name="barrel"),
        SceneObject(name="sensor", faces=(Face(name="face"),)),
    ),
    media=(Medium(name="air"), Medium(name="glass_1")),
    surfaces=(
        Surface(name="clear", parameters={"roughness": 0.0}),
        Surface(name="half", parameters={"roughness": 0.3, "reflectance": 0.05}),
        Surface(name="black", parameters={"roughness": 0.9, "reflectance": 0.02}),
    ),
    detectors=(Detector(name="sensor", cells=(36, 24), size=(6.0, 4.0), object=5),),
)


@pytest.fixture(scope="module")
def map(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    path = tmp_path_factory.mktemp("docs") / "docs.raymap"
    write_random_map(path, 3, rays=80, paths=30, directory=DIRECTORY, states=True)
    with raymap.open(path) as opened:
        yield opened


def test_every_atom_has_an_example() -> None:
    from query.expression.registry import ATOMS

    text = "\n".join(EXAMPLES)
    assert [atom.word for atom in ATOMS.kinds() if not re.search(rf"\b{atom.word}\b", text)] == []


def test_every_event_word_is_on_the_page() -> None:
    assert [word for word in FAMILIES if f"`{word}`" not in PAGE] == []


@pytest.mark.parametrize("text", EXAMPLES)
def test_example(text: str, map: Any) -> None:
    tree = parse(text)
    assert parse(str(tree)) == tree
    assert from_json(json.loads(json.dumps(tree.to_json()))) == tree
    answer = query.select(map, text).ray_ids.tolist()
    if (
        " deg" not in text
        and " rad" not in text
        and " cm" not in text
        and " um" not in text
        and " ns" not in text
    ):
        oracle = Interpreter(map)
        assert answer == [ray.id for ray in rays_of(map) if oracle.ray(tree, ray)]


def test_json_example(map: Any) -> None:
    for block in TREES:
        tree = from_json(json.loads(block.text))
        assert query.select(map, tree).matched == query.select(map, str(tree)).matched
