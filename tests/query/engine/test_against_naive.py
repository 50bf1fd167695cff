"""Random criteria on random maps: the engine and every shortcut against the row-by-row oracle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

import raymap
from query import parse, select
from query.expression.json_form import from_json
from tests.examples import examples
from tests.naive.interpreter import Interpreter
from tests.naive.rays import rays_of
from tests.query.random_criteria import CRITERIA
from tests.query.random_maps import write_random_map

KINDS: dict[str, dict[str, Any]] = {
    "merged": {},
    "unfinished": {"finish": False},
    "weighted": {"weights": True, "gaps": True, "states": True},
    "split": {"weights": True, "emissions": True},
    "plain": {"plain": True, "states": True},
}


_MAPS: dict[str, Any] = {}
_ORACLES: dict[str, Any] = {}


@pytest.fixture(scope="module", autouse=True)
def _open_maps(tmp_path_factory: pytest.TempPathFactory) -> Any:
    # Kept out of the arguments: Hypothesis would print them.
    folder: Path = tmp_path_factory.mktemp("maps")
    for seed, (name, options) in enumerate(KINDS.items()):
        path = write_random_map(folder / f"{name}.raymap", seed, **options)
        _MAPS[name] = raymap.open(path)
        _ORACLES[name] = Interpreter(_MAPS[name]), rays_of(_MAPS[name])
    yield
    for map in _MAPS.values():
        map.close()


def test_the_maps_are_what_they_should_be() -> None:
    assert _MAPS["merged"].merged is not None
    assert _MAPS["unfinished"].merged is None
    assert {portion.has_paths for portion in _MAPS["plain"].portions} == {True, False}
    assert all(portion.has_weights for portion in _MAPS["weighted"].portions)
    assert all(portion.grouped for portion in _MAPS["split"].portions)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=examples(35))
@given(criterion=CRITERIA)
def test_selects_what_the_oracle_selects(kind: str, criterion: Any) -> None:
    """Every way to the answer against the oracle."""
    map, (oracle, rays) = _MAPS[kind], _ORACLES[kind]
    expected = [ray.id for ray in rays if oracle.ray(criterion, ray)]
    chosen = select(map, criterion, threads=1)
    assert chosen.ray_ids.tolist() == expected
    assert chosen.matched == len(expected)
    # A count alone, several threads, no merged dictionary, a limit: the same answer.
    assert select(map, criterion, rays=False, threads=2).matched == len(expected)
    alone = select(map, criterion, use_merged=False, threads=2)
    assert alone.ray_ids.tolist() == expected
    np.testing.assert_allclose(alone.flux, chosen.flux, rtol=1e-12)
    np.testing.assert_allclose(alone.flux_se, chosen.flux_se, rtol=1e-9)
    few = select(map, criterion, limit=3, threads=2)
    assert few.ray_ids.tolist() == expected[:3]


@settings(max_examples=examples(150))
@given(criterion=CRITERIA)
def test_text_and_json_give_the_same_tree(criterion: Any) -> None:
    assert parse(str(criterion)) == criterion
    assert from_json(criterion.to_json()) == criterion
