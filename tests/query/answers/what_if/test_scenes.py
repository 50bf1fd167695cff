"""Changes that another scene makes, against the same changes by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from raymap.model.errors import RayMapError
from tests.query.answers.what_if.test_what_if import CASES, CLEAR, SCENE, traced

TEXT = SCENE.replace("UNIT", "W")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with traced(tmp_path_factory.mktemp("base") / "a.raymap", TEXT, 1, rays=4_000) as ray_map:
        yield ray_map


@pytest.mark.parametrize("case", sorted(CASES))
def test_a_scene_says_the_same_changes(recorded: raymap.RayMap, case: str, tmp_path: Path) -> None:
    (old, new), changes = CASES[case]
    path = tmp_path / "new.toml"
    path.write_text(TEXT.replace(old, new, 1))
    for criterion in ('detected("wall")', "wavelength < 500", 'last(hit("screen"))'):
        by_hand, by_scene = (
            query.effect(recorded, view, criterion)
            for view in (query.what_if(recorded, changes), query.what_if(recorded, scene=path))
        )
        assert by_scene.after.flux == pytest.approx(by_hand.after.flux, rel=1e-6)
        assert by_scene.after.se == pytest.approx(by_hand.after.se, rel=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("index = 1.6", "index = 1.61", "another index"),
        ("size = [20, 20, 4]", "size = [20, 20, 5]", "'plate' is another one"),
        ("[bodies.cup]", "[bodies.mug]", "other objects"),
        ("[450, 550, 650]", "[450, 550, 660]", "other wavelengths"),
        ("cells = [4, 4]", "cells = [4, 5]", "'wall' is another one"),
        ('flux_unit = "W"', 'flux_unit = "lm"', "another flux_unit"),
        ("diameter = 2", "diameter = 3", "'beam' is another one"),
        (CLEAR, CLEAR.replace("dielectric", "dialectric"), "dielectric"),
    ],
)
def test_scenes_of_another_geometry_are_refused(
    recorded: raymap.RayMap, old: str, new: str, said: str, tmp_path: Path
) -> None:
    assert old in TEXT
    path = tmp_path / "new.toml"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(RayMapError, match=said) as caught:
        query.what_if(recorded, scene=path)
    assert "\n" not in str(caught.value)
