"""Maps that the tests of the viewer look at, written once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import raymap
from tests.viewer.small_map import write_map


@pytest.fixture(scope="session")
def map_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_map(tmp_path_factory.mktemp("maps") / "small.raymap")


@pytest.fixture(scope="session")
def small_map(map_path: Path) -> Iterator[raymap.RayMap]:
    with raymap.open(map_path) as ray_map:
        yield ray_map


@pytest.fixture(autouse=True)
def own_configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Recent and saved criteria of the tests stay out of the user's."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
