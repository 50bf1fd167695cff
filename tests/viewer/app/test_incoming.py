"""Whatever comes through the socket, the session goes on and stays small."""

from __future__ import annotations

import asyncio
import math
import resource
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest

import raymap
from tests.viewer.socket_page import Client
from viewer.app.core import MOST_TASKS
from viewer.app.incoming import fields
from viewer.app.server import RunningServer, run_in_thread
from viewer.drawn.state import ViewState
from viewer.paint.interrupt import Interrupted


@pytest.fixture(scope="module")
def server(map_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        with raymap.open(map_path) as ray_map:
            running = run_in_thread(ray_map, ViewState(rays=20))
            yield running
            running.stop()


def socket_of(server: RunningServer) -> str:
    return f"http://localhost:{server.server.port}/ws"


@asynccontextmanager
async def browser(server: RunningServer) -> AsyncIterator[aiohttp.ClientSession]:
    """The one browser of these tests: it keeps its cookie."""
    async with aiohttp.ClientSession(headers=COOKIES.get(server, {})) as session:
        async with session.get(server.url) as page:
            assert page.status == 200
            if "Set-Cookie" in page.headers:
                COOKIES[server] = {"Cookie": page.headers["Set-Cookie"].partition(";")[0]}
        yield session


COOKIES: dict[RunningServer, dict[str, str]] = {}


def frame(server: RunningServer, script: Any, secret: str) -> Any:
    """A page in the frame of a notebook: without cookie, it says the token in its first message."""

    async def run() -> Any:
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(socket_of(server)) as socket,
        ):
            client = Client(socket)
            await client.hello(secret)
            return await script(client)

    server.browsers.guard.in_notebook = True
    try:
        return asyncio.run(run())
    finally:
        server.browsers.guard.in_notebook = False


def drive(server: RunningServer, script: Any) -> Any:
    async def run() -> Any:
        async with browser(server) as session, session.ws_connect(socket_of(server)) as socket:
            client = Client(socket)
            await client.hello(server.token)
            return await script(client)

    return asyncio.run(run())


WRONG: dict[str, list[Any]] = {
    "numbers": [math.nan, math.inf, -math.inf, 1e300, -1, 10**18, 2**63],
    "others": [None, "x" * 40_000, [1] * 100, {"a": {"b": {}}}, b"\0" * 1000, True, "", "NaN"],
}


def test_every_field_of_the_page_is_bounded(server: RunningServer) -> None:
    state = server.server.state
    before = {key: state[key] for key in fields()}

    async def script(client: Client) -> None:
        for value in (*WRONG["numbers"], *WRONG["others"]):
            await client.call(
                "trame.state.update", [{"key": key, "value": value} for key in fields()]
            )
            kept = {key: state[key] for key in fields()}
            for key, found in kept.items():
                # What was taken is within its bounds: reading it again changes nothing
                assert fields()[key](found) == found, key
                size = len(found) if isinstance(found, str | list | dict) else 0
                assert size <= 4096, key
        assert {item["kind"] for item in state.messages} == {"error"}
        assert all(len(item["text"]) < 600 for item in state.messages)
        await client.call(
            "trame.state.update", [{"key": key, "value": value} for key, value in before.items()]
        )
        assert {key: state[key] for key in fields()} == before
        reply = await client.call("trame.trigger", "rm_frame",
                                  [{"width": 64, "height": 48, "ratio": 1}], {})  # fmt: skip
        assert bytes(reply["image"])[:2] == b"\xff\xd8"

    drive(server, script)


def test_unknown_keys_are_ignored(server: RunningServer) -> None:
    state = server.server.state
    known = set(state.to_dict())
    names = ("version", "map_name", "messages", "detectors", "trame__title", "objects")
    own = {name: state[name] for name in names}

    async def script(client: Client) -> None:
        keys = [*own, *(f"made{n}" for n in range(5000)), "__class__", "trame__vue_use", 7, None]
        await client.call(
            "trame.state.update", [{"key": name, "value": "<script>"} for name in keys]
        )
        for wrong in (None, 3, "x", {"key": "dark"}, [None, 3, [], {"value": 1}]):
            await client.call("trame.state.update", wrong)

    drive(server, script)
    assert set(state.to_dict()) == known
    assert {name: state[name] for name in own} == own


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("rm_frame", [{"width": 10**9, "height": 10**9, "ratio": 1}]),
        ("rm_frame", [{"width": 16_384, "height": 16_384, "ratio": 2}]),
        ("rm_frame", [{"width": 800, "height": 600, "ratio": math.nan}]),
        ("rm_frame", [{"width": 800, "height": 600, "ratio": 1, "zoom": math.nan, "x": 0, "y": 0}]),
        ("rm_frame", [{"width": 800, "height": 600, "ratio": 1, "orbit": [1e15, 1e15]}]),
        ("rm_pick", [{"width": 10**9, "height": 10**9, "x": 0, "y": 0}]),
        ("rm_hover", [{"width": -5, "height": 0, "x": math.inf, "y": 0}]),
        ("rm_scene", [{"width": 10**9, "height": 4}]),
        ("rm_scene", [{"width": 64, "height": 48, "have": {"rays": "x", "?": []}}]),
        ("rm_scene", [{"width": 64, "height": 48, "have": [1]}]),
        ("rm_chunk", ["rays", 10**15, -5]),
        ("rm_chunk", [{}, "x", None]),
        ("rm_eye", [{"width": 64, "height": 48, "camera": None}]),
        ("rm_eye", [{"width": 64, "height": 48, "camera": {"position": [0, 0, 0],
                     "focal_point": [0, 0, 0], "view_up": [0, 1, 0], "height": 1}}]),
        ("rm_hover", [{"width": 64, "height": 48, "x": 1, "y": 1, "camera": [1e300]}]),
        ("rm_export", ["png"]),
        ("rm_load", ['{"width": 1e200}']),
        ("rm_load", ['{"opacities": {"L1": 1e308}}']),
        ("rm_load", ['{"clip": {"after": 1e18}}']),
        ("rm_load", ['{"camera": {"position": [1e200, 0, 0], "focal_point": [0, 0, 0], '
                     '"view_up": [0, 1, 0], "height": 1}}']),
        ("rm_load", ["[" * 500_000]),
        ("rm_load", ["x" * 1_100_000]),
        ("rm_restore", ["A" * 900_000]),
        ("rm_criterion", ["(" * 19_000]),
        ("rm_criterion", ['hit("' + "*a" * 9_000 + '")']),
        ("rm_complete", ['hit("' + "*" * 15_000, 15_000]),
        ("rm_complete", ["hit(", 10**15]),
        ("rm_path", ["toggle", "x" * 19_000]),
        ("rm_ray", ["9" * 5000]),
        ("rm_ray", [math.inf]),
        ("rm_point", [10**14]),
        ("rm_saved", ["save", "n" * 19_000]),
        ("rm_region", [{"shape": "rect", "values": [1e15, 1e15, 1e15, math.nan]}]),
        ("rm_place", [[10**14, 10**14]]),
        ("rm_rays", [10**14]),
        ("rm_opacity", ["nothing", math.nan]),
        ("rm_object", ["x" * 10_000]),
        ("rm_tree", ["count", "0." * 9_000, ">= 1"]),
        ("rm_dismiss", [[[[[[[[1]]]]]]]]),
        ("rm_hover", [[0] * 5000]),
        ("rm_nothing", []),
        ("__init__", []),
        ("rm_frame", {"a": 1}),
        ("rm_cancel", [1, 2, 3]),
    ],
)  # fmt: skip
def test_calls_are_bounded(server: RunningServer, name: str, arguments: Any) -> None:
    async def script(client: Client) -> None:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        began = asyncio.get_running_loop().time()
        await client.call("trame.trigger", name, arguments, {})
        reply = await client.call("trame.trigger", "rm_frame",
                                  [{"width": 64, "height": 48, "ratio": 1}], {})  # fmt: skip
        assert bytes(reply["image"])[:2] == b"\xff\xd8"
        # Not a timed test: a wedged session took minutes and gigabytes
        assert asyncio.get_running_loop().time() - began < 60
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 700_000

    drive(server, script)
    assert all("\n" not in item["text"][:600].strip() or item["kind"] != "error"
               for item in server.server.state.messages)  # fmt: skip
    # The map is asked as before
    answer = server.application.session.map
    assert answer.rays == 1200
    server.application.session.state = ViewState(rays=20)


def test_messages_that_are_none(server: RunningServer) -> None:
    async def script(client: Client) -> None:
        for message in (3, None, [], {"id": 3}, {"id": "x", "method": ["y"]}, {"id": "x"},
                        {"id": "rpc:1", "method": "trame.trigger", "args": 3, "kwargs": []},
                        {"id": "rpc:2", "method": "x" * 500}):  # fmt: skip
            await client.raw(message)
        assert await client.call("application.exit", 1) is not None
        assert (await client.call("trame.lifecycle.update", "x" * 1000)) is None
        await client.call("trame.error.client", "broken\n" * 10_000)
        assert (await client.call("trame.state.get"))["state"]["map_name"] == "small.raymap"

    drive(server, script)

    async def large(client: Client) -> None:
        header = b"\1" * 4 + (0).to_bytes(4, "little") + (2**31).to_bytes(4, "little")
        await client.socket.send_bytes(header + b"x")
        # Other messages of the session may come before the end
        for _ in range(100):
            message = await asyncio.wait_for(client.socket.receive(), 60)
            if message.type != aiohttp.WSMsgType.BINARY:
                break
        assert client.socket.closed

    drive(server, large)


def test_without_token_nothing_is_answered(
    server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def script(client: Client) -> None:
        for method in ("trame.state.get", "trame.trigger", "trame.state.update"):
            found = await client.call(method, "rm_cancel", [], {})
            assert "Unauthorized" in str(found), found

    for wrong in ("", "wslink-secret", server.token[:-1], server.token + "x"):
        frame(server, script, wrong)

    monkeypatch.setattr("viewer.app.incoming._LOGIN_SECONDS", 0.5)

    async def idle(client: Client) -> None:
        message = await asyncio.wait_for(client.socket.receive(), 60)
        assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)

    frame(server, idle, "wrong")

    async def many() -> int:
        where = socket_of(server)
        async with aiohttp.ClientSession() as session:
            refused, sockets = 0, []
            for _ in range(12):
                try:
                    sockets.append(await session.ws_connect(where))
                except aiohttp.WSServerHandshakeError as error:
                    refused += error.status == 503
            for socket in sockets:
                await socket.close()
        return refused

    monkeypatch.setattr("viewer.app.incoming._LOGIN_SECONDS", 60)
    assert asyncio.run(many()) == 0
    server.browsers.guard.in_notebook = True
    try:
        assert asyncio.run(many()) >= 4
    finally:
        server.browsers.guard.in_notebook = False

    async def known(client: Client) -> None:
        assert (await client.call("trame.state.get"))["state"]["map_name"] == "small.raymap"

    frame(server, known, server.token)


def test_a_flood_of_requests_is_left_out(server: RunningServer) -> None:
    async def script(client: Client) -> None:
        for number in range(300):
            asked = ["rm_criterion", [f"length > {number}"], {}]
            await client.raw(
                {
                    "wslink": "1.0",
                    "id": f"rpc:c:x{number}",
                    "method": "trame.trigger",
                    "args": asked,
                }
            )
        await client.call("trame.trigger", "rm_criterion", ["length > 1"], {})
        # Each of them may follow its own search
        assert len(server.application._tasks) <= 2 * MOST_TASKS
        for _ in range(600):
            if not server.application._tasks:
                break
            await asyncio.sleep(0.1)
        assert not server.application._tasks

    drive(server, script)
    assert threading.active_count() < 40


def test_a_picture_that_is_painted_is_given_up_by_the_next_call(
    server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = server.application.session
    own = session.frame
    begun = threading.Event()

    def endless(*size: Any, coarse: bool, cancel: Any) -> bytes:
        if coarse:
            return own(*size, coarse=coarse, cancel=cancel)
        begun.set()
        while not cancel():
            pass
        raise Interrupted

    monkeypatch.setattr(session, "frame", endless)
    size = {"width": 64, "height": 48, "ratio": 1}

    def trigger(name: str, *arguments: Any) -> dict[str, Any]:
        return {"wslink": "1.0", "id": f"rpc:own:{name}", "method": "trame.trigger",
                "args": [f"rm_{name}", list(arguments)], "kwargs": {}}  # fmt: skip

    async def script(client: Client) -> None:
        await client.raw(trigger("frame", size))
        while not begun.is_set():
            await asyncio.sleep(0.01)
        # Its socket takes calls all the while
        await client.raw(trigger("hurry"))
        found: dict[str, Any] = {}
        while len(found) < 2:
            reply = await client.receive()
            if str(reply.get("id")).startswith("rpc:own:"):
                found[reply["id"]] = reply.get("result")
        assert found["rpc:own:frame"] == {"image": None, "coarse": False}
        reply = await client.call("trame.trigger", "rm_frame", [{**size, "coarse": True}], {})
        assert bytes(reply["image"])[:2] == b"\xff\xd8"

    drive(server, script)
