"""Servers that lie: one clear line, in bounded memory and time."""

from __future__ import annotations

import contextlib
import gzip
import threading
import time
import tracemalloc
import zipfile
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

import raymap
from raymap.bytes import chunks, remotebytes, webbytes
from raymap.file.verify import verify
from tests.raymap.maps import write_small

_MOST = 64 * 2**20
_SECONDS = 30.0
_PACKED = gzip.compress(bytes(2**28), 9)


_LENGTHS = {
    "long": str(2**60), "head": str(2**60), "huge": str(10**30), "negative": "-5", "word": "many"
}  # fmt: skip


class _Liar(BaseHTTPRequestHandler):
    """Says what the name of the file asks for."""

    sound = b""

    def log_message(self, *_: Any) -> None:
        pass

    def handle_one_request(self) -> None:
        with contextlib.suppress(OSError):
            super().handle_one_request()

    def do_HEAD(self) -> None:
        self._answer(self.path.strip("/").partition(".")[0], body=False)

    def do_GET(self) -> None:
        self._answer(self.path.strip("/").partition(".")[0], body=True)

    def _answer(self, kind: str, *, body: bool) -> None:
        sound = self.sound
        if kind == "silent":
            time.sleep(3.0)
            return
        if kind in ("loop", "elsewhere"):
            self.send_response(302)
            self.send_header("Location", self.path if kind == "loop" else "file:///etc/passwd")
            self.end_headers()
            return
        if kind == "headers":
            self.send_response(200)
            for number in range(100_000):
                self.send_header(f"X-{number}", "x" * 1000)
                if number % 100 == 0:
                    self.flush_headers()
            self.end_headers()
            return
        asked = self.headers.get("Range")
        size = _LENGTHS.get(kind, str(len(sound)))
        if not body or asked is None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            if not body:
                self.send_header("Content-Length", size)
            self.end_headers()
            if body and kind == "listing":
                while True:
                    self.wfile.write(b'<a href="https://elsewhere.example/x.raymap">x</a>' * 1000)
            return
        start, _, last = asked.removeprefix("bytes=").partition("-")
        n = int(last) + 1 - int(start)
        self.send_response(206)
        if kind == "packed":
            data = _PACKED
            self.send_header("Content-Encoding", "gzip")
        else:
            data = bytes(n) if kind == "long" else sound[int(start) : int(last) + 1]
        if kind == "head":
            data = data[:n].ljust(n, b"\0")
        if kind == "short":
            data = data[:-7]
        if kind not in ("endless", "drip"):
            self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if kind == "endless":
            while True:
                self.wfile.write(bytes(2**16))
        if kind == "drip":
            while True:
                self.wfile.write(b"x")
                time.sleep(0.1)
        self.wfile.write(data)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    path = tmp_path_factory.mktemp("sound") / "a.raymap"
    write_small(path)
    _Liar.sound = path.read_bytes()
    http = ThreadingHTTPServer(("127.0.0.1", 0), _Liar)
    http.daemon_threads = True
    thread = threading.Thread(target=http.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{http.server_address[1]}"
    http.shutdown()
    http.server_close()
    thread.join(5)


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Patience and searches that a test can wait for."""
    monkeypatch.setattr(webbytes, "PATIENCE", 1.0)
    monkeypatch.setattr(webbytes, "SLOWEST", 2**20)
    monkeypatch.setattr(remotebytes, "_PAUSE", 0.01)
    monkeypatch.setattr(chunks, "FAR_SEARCH", 2**22)


def test_a_server_that_tells_the_truth(server: str) -> None:
    with raymap.open(f"{server}/sound.raymap") as found:
        assert found.rays > 0
        assert not verify(found).damage


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("long", "is not a ray map"),
        ("huge", "cannot be read"),
        ("negative", "cannot be read|does not exist|says that it has"),
        ("word", "cannot be read|does not exist"),
        ("endless", "sends the whole file"),
        ("short", "bytes came"),
        ("packed", "sends the whole file|cannot be read"),
        ("drip", "cannot be read"),
        ("silent", "cannot be read|does not exist"),
        ("loop", "cannot be read|does not exist"),
        ("elsewhere", "cannot be read|does not exist"),
        ("headers", "cannot be read|does not exist"),
    ],
)
def test_a_lie_is_one_line(server: str, kind: str, words: str) -> None:
    begin = time.monotonic()
    tracemalloc.start()
    with pytest.raises(raymap.RayMapError, match=words) as found:
        raymap.open(f"{server}/{kind}.raymap")
    assert tracemalloc.get_traced_memory()[1] < _MOST
    tracemalloc.stop()
    assert time.monotonic() - begin < _SECONDS
    assert "\n" not in str(found.value)


def test_a_listing_without_end_is_no_folder(server: str) -> None:
    tracemalloc.start()
    with raymap.open(f"{server}/listing") as found:
        assert found.rays > 0
    assert tracemalloc.get_traced_memory()[1] < _MOST
    tracemalloc.stop()


def test_a_file_that_states_any_length_is_not_searched_to_its_end(server: str) -> None:
    """A sound head, and then zeros as far as the server is asked."""
    begin = time.monotonic()
    with raymap.open(f"{server}/head.raymap", on_damage="skip") as found:
        assert found.rays > 0
        assert found.bytes_read < 2 * chunks.FAR_SEARCH
    assert time.monotonic() - begin < _SECONDS


def test_maps_in_archives_are_refused(tmp_path: Path) -> None:
    write_small(tmp_path / "a.raymap")
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(tmp_path / "a.raymap", "a.raymap")
        archive.writestr("../../outside.raymap", b"x")
    for name in ("a.raymap", "../../outside.raymap"):
        with pytest.raises(raymap.NotARayMap, match="lies in an archive; unpack it"):
            raymap.open(f"zip://{name}::{tmp_path / 'a.zip'}")
