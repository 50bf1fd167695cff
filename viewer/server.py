"""The server of the application: on this machine only, behind a token in the address."""

from __future__ import annotations

import asyncio
import logging
import os
import secrets
import sys
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from raymap.errors import MissingExtra, RayMapError
from viewer.guard import Guard, inline_script_hashes
from viewer.incoming import MOST_BYTES, Incoming
from viewer.state import ViewState

if TYPE_CHECKING:
    from raymap.reader import RayMap

__all__ = ["RunningServer", "make_server", "run_in_thread", "serve"]

STATIC = Path(__file__).with_name("static")


def make_server(token: str) -> Any:
    """A trame server whose page and data need the token.

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
        f"raymap-{secrets.token_hex(4)}", client_type="vue3", ws_max_msg_size=MOST_BYTES
    )
    server.enable_module(
        {
            "serve": {"__raymap": str(STATIC)},
            "scripts": ["__raymap/raymap.js"],
            "styles": ["__raymap/raymap.css"],
            "vue_use": ["RaymapWidgets"],
        }
    )
    from trame_client.module.vue3 import www

    guard = Guard(token, inline_script_hashes(Path(www) / "index.html"))
    incoming = Incoming(server, guard)

    def bind(web_server: Any) -> None:
        incoming.bind(web_server)
        guard.watch(incoming.sockets, incoming.all_sockets)
        web_server.app.middlewares.append(guard.middleware())
        web_server.app.on_response_prepare.append(guard.before_answer)

    server.controller.on_server_bind.add(bind)
    server.controller.on_server_ready.add(lambda **_: server.protocol.updateSecret(token))
    server.raymap_guard, server.raymap_incoming = guard, incoming
    return server


@contextmanager
def _plain_arguments() -> Iterator[None]:
    """Hide our own command line from trame, which reads it too."""
    arguments, sys.argv = sys.argv, sys.argv[:1]
    try:
        yield
    finally:
        sys.argv = arguments


class _GoneAway(logging.Filter):
    """Passes over pages that were closed while something was sent to them."""

    def filter(self, record: logging.LogRecord) -> bool:
        return not isinstance(sys.exc_info()[1], ConnectionResetError)


_GONE_AWAY = _GoneAway()


def start(server: Any, port: int) -> Any:
    """The coroutine that serves until it is stopped."""
    for name in ("wslink.protocol", "aiohttp.server"):
        logging.getLogger(name).addFilter(_GONE_AWAY)
    with _plain_arguments():
        return server.start(
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


def address(server: Any, token: str, session: str = "") -> str:
    """What to open in the browser."""
    end = f"#{session}" if session else ""
    return f"http://localhost:{server.port}/index.html?secret={token}{end}"


def serve(
    ray_map: RayMap, *, state: ViewState | None = None, port: int = 0, browser: bool = True
) -> None:
    """Serve the application until Ctrl-C.

    Parameters
    ----------
    ray_map : an open map
    state : where to begin
    port : 0 takes a free one
    browser : open the page
    """
    token = secrets.token_urlsafe(18)
    server = make_server(token)
    from viewer.app import Application

    application = Application(server, ray_map, state)

    def ready(**_: Any) -> None:
        url = address(server, token)
        print(f"Raymap shows {ray_map.path} at\n  {url}\nPress Ctrl-C to stop.", flush=True)
        if browser:
            webbrowser.open(url)

    server.controller.on_server_ready.add(ready)
    try:
        asyncio.run(_run(server, application, port))
    except OSError as error:
        raise RayMapError(
            f"cannot serve at port {port}: {os.strerror(error.errno or 0)}; "
            "choose another with --port"
        ) from None


async def _run(server: Any, application: Any, port: int) -> None:
    """Serve, and end the tasks of the application with the server."""
    try:
        await start(server, port)
    finally:
        application.close()


class RunningServer:
    """An application served by a thread of this process.

    Attributes
    ----------
    url : its address, token included
    application : what it serves
    """

    def __init__(self, ray_map: RayMap, state: ViewState | None = None, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(18)
        self.url = ""
        self.application: Any = None
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._arguments = (ray_map, state, port)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._main, name="raymap-view", daemon=True)
        self._thread.start()
        self._ready.wait(60)
        if self._failure is not None:
            raise self._failure

    def _main(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:
            self._failure = error
            self._ready.set()

    async def _serve(self) -> None:
        from viewer.app import Application

        ray_map, state, port = self._arguments
        self._loop = asyncio.get_running_loop()
        self.server = make_server(self.token)
        self.application = Application(self.server, ray_map, state)

        def ready(**_: Any) -> None:
            self.url = address(self.server, self.token)
            self._ready.set()

        self.server.controller.on_server_ready.add(ready)
        await _run(self.server, self.application, port)

    def show(self, height: int = 720) -> None:
        """Show the page: as a frame in a notebook, else in the browser."""
        shell = sys.modules.get("IPython")
        if shell is not None and shell.get_ipython() is not None:
            self.server.raymap_guard.in_notebook = True
            from IPython.display import IFrame, display

            display(IFrame(self.url, width="100%", height=height))  # type: ignore[no-untyped-call]
        else:
            webbrowser.open(self.url)

    def stop(self) -> None:
        """End the server and wait for its thread."""
        if self._loop is not None and self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self.server.stop(), self._loop)
            self._thread.join(10)


def run_in_thread(ray_map: RayMap, state: ViewState | None = None, port: int = 0) -> RunningServer:
    """Serve the application beside the running program (tests, notebooks)."""
    return RunningServer(ray_map, state, port)
