"""Maps of every kind that answers are tried on, written once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import raymap
from tests.query.random_maps import write_random_map

KINDS: dict[str, dict[str, Any]] = {
    "merged": {"rays": 300, "paths": 60},
    "unfinished": {"rays": 300, "paths": 60, "finish": False},
    "weighted": {"rays": 300, "paths": 60, "weights": True, "gaps": True},
    "split": {"rays": 300, "paths": 60, "weights": True, "emissions": True},
    "plain": {"rays": 200, "plain": True},
}


@pytest.fixture(scope="session")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder: Path = tmp_path_factory.mktemp("answers")
    opened = {
        name: raymap.open(write_random_map(folder / f"{name}.raymap", seed, **options))
        for seed, (name, options) in enumerate(KINDS.items(), 10)
    }
    yield opened
    for map in opened.values():
        map.close()


@pytest.fixture(params=list(KINDS))
def map(request: pytest.FixtureRequest, maps: dict[str, Any]) -> Any:
    return maps[request.param]
