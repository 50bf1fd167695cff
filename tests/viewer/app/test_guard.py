"""Who reaches the server of the application, and what its answers forbid a browser."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import http.client
import re
import socket
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import aiohttp
import pytest

import raymap
from viewer.app.guard import inline_script_hashes
from viewer.app.server import RunningServer, run_in_thread
from viewer.drawn.state import ViewState


@pytest.fixture(scope="module")
def server(map_path: Path) -> Iterator[RunningServer]:
    with raymap.open(map_path) as ray_map:
        running = run_in_thread(ray_map, ViewState(rays=20))
        yield running
        running.stop()


def ask(server: RunningServer, path: str, method: str = "GET", **headers: str) -> Any:
    """Status, headers and text of an answer; ``headers`` with _ for -."""
    connection = http.client.HTTPConnection("localhost", server.server.port, timeout=20)
    connection.request(method, path, headers={k.replace("_", "-"): v for k, v in headers.items()})
    answer = connection.getresponse()
    text = answer.read().decode("utf-8", "replace")
    connection.close()
    return answer.status, answer.headers, text


def page(server: RunningServer) -> str:
    return f"/index.html?secret={server.token}"


@cache
def cookie(server: RunningServer) -> str:
    """Of the one browser of most of these tests."""
    return str(ask(server, page(server))[1]["Set-Cookie"].partition(";")[0])


HOSTS = {
    "evil.example": 421, "evil.example:80": 421, "localhost.evil.example": 421, "": 421,
    "127.0.0.1.nip.io": 421, "localhost@evil.example": 421, "0.0.0.0:80": 421, "[::2]:1": 421,
    "@localhost": 421, ":x;script-src *@localhost": 421, "loc\talhost": 421, "localhost/": 421,
    "localhost#": 421, "localhost?": 421, "localhost\\": 421, "localhost:": 421, "[::1": 421,
    "localhost": 200, "localhost:9999": 200, "127.0.0.1:8000": 200, "[::1]:8000": 200,
}  # fmt: skip


@pytest.mark.parametrize("host", HOSTS)
def test_a_name_that_was_led_here_is_refused(server: RunningServer, host: str) -> None:
    """DNS rebinding: the browser asks this server under the stranger's name."""
    assert ask(server, page(server), Host=host)[0] == HOSTS[host]


async def _refused_socket(server: RunningServer, origin: str, **headers: str) -> int:
    async with aiohttp.ClientSession() as session:
        try:
            where = f"http://localhost:{server.server.port}/ws?secret={server.token}"
            async with session.ws_connect(where, headers={"Origin": origin, **headers}):
                return 101
        except aiohttp.WSServerHandshakeError as error:
            return error.status


ORIGINS = (
    "http://evil.example", "null", "http://localhost:1", "https://localhost:{port}", "file://",
    "http://localhost", "http://127.0.0.1:{port}", "http://localhost:{port}.evil.example",
    "http://localhost:{port}@evil.example", "http://user@localhost:{port}",
)  # fmt: skip


@pytest.mark.parametrize("origin", ORIGINS)
def test_pages_of_other_origins_reach_nothing(server: RunningServer, origin: str) -> None:
    import asyncio

    other = origin.replace("{port}", str(server.server.port))
    assert ask(server, page(server), Origin=other)[0] == 403
    assert ask(server, "/__raymap/raymap.js", Origin=other, Cookie=cookie(server))[0] == 403
    # Cross-site WebSockets carry cookies, and no other rule of the browser stops them
    for cookies in ({}, {"Cookie": cookie(server)}):
        assert asyncio.run(_refused_socket(server, other, **cookies)) == 403
    own = f"http://localhost:{server.server.port}"
    assert asyncio.run(_refused_socket(server, own, Cookie=cookie(server))) == 101
    # The token alone does not say which browser it is
    assert asyncio.run(_refused_socket(server, own)) == 403


def test_everything_needs_the_token(server: RunningServer) -> None:
    paths = ["/", "/index.html", "/loading.tpl", "/logo.png", "/__raymap/raymap.js",
             "/vue.global.js", "/nothing", "/../../etc/passwd"]  # fmt: skip
    known = cookie(server)
    name, _, key = known.partition("=")
    for path in paths:
        for wrong in ("", f"{name}=x", f"{name}=", f"x={key}", "; ;=;", f"{name}={key}x",
                      f"{name}=0{key}", f"{name}={key.partition('.')[0]}."):  # fmt: skip
            assert ask(server, path, Cookie=wrong)[0] == 403, path
        assert ask(server, f"{path}?secret=wrong")[0] == 403
        assert ask(server, path, Cookie=known)[0] in (200, 302, 404)
    # A page that was shown fetches its parts, but not itself
    for path in paths[:2]:
        assert ask(server, path, Sec_Fetch_Site="same-origin")[0] == 403
    assert ask(server, "/vue.global.js", Sec_Fetch_Site="same-origin")[0] == 200
    assert ask(server, "/vue.global.js", Sec_Fetch_Site="cross-site")[0] == 403
    assert ask(server, "/vue.global.js", Sec_Fetch_Site="same-site")[0] == 403
    for method in ("POST", "PUT", "DELETE", "OPTIONS", "TRACE"):
        assert ask(server, page(server), method)[0] == 405
    assert server.token not in ask(server, page(server))[2]


def exchange(server: RunningServer, request: bytes) -> bytes:
    """What is answered to bytes that need be no HTTP."""
    with socket.create_connection(("localhost", server.server.port), timeout=20) as raw:
        raw.sendall(request)
        said = b""
        with contextlib.suppress(ConnectionError):
            while part := raw.recv(65536):
                said += part
        return said


def test_bytes_that_are_no_text_and_no_requests(
    server: RunningServer, capfd: pytest.CaptureFixture[str]
) -> None:
    """Refused, and nothing of them on the terminal: a request holds the token."""
    name = cookie(server).partition("=")[0].encode()
    lines = (
        b"GET /index.html HTTP/1.1\r\nCookie: " + name + b"=\xff.\xff",
        b"GET /index.html HTTP/1.1\r\nCookie: " + name + b"=a.\xff",
        b"GET /index.html?secret=%ed%a0%80 HTTP/1.1",
        b"GET /index.html?secret=%ff HTTP/1.1",
    )
    for line in lines:
        said = exchange(server, line + b"\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        assert said.startswith(b"HTTP/1.1 403"), line
    token = server.token.encode()
    for line in (
        b"GET /index.html?secret=" + token + b"\xff HTTP/1.1",
        b"GET /index.html?secret=" + token + b" HTTP/9.x",
        b"GET /index.html?secret=" + token + b" HTTP/1.1\r\nX: " + b"a" * 100_000,
        b"\x16\x03\x01 " + token,
    ):
        said = exchange(server, line + b"\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        assert said.split(b" ")[1] == b"400", line
    assert capfd.readouterr().err == ""


def test_headers_of_every_answer(server: RunningServer) -> None:
    for path in (page(server), "/", "/nothing?secret=" + server.token, "/nothing"):
        _, headers, _ = ask(server, path)
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["X-Frame-Options"] == "DENY"
        assert headers["Cache-Control"] == "no-store"
        policy = dict(part.strip().split(" ", 1) for part in
                      headers["Content-Security-Policy"].split(";"))  # fmt: skip
        assert policy["default-src"] == "'none'"
        assert policy["frame-ancestors"] == "'none'"
        assert "'unsafe-inline'" not in policy["script-src"]
        assert "http" not in policy["script-src"]
    given = ask(server, page(server))[1]["Set-Cookie"]
    assert "HttpOnly" in given
    assert "SameSite=Strict" in given
    assert server.token not in given
    assert "Set-Cookie" not in ask(server, "/")[1]
    assert "Set-Cookie" not in ask(server, page(server) + "x")[1]
    assert "evil" not in ask(server, "/", Host="x; script-src evil")[1]["Content-Security-Policy"]


def test_only_a_notebook_may_frame_it(server: RunningServer) -> None:
    guard = server.browsers.guard
    guard.in_notebook = True
    try:
        _, headers, _ = ask(server, page(server))
        frames = re.search("frame-ancestors ([^;]*)", headers["Content-Security-Policy"])
        assert frames is not None
        assert frames[1].split() == ["http://localhost:*", "http://127.0.0.1:*", "vscode-webview:"]
        assert "X-Frame-Options" not in headers
    finally:
        guard.in_notebook = False


def test_the_pages_own_script_is_named_by_its_hash(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text("<script src='x'></script><script>alert(1)</script>")
    digest = base64.b64encode(hashlib.sha256(b"alert(1)").digest()).decode()
    assert inline_script_hashes(tmp_path / "page.html") == (f"sha256-{digest}",)
