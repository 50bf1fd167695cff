"""One address, and for each browser an application of its own."""

from __future__ import annotations

import asyncio
import gc
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from trame.app import core

import raymap
from tests.viewer.socket_page import Client
from viewer.app.server import RunningServer, run_in_thread
from viewer.drawn.state import ViewState
from viewer.panels.saved_criteria import CriterionRegistry


async def come(running: RunningServer) -> dict[str, str]:
    """The cookie of a browser that opens the page for the first time."""
    async with aiohttp.ClientSession() as session, session.get(running.url) as page:
        assert page.status == 200
        return {"Cookie": page.headers["Set-Cookie"].partition(";")[0]}


async def talk(
    running: RunningServer, cookie: dict[str, str], script: Callable[[Client], Any]
) -> Any:
    where = f"http://localhost:{running.server.port}/ws"
    async with (
        aiohttp.ClientSession(headers=cookie) as session,
        session.ws_connect(where) as socket,
    ):
        page = Client(socket)
        await page.hello("")
        return await script(page)


async def ask(page: Client, criterion: str) -> None:
    await page.call("trame.trigger", "rm_criterion", [criterion], {})
    while page.state.get("criterion") != criterion:
        await page.call("trame.state.get")
        await asyncio.sleep(0.05)


async def state_of(page: Client) -> dict[str, Any]:
    return dict((await page.call("trame.state.get"))["state"])


def test_what_one_browser_does_no_other_sees(map_path: Path) -> None:
    async def script(running: RunningServer) -> None:
        one, other = await come(running), await come(running)
        assert one != other

        async def first(page: Client) -> None:
            await ask(page, 'hit("tube")')
            await page.call("trame.state.update", [{"key": "width", "value": 3}])

        async def second(page: Client) -> None:
            state = await state_of(page)
            assert (state["criterion"], state["recent"], state["width"]) == ("", [], 1.0)
            await ask(page, 'hit("L1")')

        await talk(running, one, first)
        await talk(running, other, second)
        state = await talk(running, one, state_of)
        assert (state["criterion"], state["width"]) == ('hit("tube")', 3)
        assert state["recent"] == ['hit("tube")']
        assert running.application.session.state.criterion == 'hit("tube")'
        assert (await talk(running, other, state_of))["criterion"] == 'hit("L1")'

    run(map_path, script)


def test_the_number_of_browsers_is_bounded(map_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def script(running: RunningServer) -> None:
        running.browsers.most = 3
        cookies = [await come(running) for _ in range(3)]
        early = await come(running)
        for cookie in cookies:
            await talk(running, cookie, state_of)
        async with aiohttp.ClientSession() as session, session.get(running.url) as page:
            assert page.status == 503
            assert "Other browsers" in await page.text()
        # Who got the page before the last place was taken
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await talk(running, early, state_of)
        assert refused.value.status == 503
        monkeypatch.setattr("viewer.app.browsers._KEPT_SECONDS", 0.0)

        async def stay(page: Client) -> None:
            # The second browser is there, the first one is kept in any case
            gone = weakref.ref(running.browsers._by_browser[number_of(cookies[2])].application)
            await talk(running, early, state_of)
            assert len(running.browsers) == 3
            for _ in range(100):
                gc.collect()
                if gone() is None:
                    break
                await asyncio.sleep(0.05)
            assert gone() is None

        known = len(core.AVAILABLE_SERVERS)
        await talk(running, cookies[1], stay)
        assert len(core.AVAILABLE_SERVERS) == known

    run(map_path, script)


def number_of(cookie: dict[str, str]) -> str:
    return cookie["Cookie"].partition("=")[2].partition(".")[0]


def run(map_path: Path, script: Callable[[RunningServer], Any]) -> None:
    before = len(core.AVAILABLE_SERVERS)
    with raymap.open(map_path) as ray_map:
        running = run_in_thread(ray_map, ViewState(rays=20), registry=CriterionRegistry.empty())
        try:
            asyncio.run(script(running))
        finally:
            running.stop()
    # Nothing of it stays behind
    assert len(core.AVAILABLE_SERVERS) == before


def test_random_messages_wedge_no_session(map_path: Path) -> None:
    """400 of the 5,000 of ``tests/fuzz/fuzz_page.py``."""
    from tests.fuzz.fuzz_page import fuzz

    async def script(running: RunningServer) -> None:
        painted, _ = await fuzz(running, 400, seed=2)
        assert painted >= 1
        assert all(len(item["text"]) < 600 for item in running.server.state.messages)

    run(map_path, script)
