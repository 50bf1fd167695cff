"""Random messages to the application: whatever comes, the session answers afterwards.

    python -m tests.fuzz.fuzz_page [MESSAGES] [SEED]

States of all kinds and sizes for known and unknown keys, calls that exist and calls that do not,
with arguments that fit nothing. After every hundred the page must be painted, and at the end a
criterion answered.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import resource
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import aiohttp

import raymap
from tests.viewer.small_map import write_map
from tests.viewer.socket_page import Client
from viewer.app.incoming import fields
from viewer.app.server import RunningServer, run_in_thread
from viewer.drawn.state import ViewState
from viewer.panels.saved_criteria import CriterionRegistry

__all__ = ["fuzz"]

CALLS = (
    "frame", "pick", "hover", "camera", "criterion", "complete", "cancel", "restore", "load",
    "hello", "rays", "object", "opacity", "tree", "add", "saved", "region", "place", "path", "sort",
    "ghost", "ray", "step_ray", "point", "same_path", "export", "dismiss", "nothing",
)  # fmt: skip
METHODS = (
    "trame.state.get", "trame.lifecycle.update", "trame.error.client", "trame.force.push",
    "application.exit", "file.server", "wslink.hello", "__init__",
)  # fmt: skip
WORDS = (
    'hit("L1")', 'detected("sensor")', 'count(hit("*")) > 1', "(", "all", "fit", "up", "export",
    "rect", "ellipse", "glb", "png", "vtp", "session", "toggle", "flux", "==", "0.1", "and", "not",
    "remove", "L1", "tube", "sensor", "<script>", "{{ 1 }}", "\x1b[2J", "../../etc/passwd", "NaN",
    "__class__", "-1", "é" * 50, "\ud7ff", "",
)  # fmt: skip
NUMBERS = (
    0, 1, -1, 2, 7, 0.5, 1e-300, 1e15, 1e300, -1e300, math.inf, -math.inf, math.nan, 2**31,
    2**63 - 1, 2**64 - 1, -(2**63), 10**9, 65_536,
)  # fmt: skip
FRAME = {"width": 64, "height": 48, "ratio": 1}


def _value(rng: random.Random, depth: int = 0) -> Any:
    kind = rng.randrange(10 if depth < 4 else 7)
    if kind < 2:
        return rng.choice(WORDS)
    if kind < 4:
        return rng.choice(NUMBERS)
    if kind == 4:
        return rng.choice((None, True, False, b"\xff\x00", b""))
    if kind == 5:
        return rng.choice("aé\0<({") * rng.choice((10, 1_000, 30_000))
    if kind == 6:
        deep: Any = 1
        for _ in range(rng.choice((3, 60, 300))):
            deep = [deep] if rng.random() < 0.5 else {"a": deep}
        return deep
    if kind == 7:
        return [_value(rng, depth + 1) for _ in range(rng.choice((0, 1, 2, 3, 400 >> 4 * depth)))]
    names = [*FRAME, "x", "y", "zoom", "orbit", "pan", "coarse", "shape", "values", "key"]
    if rng.random() < 0.01:
        names = [7]
    return {rng.choice(names): _value(rng, depth + 1) for _ in range(rng.randrange(5))}


def _message(rng: random.Random, number: int) -> dict[str, Any]:
    kind = rng.randrange(10)
    if kind < 5:
        keys = [
            *fields(),
            "version",
            "messages",
            "criterion",
            "trame__title",
            "__dict__",
            "made up",
        ]
        changes = [
            {"key": rng.choice(keys), "value": _value(rng)}
            for _ in range(rng.choice((1, 1, 3, 40)))
        ]
        method, arguments = "trame.state.update", [changes]
    elif kind < 9:
        some = [_value(rng) for _ in range(rng.randrange(4))]
        if rng.random() < 0.3:
            some = [{**FRAME, rng.choice(("x", "zoom", "orbit", "width")): _value(rng)}]
        method, arguments = "trame.trigger", [f"rm_{rng.choice(CALLS)}", some, {}]
        if rng.random() < 0.1:
            arguments[rng.randrange(3)] = _value(rng)
    else:
        method, arguments = rng.choice(METHODS), [_value(rng) for _ in range(rng.randrange(3))]
    return {"wslink": "1.0", "id": f"rpc:fuzz:{number}", "method": method, "args": arguments,
            "kwargs": {}}  # fmt: skip


class Closed(Exception):
    """The server has closed the socket."""


class _Reader(Client):
    """Takes answers while it sends, as a browser does."""

    def __init__(self, socket: Any) -> None:
        super().__init__(socket)
        self._answers: dict[str, Any] = {}
        self.ended = False

    async def read(self) -> None:
        """Take what comes, until the socket ends."""
        while not self.ended:
            try:
                found = await self.receive()
            except AssertionError:
                self.ended = True
                return
            name = str(found.get("id"))
            if name.startswith("rpc:c:"):
                self._answers[name] = found.get("result", found.get("error"))

    async def call(self, method: str, *args: Any, **kwargs: Any) -> Any:
        """Send a call and wait for its answer."""
        self.number += 1
        name = f"rpc:c:{self.number}"
        try:
            await self.raw({"wslink": "1.0", "id": name, "method": method, "args": list(args)})
        except ConnectionError:
            self.ended = True
            raise Closed from None
        for _ in range(12_000):
            if name in self._answers:
                return self._answers.pop(name)
            if self.ended:
                raise Closed
            await asyncio.sleep(0.01)
        raise AssertionError(f"{method} was not answered")


async def fuzz(running: RunningServer, messages: int, seed: int) -> tuple[int, int]:
    """Send so many messages.

    Returns
    -------
    How often the page was painted in between, and how often the socket was closed for a message
    that is too large or none, and opened again.

    Raises
    ------
    AssertionError, TimeoutError
        The session did not answer any more.
    """
    rng = random.Random(seed)
    sent = painted = closed = 0
    due = 100
    async with aiohttp.ClientSession() as session:
        async with session.get(running.url) as page:
            cookie = page.headers["Set-Cookie"].partition(";")[0]
        while sent < messages:
            async with _page(session, running, cookie) as client:
                while sent < messages and not client.ended:
                    sent += 1
                    try:
                        await client.raw(_message(rng, sent))
                    except ConnectionError:
                        client.ended = True
                    if sent < due or client.ended:
                        continue
                    # A socket that is closed meanwhile leaves it to the next one
                    with contextlib.suppress(Closed):
                        await _paint(client)
                        painted, due = painted + 1, sent + 100
                closed += client.ended
        async with _page(session, running, cookie) as client:
            await _paint(client)
            await _answer(client)
    return painted, closed


@contextlib.asynccontextmanager
async def _page(
    session: aiohttp.ClientSession, running: RunningServer, cookie: str
) -> AsyncIterator[_Reader]:
    """A socket of the one browser."""
    where = f"http://localhost:{running.server.port}/ws"
    async with session.ws_connect(where, headers={"Cookie": cookie}) as socket:
        client = _Reader(socket)
        await client.hello("")
        reading = asyncio.ensure_future(client.read())
        try:
            yield client
        finally:
            reading.cancel()
            await asyncio.wait([reading])


async def _answer(client: Client) -> None:
    """A criterion, once what is under way has ended."""
    for _ in range(600):
        await client.call("trame.trigger", "rm_load", ["{}"], {})
        await client.call("trame.trigger", "rm_criterion", ['hit("tube")'], {})
        await asyncio.sleep(0.2)
        state = (await client.call("trame.state.get"))["state"]
        if state["answer_text"].startswith("97 of") and not state["searching"]:
            return
    raise AssertionError(f"the criterion was not answered: {state['answer_text']}")


async def _paint(client: Client) -> None:
    # So much may be under way that a call is left out, which the page is told
    for _ in range(600):
        reply = await client.call("trame.trigger", "rm_frame", [FRAME], {})
        if isinstance(reply, dict) and "image" in reply:
            assert bytes(reply["image"])[:2] == b"\xff\xd8"
            return
        await asyncio.sleep(0.1)
    raise AssertionError("the page is not painted any more")


def main(messages: int = 5_000, seed: int = 1) -> None:
    """The command."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_map(Path(folder) / "small.raymap")
        with raymap.open(path) as ray_map:
            running = run_in_thread(ray_map, ViewState(rays=20), registry=CriterionRegistry.empty())
            began = time.monotonic()
            painted, closed = asyncio.run(fuzz(running, messages, seed))
            running.stop()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(
        f"{messages} messages, painted {painted} times in between, {closed} sockets closed and "
        f"opened again, answered at the end; peak {peak:.0f} MB, {time.monotonic() - began:.0f} s"
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
