"""Who reaches the application: Host, Origin and token of every request; headers of answers.

The server listens on this machine's own loop, which every page in the browser can reach, too. A
page of a stranger may name this address (cross-site requests) or make its own name point here (DNS
rebinding); other users of the machine may try the port. So each request, whatever it is for, must
name this machine as its host, must not come from a page of another origin, and must carry the token
of the address or the cookie that came with it.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
import secrets
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

__all__ = ["Guard", "inline_script_hashes"]

HOSTS = ("localhost", "127.0.0.1", "::1")
"""This machine by its names; the port may be another, as at the near end of ``ssh -L``."""

NOTEBOOKS = ("http://localhost:*", "http://127.0.0.1:*", "vscode-webview:")
"""Pages that may show the application in a frame when a notebook asked for one."""

WEBSOCKET = "/ws"
MOST_SOCKETS, MOST_WAITING = 64, 8
"""Sockets that may be open, and how many of them without a token."""

_PAGES = ("/", "/index.html")
_PLAIN_ADDRESS = re.compile(r"(http:)?//([A-Za-z0-9.-]*|\[[0-9A-Fa-f:.]*\])(:[0-9]{1,5})?")
_NO_TOKEN = (
    "<!doctype html><title>Raymap</title><body>"
    "<h2>This address lacks its token</h2><p>Open the whole address that <code>raymap view</code> "
    "printed, with <code>?secret=…</code> in it.</p></body>"
)
_NO_ROOM = (
    "<!doctype html><title>Raymap</title><body>"
    "<h2>Other browsers show this map already</h2><p>Each browser has a session of its own, and "
    "all of them are taken: close the page in another browser and wait a minute, or run "
    "<code>raymap view</code> once more.</p></body>"
)


class Guard:
    """Stands before all that the server of one application answers.

    Parameters
    ----------
    token : of the address
    script_hashes : of the scripts that stand in the page itself, as the policy names them

    Attributes
    ----------
    in_notebook : whether pages of a local notebook may show the application in a frame
    """

    def __init__(self, token: str, script_hashes: tuple[str, ...]) -> None:
        self._token = token
        # A name of its own: cookies are shared by all ports of a host
        self._cookie = f"raymap-{secrets.token_hex(4)}"
        self._secret = secrets.token_bytes(32)
        self._scripts = " ".join(f"'{value}'" for value in script_hashes)
        self.in_notebook = False
        self._waiting: Callable[[], int] = lambda: 0
        self._sockets: Callable[[], int] = lambda: 0
        self._has_room: Callable[[str | None], bool] = lambda browser: True

    def watch(
        self,
        *,
        waiting: Callable[[], int],
        sockets: Callable[[], int],
        has_room: Callable[[str | None], bool],
    ) -> None:
        """Learn what there is.

        Parameters
        ----------
        waiting : how many sockets said no token yet
        sockets : how many there are
        has_room : whether a browser, or a new one, may have an application
        """
        self._waiting, self._sockets, self._has_room = waiting, sockets, has_room

    # -- requests --------------------------------------------------------------------------------

    def refusal(self, request: Any) -> tuple[int, str] | None:
        """Status and reason why a request is refused; None if it may pass.

        Parameters
        ----------
        request : of aiohttp
        """
        host = _host(f"//{request.headers.get('Host', '')}")
        if host is None or host[0] not in HOSTS:
            return 421, "this is not the address of this server"
        origin = request.headers.get("Origin")
        if origin is not None and (not origin.startswith("http://") or _host(origin) != host):
            return 403, "pages of other origins may not ask this server"
        if request.method not in ("GET", "HEAD"):
            return 405, "this server only shows"
        known = self.knows(request)
        browser = self.browser(request)
        if request.path == WEBSOCKET:
            if browser is None and not self.in_notebook:
                # Browsers are told apart by their cookies alone
                return 403, "open the page first: it sets the cookie that a socket needs"
            # The frame of a notebook says the token in its first message
            full = self._sockets() >= MOST_SOCKETS or (
                not known and self._waiting() >= MOST_WAITING
            )
            return (503, "too many connections") if full else None
        if known and request.path in _PAGES and not self._has_room(browser):
            return 503, _NO_ROOM
        if known:
            return None
        # The page needed the token and fetches its parts; in a frame it may have no cookie
        own = request.headers.get("Sec-Fetch-Site") == "same-origin"
        return None if own and request.path not in _PAGES else (403, _NO_TOKEN)

    def knows(self, request: Any) -> bool:
        """Whether a request carries the token or the cookie."""
        given = request.query.get("secret", "")
        return self.is_token(given) or self.browser(request) is not None

    def is_token(self, text: object) -> bool:
        """Whether a text is the token, found out in the same time for all."""
        given = text if isinstance(text, str) else ""
        return given.isascii() and secrets.compare_digest(given, self._token)

    def browser(self, request: Any) -> str | None:
        """Which browser asks, by the cookie that this server gave it; None without one."""
        header = str(request.headers.get("Cookie", ""))
        pairs = (part.strip().partition("=") for part in header[:8192].split(";"))
        for name, _, value in pairs:
            if name == self._cookie:
                browser, _, seal = value.partition(".")
                # Bytes that are no text come as half characters; a number of ours has none
                if value.isascii() and secrets.compare_digest(seal, self._seal(browser)):
                    return browser
        return None

    def _seal(self, browser: str) -> str:
        """What nobody else can put behind the number of a browser."""
        return hmac.digest(self._secret, browser.encode(), "sha256").hex()

    # -- answers ---------------------------------------------------------------------------------

    def dress(self, request: Any, response: Any) -> None:
        """Give an answer its headers, and the page its cookie."""
        headers = response.headers
        headers["Content-Security-Policy"] = self.policy(request.headers.get("Host", ""))
        headers["Referrer-Policy"] = "no-referrer"
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Cross-Origin-Resource-Policy"] = "same-origin"
        headers["Cross-Origin-Opener-Policy"] = "same-origin"
        headers["Permissions-Policy"] = "camera=(), microphone=(), geolocation=()"
        headers["Cache-Control"] = "no-store"
        if not self.in_notebook:
            headers["X-Frame-Options"] = "DENY"
        opened = request.path in _PAGES and self.is_token(request.query.get("secret", ""))
        if opened and self.browser(request) is None:
            browser = secrets.token_hex(8)
            value = f"{browser}.{self._seal(browser)}"
            headers["Set-Cookie"] = f"{self._cookie}={value}; Path=/; HttpOnly; SameSite=Strict"

    def policy(self, host: str) -> str:
        """The content security policy of the page.

        Vue compiles the templates of the page in the browser, which takes ``unsafe-eval``; no
        text of a map is ever part of a template. Vuetify writes its colours into style elements.
        """
        named = _host(f"//{host}")
        socket = "" if named is None or named[0] not in HOSTS else f" ws://{host.lower()}"
        frames = " ".join(NOTEBOOKS) if self.in_notebook else "'none'"
        return "; ".join(
            (
                "default-src 'none'",
                f"script-src 'self' 'unsafe-eval' {self._scripts}".rstrip(),
                "style-src 'self' 'unsafe-inline'",
                "img-src 'self' data: blob:",
                "font-src 'self' data:",
                f"connect-src 'self'{socket}",
                "base-uri 'self'",
                "form-action 'none'",
                f"frame-ancestors {frames}",
            )
        )

    def middleware(self) -> Any:
        """The guard as aiohttp takes it."""
        from aiohttp import web

        @web.middleware
        async def check(request: Any, handler: Callable[[Any], Awaitable[Any]]) -> Any:
            refused = self.refusal(request)
            if refused is None:
                return await handler(request)
            status, text = refused
            kind = "text/html" if text.startswith("<") else "text/plain"
            return web.Response(text=text, content_type=kind, status=status)

        return check

    async def before_answer(self, request: Any, response: Any) -> None:
        """What aiohttp calls before it sends any answer, refusals and errors included."""
        self.dress(request, response)


def inline_script_hashes(page: Path) -> tuple[str, ...]:
    """Hashes of the scripts that stand in a page, as a content security policy names them.

    References
    ----------
    W3C, Content Security Policy Level 3, 2.3.1: ``sha256-`` and the base64 of the digest.
    """
    found = re.findall(r"<script>(.*?)</script>", page.read_text(encoding="utf-8"), re.S)
    digests = (hashlib.sha256(text.encode()).digest() for text in found)
    return tuple(f"sha256-{base64.b64encode(digest).decode()}" for digest in digests)


def _host(address: str) -> tuple[str, int | None] | None:
    """Host name and port of an address; None if it is none."""
    try:
        # What urlsplit leaves out, drops or turns into something else is part of no address
        if not _PLAIN_ADDRESS.fullmatch(address):
            return None
        parts = urlsplit(address)
        return (parts.hostname or "").rstrip("."), parts.port
    except ValueError:
        return None
