"""A service in this process, and the map and the scene that it serves."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import raymap
from raymap.remote.client import Service
from service import Limits, RaymapService
from tests.scenes import MIRROR_BALL
from tests.viewer.small_map import write_map

TOKEN = "a-token-for-the-tests"


@pytest.fixture(scope="session")
def served_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_map(tmp_path_factory.mktemp("served") / "small.raymap")


@pytest.fixture
def folder(tmp_path: Path, served_map: Path) -> Path:
    """The served folder, with a secret beside it."""
    place = tmp_path / "served"
    place.mkdir()
    (place / "small.raymap").write_bytes(served_map.read_bytes())
    (place / "scene.toml").write_text(MIRROR_BALL)
    (tmp_path / "secret.raymap").write_bytes(served_map.read_bytes())
    return place


Starter = Callable[..., RaymapService]


@pytest.fixture
def start(folder: Path) -> Iterator[Starter]:
    """Starts services and ends them."""
    running: list[tuple[RaymapService, threading.Thread]] = []

    def begin(**options: Any) -> RaymapService:
        limits = options.pop("limits", Limits(turn_seconds=5, search_seconds=60, spare_workers=0))
        options = {"threads": 1, "browser": False, **options}
        service = RaymapService(folder, TOKEN, limits=limits, **options)
        thread = threading.Thread(target=service.serve, daemon=True)
        thread.start()
        running.append((service, thread))
        return service

    yield begin
    for service, thread in running:
        service.shutdown()
        thread.join(20)
        service.close()


@pytest.fixture
def service(start: Starter) -> RaymapService:
    return start()


@pytest.fixture
def client(service: RaymapService) -> Iterator[Service]:
    with raymap.connect(service.address, token=TOKEN) as connected:
        yield connected
