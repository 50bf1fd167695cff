"""The application without a browser: what its page calls, and that nothing ends the server."""

from __future__ import annotations

import asyncio
import logging
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import raymap
from query import select
from viewer.app.embedding import make_server
from viewer.app.guard import Guard
from viewer.app.page import Application
from viewer.app.server import RunningServer, run_in_thread
from viewer.drawn.state import ViewState, state_to_address, state_to_json
from viewer.panels.panel import PANELS

GHOST = 'count(hit("L1", reflected)) == 2 & detected("sensor")'


def drive(
    ray_map: raymap.RayMap, script: Callable[[Application, Callable[..., Any]], Any]
) -> Application:
    """Run a script against an application whose server is not started."""

    async def run() -> Application:
        application = Application(make_server(Guard("token", ())), ray_map, ViewState(rays=100))

        async def call(name: str, *arguments: Any) -> Any:
            """What the page does; waits until all that it set off is done."""
            trigger = application.server.controller.trigger_fn(f"rm_{name}")
            answer = await trigger(*arguments)
            while application._tasks:
                await asyncio.wait(list(application._tasks))
            return answer

        try:
            await script(application, call)
        finally:
            application.close()
        return application

    return asyncio.run(run())


def test_a_criterion_goes_through_all_panels(small_map: raymap.RayMap) -> None:
    async def script(app: Application, call: Callable[..., Any]) -> None:
        page = app.page
        await call("criterion", GHOST)
        matched = select(small_map, GHOST).matched
        assert page.answer_text.startswith(f"{matched:,} of")
        assert page.criterion == GHOST
        assert page.recent[0] == GHOST
        assert not page.searching
        await call("criterion", 'hit("nothing")')
        assert "nothing" in page.criterion_error["message"]
        assert page.criterion == GHOST
        reply = await call("frame", {"width": 200, "height": 150, "ratio": 1})
        assert reply["image"][:2] == b"\xff\xd8"
        await call("path", "only", page.path_table[0]["criterion"])
        assert app.session.drawing.rays.n_rays == int(page.path_table[0]["rays"])
        await call("add", "or", "hit", "tube", "absorbed")
        assert page.criterion.endswith('| hit("tube", absorbed)')
        await call("region", {"shape": "rect", "values": [1, 2, 20.04, 14]})
        assert "rect(1, 2, 20, 14)" in page.criterion
        await call("region", None)
        assert "rect" not in page.criterion
        await call("ray", "7")
        assert page.report["facts"][0] == ["Ray", "7"]
        await call("point", 1)
        assert page.report_point is not None
        await call("same_path")
        assert page.criterion.startswith("path(")

    drive(small_map, script)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("frame", [{}]),
        ("frame", [{"width": "wide", "height": 3}]),
        ("frame", [{"width": 1e9, "height": -5, "ratio": 1, "orbit": [1]}]),
        ("pick", [{"width": 10, "height": 10}]),
        ("hover", [None]),
        ("camera", ["upside down"]),
        ("criterion", [None]),
        ("criterion", ["(" * 5000]),
        ("complete", ["hit(", -7]),
        ("restore", ["not a session"]),
        ("load", ["{"]),
        ("load", ['{"rays": -1}']),
        ("rays", ["many"]),
        ("opacity", ["L1", "thick"]),
        ("tree", ["count", "0.0.7", "much"]),
        ("add", ["nor", "smell", "x", ""]),
        ("region", [{"values": [1, 2]}]),
        ("region", [{"values": ["nan", 0, 0, 0]}]),
        ("place", [[10**9, -1]]),
        ("path", ["only", "path("]),
        ("sort", [3]),
        ("ghost", ["7", "9"]),
        ("ray", ["99999999999999999999999"]),
        ("point", ["first"]),
        ("export", ["exe"]),
        ("dismiss", ["x"]),
    ],
)
def test_whatever_a_page_sends_the_application_goes_on(
    small_map: raymap.RayMap, name: str, arguments: list[Any]
) -> None:
    async def script(app: Application, call: Callable[..., Any]) -> None:
        await call(name, *arguments)
        await call("criterion", 'detected("sensor")')
        assert app.page.answer_text.startswith(f"{select(small_map, app.page.criterion).matched:,}")

    drive(small_map, script)


def test_a_long_search_is_stopped_and_a_newer_one_goes_first(
    small_map: raymap.RayMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def script(app: Application, call: Callable[..., Any]) -> None:
        begun: list[float] = []
        answer = app.inquiry.answer

        def slow(cancel: Callable[[], bool], progress: Callable[[Any], None]) -> dict[str, Any]:
            begun.append(time.monotonic())
            while not cancel():
                time.sleep(0.01)
            return answer(lambda: False, progress)

        monkeypatch.setattr(app.inquiry, "answer", slow)
        trigger = app.server.controller.trigger_fn
        await trigger("rm_criterion")('hit("tube")')
        while not begun:
            await asyncio.sleep(0.01)
        assert app.page.searching
        await call("cancel")
        assert not app.page.searching
        await trigger("rm_criterion")('hit("L1")')
        while len(begun) < 2:
            await asyncio.sleep(0.01)
        monkeypatch.setattr(app.inquiry, "answer", answer)
        await call("criterion", GHOST)
        assert app.page.answer_text.startswith(f"{select(small_map, GHOST).matched:,} of")

    drive(small_map, script)


def test_saved_sessions_and_addresses_are_taken(small_map: raymap.RayMap) -> None:
    import json

    async def script(app: Application, call: Callable[..., Any]) -> None:
        state = ViewState(criterion=GHOST, hidden=("tube",), color="source", panel="criterion")
        await call("load", json.dumps(state_to_json(state)))
        assert app.page.criterion == GHOST
        assert app.page.color == "source"
        assert app.page.tree[0]["rays"] == f"{select(small_map, GHOST).matched:,}"
        other = ViewState(criterion='hit("tube")')
        await call("restore", state_to_address(other))
        assert app.session.state == other

    drive(small_map, script)


@pytest.mark.parametrize("gone", ["criterion", "detector", "paths", "report"])
def test_the_application_does_without_a_panel(
    small_map: raymap.RayMap, monkeypatch: pytest.MonkeyPatch, gone: str
) -> None:
    left = [place for place in PANELS._places() if place[2] != gone]
    monkeypatch.setattr(PANELS, "_looked", left)
    monkeypatch.setattr(PANELS, "_known", None)
    monkeypatch.setattr(PANELS, "_listed", None)

    async def script(app: Application, call: Callable[..., Any]) -> None:
        assert [tab["word"] for tab in app.page.panels] == [place[2] for place in left]
        await call("criterion", GHOST)
        assert app.page.answer_text.startswith(f"{select(small_map, GHOST).matched:,} of")
        await call("pick", {"x": 100, "y": 75, "width": 200, "height": 150})
        for kind in PANELS.kinds():
            app.page.panel = kind.word
            await app._take_panel()
        assert not app.page.messages

    drive(small_map, script)


def test_another_session_shows_nothing_of_the_one_before(small_map: raymap.RayMap) -> None:
    async def script(app: Application, call: Callable[..., Any]) -> None:
        await call("ray", "7")
        await call("place", [3, 4])
        await call("restore", state_to_address(ViewState(criterion='hit("tube")')))
        assert app.page.report is None
        assert app.page.report_point is None
        assert app.session.chosen is None
        assert app.page.recent == app.registry.recent[:10]

    drive(small_map, script)


def test_files_are_made(small_map: raymap.RayMap) -> None:
    async def script(app: Application, call: Callable[..., Any]) -> None:
        for kind in ("session", "png", "glb", "vtp"):
            await call("export", kind)
            assert app.page.file["name"].startswith("small.")
            assert len(app.page.file["data"]) > 2 - (kind == "session")

    drive(small_map, script)


def test_the_server_starts_beside_the_program_and_stops(map_path: Any) -> None:
    import urllib.error
    import urllib.request

    with raymap.open(map_path) as ray_map:
        running = RunningServer(ray_map)
        assert running.url.startswith("http://localhost:")
        with urllib.request.urlopen(running.url) as page:
            assert page.status == 200
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(running.url.replace("secret=", "secret=x"))
        assert refused.value.code == 403
        refused.value.close()
        running.stop()
        with pytest.raises(urllib.error.URLError):
            urllib.request.urlopen(running.url)


def test_a_page_that_was_closed_is_no_error(
    map_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with raymap.open(map_path) as ray_map:
        running = run_in_thread(ray_map, ViewState(rays=10))
        logger = logging.getLogger("wslink.protocol")
        for error in (ConnectionResetError("gone"), ValueError("wrong")):
            try:
                raise error
            except Exception as caught:
                logger.error(repr(caught))
        running.stop()
    assert [record.getMessage() for record in caplog.records if record.name == logger.name] == [
        "ValueError('wrong')"
    ]


def test_a_wrong_criterion_is_refused_before_the_application_opens(
    run: Any, map_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(
        "viewer.app.server.serve", lambda _map, *, state, **_: opened.append(state.criterion)
    )
    status, _, said = run("view", map_path, "--no-browser", "-c", "hit(sensor)")
    assert status == 1
    assert said.startswith("error: ")
    assert '"sensor"' in said
    assert not opened
    assert run("view", map_path, "--no-browser", "-c", 'hit("L1")')[0] == 0
    assert opened == ['hit("L1")']


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize("asked", [signal.SIGINT, signal.SIGTERM])
def test_being_asked_to_stop_is_no_failure(map_path: Path, asked: signal.Signals) -> None:
    command = [sys.executable, "-m", "raymap", "view", str(map_path), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stdout is not None
        while b"Ctrl-C" not in (line := running.stdout.readline()):
            assert line
        running.send_signal(asked)
        _, said = running.communicate(timeout=60)
    assert (running.returncode, said) == (0, b"")
