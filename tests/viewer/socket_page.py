"""A page of the application made by hand: it speaks through the socket alone."""

from __future__ import annotations

import asyncio
from typing import Any

import aiohttp
import msgpack
from wslink.chunking import generate_chunks

from viewer.app.incoming import MOST_BYTES


class Client:
    """A page made by hand."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.number = socket, 0
        self.state: dict[str, Any] = {}

    async def call(self, method: str, *args: Any, **kwargs: Any) -> Any:
        """Send a call and wait for its answer; states that come meanwhile are kept."""
        self.number += 1
        name = f"rpc:c:{self.number}"
        await self.raw({"wslink": "1.0", "id": name, "method": method, "args": list(args),
                        "kwargs": kwargs})  # fmt: skip
        while True:
            found = await self.receive()
            if found.get("id") == name:
                return found.get("result", found.get("error"))

    async def receive(self) -> dict[str, Any]:
        parts: list[bytes] = []
        while True:
            message = await asyncio.wait_for(self.socket.receive(), 120)
            assert message.type == aiohttp.WSMsgType.BINARY, message
            parts.append(message.data[12:])
            if sum(map(len, parts)) >= int.from_bytes(message.data[8:12], "little"):
                found = msgpack.unpackb(b"".join(parts), strict_map_key=False)
                if "trame.state.topic" in str(found.get("id")):
                    self.state.update(found["result"])
                return dict(found)

    async def raw(self, message: Any) -> None:
        for chunk in generate_chunks(msgpack.packb(message), MOST_BYTES):
            await self.socket.send_bytes(chunk)

    async def hello(self, secret: str) -> Any:
        await self.raw({"wslink": "1.0", "id": "system:c0:0", "method": "wslink.hello",
                        "args": [{"secret": secret}], "kwargs": {}})  # fmt: skip
        return await self.receive()
