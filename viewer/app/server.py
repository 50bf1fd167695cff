"""The server of the application: on this machine only, behind a token in the address."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import sys
import threading
import webbrowser
from typing import TYPE_CHECKING, Any

from raymap.model.errors import RayMapError
from viewer.app.browsers import Browsers
from viewer.app.core import Render
from viewer.app.page import Application
from viewer.drawn.state import ViewState
from viewer.panels.saved_criteria import CriterionRegistry

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["RunningServer", "run_in_thread", "serve", "view"]


def address(server: Any, token: str, session: str = "") -> str:
    """What to open in the browser."""
    end = f"#{session}" if session else ""
    return f"http://localhost:{server.port}/index.html?secret={token}{end}"


def serve(
    ray_map: RayMap,
    *,
    state: ViewState | None = None,
    port: int = 0,
    browser: bool = True,
    render: Render = "auto",
) -> None:
    """Serve the application until SIGINT (Ctrl-C) or SIGTERM.

    Parameters
    ----------
    ray_map : an open map
    state : where to begin
    port : 0 takes a free one
    browser : open the page
    render : who draws the scene
    """
    from aiohttp.web_runner import GracefulExit

    token = secrets.token_urlsafe(18)
    browsers = Browsers(ray_map, state, token, render=render)

    def ready(**_: Any) -> None:
        url = address(browsers.server, token)
        print(f"Raymap shows {ray_map.path} at\n  {url}\nPress Ctrl-C to stop.", flush=True)
        if browser:
            webbrowser.open(url)

    browsers.server.controller.on_server_ready.add(ready)
    try:
        # Being asked to stop is how this ends: aiohttp would leave with status 1
        with contextlib.suppress(GracefulExit):
            asyncio.run(browsers.run(port))
    except OSError as error:
        raise RayMapError(
            f"cannot serve at port {port}: {os.strerror(error.errno or 0)}; "
            "choose another with --port"
        ) from None


class RunningServer:
    """The application served by a thread of this process.

    Parameters
    ----------
    ray_map : an open map
    state : where to begin
    port : 0 takes a free one
    registry : recent and saved criteria; the user's own unless given
    render : who draws the scene

    Attributes
    ----------
    url : its address, token included
    browsers : the applications that it serves
    """

    browsers: Browsers

    def __init__(
        self,
        ray_map: RayMap,
        state: ViewState | None = None,
        port: int = 0,
        registry: CriterionRegistry | None = None,
        render: Render = "auto",
    ) -> None:
        self.token = secrets.token_urlsafe(18)
        self.url = ""
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._arguments = (ray_map, state, port, registry, render)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._main, name="raymap-view", daemon=True)
        self._thread.start()
        self._ready.wait(60)
        if self._failure is not None:
            raise self._failure

    @property
    def server(self) -> Any:
        """The trame server that listens."""
        return self.browsers.server

    @property
    def application(self) -> Application:
        """What the browser shows that came first among those that are there."""
        return self.browsers.application

    def _main(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:
            self._failure = error
            self._ready.set()

    async def _serve(self) -> None:
        ray_map, state, port, registry, render = self._arguments
        self._loop = asyncio.get_running_loop()
        self.browsers = Browsers(ray_map, state, self.token, registry=registry, render=render)

        def ready(**_: Any) -> None:
            self.url = address(self.server, self.token)
            self._ready.set()

        self.server.controller.on_server_ready.add(ready)
        await self.browsers.run(port)

    def show(self, height: int = 720) -> None:
        """Show the page: as a frame in a notebook, else in the browser."""
        shell = sys.modules.get("IPython")
        if shell is not None and shell.get_ipython() is not None:
            self.browsers.guard.in_notebook = True
            from IPython.display import IFrame, display

            display(IFrame(self.url, width="100%", height=height))  # type: ignore[no-untyped-call]
        else:
            webbrowser.open(self.url)

    def stop(self) -> None:
        """End the server and wait for its thread."""
        if self._loop is not None and self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self.server.stop(), self._loop)
            self._thread.join(10)


def run_in_thread(
    ray_map: RayMap,
    state: ViewState | None = None,
    port: int = 0,
    registry: CriterionRegistry | None = None,
    render: Render = "auto",
) -> RunningServer:
    """Serve the application beside the running program; the parameters are `RunningServer`'s."""
    return RunningServer(ray_map, state, port, registry, render)


def view(
    map: RayMap, *, state: ViewState | None = None, height: int = 720, render: Render = "auto"
) -> Any:
    """Show the application: inline in a notebook, else in the browser.

    Parameters
    ----------
    map : an open ray map
    state : where to begin
    height : of the frame in a notebook [pixels]
    render : who draws the scene: "client", the page; "server", this program; "auto", the faster

    Returns
    -------
    `RunningServer`; in a notebook it displays itself. `stop()` ends it.
    """
    running = run_in_thread(map, state, render=render)
    running.show(height)
    return running
