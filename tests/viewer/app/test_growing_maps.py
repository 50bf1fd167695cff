"""A map that is recorded while the application shows it, and that another application looks at."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

import raymap
from tests.viewer.small_map import make_directory, make_portion, rgb_channels
from viewer.app.embedding import make_server
from viewer.app.guard import Guard
from viewer.app.page import Application
from viewer.drawn.state import ViewState


@pytest.mark.parametrize("ends", ["before it watches", "while it answers"])
def test_the_end_is_told_whoever_has_met_it(
    ends: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two applications share an open map: the other one may take its end in at any moment."""
    monkeypatch.setattr("viewer.app.core.REFRESH_SECONDS", 0.01)
    path = tmp_path / "growing.raymap"
    writer = raymap.RayMapWriter.create(path, make_directory())
    writer.add_channel_set(rgb_channels())
    writer.start_run(seed=1, parameters={})
    writer.append(make_portion(100))

    async def run(ray_map: raymap.RayMap) -> None:
        application = Application(make_server(Guard("token", ())), ray_map, ViewState(rays=100))
        answered = []

        async def answer(*_: Any) -> None:
            answered.append(ray_map.rays)
            if ray_map.rays == 250 and not ray_map.finished:
                writer.finish()
                ray_map.refresh()

        monkeypatch.setattr(application, "_answer", answer)
        assert application.page.recording
        if ends == "before it watches":
            writer.append(make_portion(150, 100))
            writer.finish()
            ray_map.refresh()
        else:
            writer.append(make_portion(150, 100))
        application._begin()
        for _ in range(300):
            await asyncio.sleep(0.01)
            if not application.page.recording:
                break
        assert not application.page.recording
        assert application.page.map_rays == "250 rays"
        assert answered[-1] == 250
        application.close()

    with raymap.open(path) as ray_map:
        asyncio.run(run(ray_map))
    writer.close()
