"""Atoms of another distribution: asked, proposed, listed, without a change to the product."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import raymap
from raymap.model.events import Event
from tests.naive.rays import rays_of
from tests.plugins.installing import install, run
from tests.query.random_maps import write_random_map


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "a.raymap"
    write_random_map(path, 5, rays=80, paths=30)
    return path


def test_the_command_answers_with_them(site: Path, map_file: Path) -> None:
    with raymap.open(map_file) as opened:
        rays = list(rays_of(opened))
        names = [item.name for item in opened.directory.objects]
    legs = {}
    for ray in rays:
        points = np.array([point.position for point in ray.points], np.float64)
        if ray.points[-1].event & int(Event.LEFT_SCENE):
            points = points[:-1]
        legs[ray.id] = max(np.linalg.norm(np.diff(points, axis=0), axis=1), default=0.0)
    bound = float(np.median(list(legs.values())))
    long = sorted(number for number, leg in legs.items() if leg > bound)
    first = names.index("L1")
    twice = sorted(
        ray.id for ray in rays if sum(point.object == first for point in ray.points) >= 2
    )
    assert 0 < len(long) < len(rays)
    assert 0 < len(twice) < len(rays)
    for criterion, right in ((f"longest_leg > {bound!r}", long), ('meets_twice("L1")', twice)):
        done = run(site, "-m", "raymap", "query", str(map_file), criterion, "--json")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["ray_ids"] == right


def test_they_are_in_text_json_proposals_and_lists(site: Path) -> None:
    code = """
import json
from query import as_criterion, parse
from tests.viewer.small_map import make_directory
from viewer.panels.completion import complete
from viewer.panels.criterion import choices
from viewer.panels.tree import make_atom, tree_text
directory = make_directory()
tree = parse('!(longest_leg >= 2 cm) & meets_twice("L1")')
text = 'meets_twice("L'
print(json.dumps({
    "printed": str(tree), "same": as_criterion(tree.to_json()) == tree, "json": tree.to_json(),
    "words": [item.text for item in complete("long", 4, directory)[1]],
    "names": [item.text for item in complete(text, len(text), directory)[1]],
    "kinds": [kind["value"] for kind in choices(directory)["atom_kinds"]],
    "built": tree_text(make_atom("meets_twice", "L1")),
}))
"""
    done = run(site, "-c", code)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["printed"] == '!longest_leg >= 2 cm & meets_twice("L1")'
    assert told["same"]
    assert told["json"]["args"][1] == {"op": "meets_twice", "names": ["L1"]}
    assert told["words"] == ["longest_leg"]
    assert "L1" in told["names"]
    assert "meets_twice" in told["kinds"]
    assert told["built"] == 'meets_twice("L1")'


def test_the_table_of_words_says_whose_they_are(site: Path) -> None:
    done = run(site, "-m", "raymap", "kinds", "atoms")
    assert done.returncode == 0, done.stderr
    [line] = [line for line in done.stdout.splitlines() if "longest_leg" in line]
    assert "longest straight piece of the ray" in line
    assert line.endswith("[raymap-example-kinds]")
    assert 'meets_twice("place", ...)' in done.stdout


def test_mistyped_words_of_others_are_hinted_at_and_units_checked(
    site: Path, map_file: Path
) -> None:
    done = run(site, "-m", "raymap", "query", str(map_file), "longest_legg > 3")
    assert done.returncode == 1
    assert "did you mean longest_leg" in done.stderr
    done = run(site, "-m", "raymap", "query", str(map_file), "longest_leg > 3 deg")
    assert done.returncode == 1
    assert "a length is measured in" in done.stderr


@pytest.mark.parametrize(
    ("word", "value", "told"),
    [
        ("wrong", "raymap_example_kinds.nothing:A", "cannot be loaded (ModuleNotFoundError"),
        ("wrong", "raymap_example_kinds.longest_leg:longest_legs", "is no Atom"),
        ("wrong", "raymap_example_kinds.longest_leg:LongestLeg", "is called 'wrong', but its kind"),
        ("hit", "raymap_example_kinds.longest_leg:LongestLeg", "there is a kind 'hit' of"),
    ],
)
def test_one_that_cannot_be_used_is_named_with_a_remedy(
    tmp_path: Path, map_file: Path, word: str, value: str, told: str
) -> None:
    site = install(tmp_path, {"raymap.atoms": {word: value}})
    done = run(site, "-m", "raymap", "query", str(map_file), f"{word} > 1")
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert told in line
    assert "raymap-example-kinds" in line
