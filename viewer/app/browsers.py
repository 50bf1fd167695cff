"""One address, and for each browser that opens it an application of its own.

trame keeps one state per server. So the server that listens hands each WebSocket to the trame
server of the browser whose cookie it carries. The first browser gets the application that there is
already; further ones get theirs when their page connects, up to a bound.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from viewer.app.core import Render
from viewer.app.embedding import make_server, page_file, release, start, start_within
from viewer.app.guard import WEBSOCKET, Guard, inline_script_hashes
from viewer.app.page import Application
from viewer.drawn.state import ViewState
from viewer.panels.saved_criteria import CriterionRegistry

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["MOST_BROWSERS", "Browsers"]

MOST_BROWSERS = 8
"""That have an application at a time."""

_KEPT_SECONDS = 60.0
"""A page that is loaded again finds its application, if it comes back so soon."""


@dataclass(eq=False)
class _Own:
    """What one browser has."""

    server: Any
    application: Application
    running: asyncio.Task[None] | None = None
    used: float = field(default_factory=time.monotonic)

    def sockets(self) -> int:
        return int(self.server.raymap_incoming.all_sockets())


class Browsers:
    """All applications of one map behind one address.

    Parameters
    ----------
    ray_map : an open map
    state : where each of them begins
    token : of the address
    registry : recent and saved criteria, for the first browser; the user's own unless given
    most : browsers at a time
    render : who draws the scene

    Attributes
    ----------
    guard : stands before all that is answered
    server : the trame server that listens; it is the first browser's
    """

    def __init__(
        self,
        ray_map: RayMap,
        state: ViewState | None,
        token: str,
        *,
        registry: CriterionRegistry | None = None,
        most: int = MOST_BROWSERS,
        render: Render = "auto",
    ) -> None:
        self.map, self.state, self.most, self.render = ray_map, state, most, render
        self.guard = Guard(token, inline_script_hashes(page_file()))
        self._first = self._make(registry)
        self.server = self._first.server
        self._by_browser: dict[str, _Own] = {}
        self.guard.watch(
            waiting=lambda: sum(own.server.raymap_incoming.sockets() for own in self._all()),
            sockets=lambda: sum(own.sockets() for own in self._all()),
            has_room=self._has_room,
        )
        self.server.controller.on_server_bind.add(self._bind)

    @property
    def application(self) -> Application:
        """Of the browser that came first among those whose page is open; else the first of all."""
        return next((own for own in self._all() if own.sockets()), self._first).application

    def __len__(self) -> int:
        """Browsers that have an application."""
        return len(self._by_browser)

    async def run(self, port: int) -> None:
        """Serve until it is stopped.

        Parameters
        ----------
        port : 0 takes a free one
        """
        try:
            await start(self.server, port)
        finally:
            for own in self._all():
                await self._end(own)

    # -- requests --------------------------------------------------------------------------------

    def _bind(self, web_server: Any) -> None:
        web_server.app.middlewares.append(self.guard.middleware())
        web_server.app.middlewares.append(self._middleware())
        web_server.app.on_response_prepare.append(self.guard.before_answer)

    def _middleware(self) -> Any:
        """Hands each socket to the server of its browser, as aiohttp takes it."""
        from aiohttp import web

        @web.middleware
        async def lead(request: Any, handler: Any) -> Any:
            if request.path != WEBSOCKET:
                return await handler(request)
            own = self._own(self.guard.browser(request))
            if own is None:
                return web.Response(text="too many browsers show this map", status=503)
            own.used = time.monotonic()
            try:
                return await own.server._server._ws_handlers[0].handleWsRequest(request)
            finally:
                own.used = time.monotonic()

        return lead

    def _own(self, browser: str | None) -> _Own | None:
        """What a browser has; None where there is no room for it."""
        if browser is None:
            # The frame of a notebook, which shows what the program beside it made
            return self._first
        if browser not in self._by_browser:
            if self._first not in self._by_browser.values():
                self._by_browser[browser] = self._first
            elif not self._has_room(browser):
                return None
            else:
                self._make_room()
                self._by_browser[browser] = self._begin()
        return self._by_browser[browser]

    def _has_room(self, browser: str | None) -> bool:
        """Whether a browser has an application, or can get one."""
        return (
            browser in self._by_browser
            or len(self._by_browser) < self.most
            or self._left() is not None
        )

    def _left(self) -> str | None:
        """The browser that closed its page longest ago; its address holds what it showed."""
        over = time.monotonic() - _KEPT_SECONDS
        left = {
            browser: own.used
            for browser, own in self._by_browser.items()
            if own is not self._first and not own.sockets() and own.used < over
        }
        return min(left, key=lambda browser: left[browser], default=None)

    def _make_room(self) -> None:
        browser = self._left()
        if len(self._by_browser) >= self.most and browser is not None:
            own = self._by_browser.pop(browser)
            asyncio.get_running_loop().create_task(self._end(own))

    # -- applications ----------------------------------------------------------------------------

    def _all(self) -> list[_Own]:
        return list(dict.fromkeys([self._first, *self._by_browser.values()]))

    def _make(self, registry: CriterionRegistry | None) -> _Own:
        server = make_server(self.guard)
        first = getattr(self, "_first", None)
        bodies = None if first is None else first.application.session.painter.bodies
        application = Application(
            server, self.map, self.state, registry=registry, bodies=bodies, render=self.render
        )
        return _Own(server, application)

    def _begin(self) -> _Own:
        """One more application, with criteria of its own."""
        own = self._make(CriterionRegistry.empty())
        running = start_within(own.server, self.server.port)
        own.running = asyncio.ensure_future(running)
        return own

    async def _end(self, own: _Own) -> None:
        own.application.close()
        if own.running is not None:
            await own.server.stop()
        release(own.server)
