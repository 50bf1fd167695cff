"""A trame server as the application uses it: bounded messages, no command line, a port or none."""

from __future__ import annotations

import logging
import secrets
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from raymap.model.errors import MissingExtra
from viewer.app.guard import Guard
from viewer.app.incoming import MOST_BYTES, Incoming

__all__ = ["make_server", "page_file", "release", "start", "start_within"]

STATIC = Path(__file__).parents[1] / "static"

_starting = threading.Lock()
"""trame hands a server that starts to its protocol through a variable of the class."""


def make_server(guard: Guard) -> Any:
    """A trame server whose messages are bounded, and need the token or the guard's cookie.

    Raises
    ------
    MissingExtra
        trame is not installed.
    """
    try:
        from trame.app import get_server
    except ImportError as error:
        raise MissingExtra(
            f"the application needs {error.name}, which is not installed: "
            "pip install 'raymap[view]'"
        ) from None
    server = get_server(
        f"raymap-{secrets.token_hex(8)}", client_type="vue3", ws_max_msg_size=MOST_BYTES
    )
    server.enable_module(
        {
            "serve": {"__raymap": str(STATIC)},
            "scripts": [f"__raymap/{name}.js" for name in ("lettering", "scene", "raymap")],
            "styles": ["__raymap/raymap.css"],
            "vue_use": ["RaymapWidgets"],
        }
    )
    incoming = Incoming(server, guard)
    server.controller.on_server_bind.add(incoming.bind)
    # trame's own secret, which nobody is told: the guard knows who may come
    secret = secrets.token_urlsafe(24)
    server.controller.on_server_ready.add(lambda **_: server.protocol.updateSecret(secret))
    server.raymap_incoming = incoming
    return server


def page_file() -> Path:
    """The page that trame serves."""
    from trame_client.module.vue3 import www

    return Path(www) / "index.html"


def release(server: Any) -> None:
    """Let go of a server that has ended: trame keeps each one by its name."""
    from trame.app import core

    core.AVAILABLE_SERVERS.pop(server.name, None)


class _OfClients(logging.Filter):
    """Passes over what is the clients' doing: pages that were closed while something was sent to
    them, requests that are no HTTP. Those would be shown as they came, tokens and all.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        from aiohttp.http_exceptions import HttpProcessingError

        error = record.exc_info[1] if record.exc_info else sys.exc_info()[1]
        return not isinstance(error, ConnectionResetError | HttpProcessingError)


_OF_CLIENTS = _OfClients()


def start(server: Any, port: int) -> Awaitable[None]:
    """The coroutine that serves until it is stopped."""
    for name in ("wslink.protocol", "aiohttp.server"):
        logging.getLogger(name).addFilter(_OF_CLIENTS)
    # trame reads our own command line, too, unless it is hidden
    with _starting:
        arguments, sys.argv = sys.argv, sys.argv[:1]
        try:
            running: Awaitable[None] = server.start(
                port=port,
                host="localhost",
                exec_mode="coroutine",
                open_browser=False,
                show_connection_info=False,
                disable_logging=True,
                timeout=0,
                backend="aiohttp",
                thread=threading.current_thread() is not threading.main_thread(),
            )
        finally:
            sys.argv = arguments
    return running


def start_within(server: Any, port: int) -> Awaitable[None]:
    """As `start`, for a server that gets its sockets from another one, and has no port of its own.

    Parameters
    ----------
    server : of `make_server`
    port : of the other one
    """
    server.controller.on_server_bind.add(lambda web_server: _without_port(web_server, port))
    return start(server, port)


def _without_port(web_server: Any, port: int) -> None:
    async def begin(port_callback: Callable[[int], None]) -> None:
        port_callback(port)
        await web_server.completion

    async def end() -> None:
        for handler in web_server._ws_handlers:
            await handler.disconnectClients()
        if not web_server.completion.done():
            web_server.completion.set_result(True)

    web_server.start, web_server.stop = begin, end
