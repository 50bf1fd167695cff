"""A panel of another distribution: its tab, its fields, its actions, without a change to ours."""

from __future__ import annotations

import json
from pathlib import Path

import raymap
from tests.naive.rays import rays_of
from tests.plugins.installing import install, run
from tests.viewer.small_map import write_map

HEAD = """
import asyncio, json, sys
import raymap
from viewer.app.embedding import make_server
from viewer.app.guard import Guard
from viewer.app.incoming import fields
from viewer.app.page import Application
from viewer.drawn.state import ViewState, state_from_json, state_to_json

async def main(ray_map):
    state = state_from_json(json.loads(json.dumps(state_to_json(ViewState(panel="bounces")))))
    app = Application(make_server(Guard("token", ())), ray_map, state)
    async def call(name, *arguments):
        await app.server.controller.trigger_fn("rm_" + name)(*arguments)
        while app._tasks:
            await asyncio.wait(list(app._tasks))
    told = {"panel": app.page.panel, "tabs": [tab["word"] for tab in app.page.panels]}
"""
ACTS = """
    await app.fill_panel(app.stopping)
    told["rows"] = app.page.bounce_rows
    await call("only_bounces", 2)
    told |= {
        "criterion": app.page.criterion, "answer": app.page.answer_text,
        "after": app.page.bounce_rows, "taken": fields()["most_bounces"](""),
    }
    await app.open_ray("7")
    told |= {"ray": app.page.report["facts"][0], "of_ray": app.page.bounces_of_ray}
"""
TAIL = """
    app.close()
    return told

with raymap.open(sys.argv[1]) as opened:
    print(json.dumps(asyncio.run(main(opened))))
"""
OURS = ["criterion", "detector", "paths", "report"]


def test_a_panel_counts_and_selects(tmp_path: Path) -> None:
    site = install(tmp_path / "site")
    path = tmp_path / "small.raymap"
    write_map(path)
    with raymap.open(path) as opened:
        rays = rays_of(opened)
        counts = [max(len(ray.points) - 2, 0) for ray in rays]
    right = [{"number": n, "rays": counts.count(n)} for n in range(4)]
    assert right[2]["rays"] > 0
    done = run(site, "-c", HEAD + ACTS + TAIL, str(path))
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["tabs"] == [*OURS, "bounces"]
    assert told["panel"] == "bounces"
    assert told["rows"] == right
    assert told["criterion"] == "bounces == 2"
    assert told["answer"].startswith(f"{right[2]['rays']:,} of")
    assert [row["rays"] for row in told["after"]] == [0, 0, right[2]["rays"], 0]
    assert told["taken"] == 0
    assert told["ray"] == ["Ray", "7"]
    assert told["of_ray"] == next(n for ray, n in zip(rays, counts, strict=True) if ray.id == 7)


def test_a_session_of_a_panel_that_is_not_installed_opens_with_another(tmp_path: Path) -> None:
    path = tmp_path / "small.raymap"
    write_map(path)
    done = run(tmp_path, "-c", HEAD + TAIL, str(path))
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"panel": "criterion", "tabs": OURS}
