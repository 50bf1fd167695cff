"""What pages name and a test cannot reach: schedulers, web servers and services of this machine."""

from __future__ import annotations

import functools
import os
import re
import signal
import subprocess
import sys
import threading
import urllib.request
from contextlib import ExitStack
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import raymap

SCHEDULER = "tcp://host:8786"
WEB = "https://example.org/"
SERVICE = "grpc://localhost:36413"
TOKEN = "0Zx…"
SECRET = "a-token-for-the-tests"


class _Ranges(SimpleHTTPRequestHandler):
    """A web server that serves ranges of bytes, as those of object storage do."""

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        if not path.is_file():
            self.send_error(404)
            return
        data = path.read_bytes()
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        first, last = (int(asked[1]), int(asked[2])) if asked else (0, len(data) - 1)
        body = data[first : last + 1]
        self.send_response(206 if asked else 200)
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Length", str(len(body)))
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{first + len(body) - 1}/{len(data)}")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Silent."""


def web(folder: Path, stack: ExitStack) -> str:
    """A web server of this machine for the files of a folder; its address."""
    server = ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(_Ranges, directory=str(folder))
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    stack.callback(server.server_close)
    stack.callback(server.shutdown)
    return f"http://127.0.0.1:{server.server_address[1]}/"


def served(folder: Path, stack: ExitStack) -> str:
    """A service of this process for the files of a folder; its address. The token is `SECRET`."""
    from service import Limits, RaymapService

    limits = Limits(turn_seconds=30, search_seconds=60, spare_workers=0)
    service = RaymapService(folder, SECRET, threads=1, browser=False, limits=limits)
    thread = threading.Thread(target=service.serve, daemon=True)
    thread.start()
    stack.callback(service.close)
    stack.callback(thread.join, 20)
    stack.callback(service.shutdown)
    return service.address


def outside(text: str, folder: Path, stack: ExitStack) -> str:
    """The text with addresses of this machine in place of those that a page names."""
    if SCHEDULER in text:
        from distributed import LocalCluster

        cluster = stack.enter_context(
            LocalCluster(
                n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0",
                silence_logs=50,
            )
        )  # fmt: skip
        text = text.replace(SCHEDULER, cluster.scheduler_address)
    if WEB in text:
        text = text.replace(WEB, web(folder, stack))
    if SERVICE in text:
        text = text.replace(SERVICE, served(folder, stack)).replace(TOKEN, SECRET)
    return text


def healthy(words: list[str], folder: Path) -> str:
    """Start an application or a service, see that it answers, stop it; what it printed."""
    (folder / "lenses").mkdir(exist_ok=True)
    words = [word.replace("~", str(folder)) for word in words]
    more = ["--no-browser"]
    environment = os.environ | {"HOME": str(folder), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        [sys.executable, "-m", "raymap", *words, *more],
        cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        said = ""
        try:
            for line in process.stdout:
                said += line
                if re.search(r"secret=|Ctrl-C to stop", line):
                    break
            if page := re.search(r"http://\S+", said):
                with urllib.request.urlopen(page[0], timeout=30) as answer:
                    assert answer.status == 200
            elif token := re.search(r'connect\("([^"]+)", token="([^"…]+)"', said):
                with raymap.connect(token[1], token=token[2]) as service:
                    service.files()
        finally:
            process.terminate()
        rest, _ = process.communicate(timeout=60)
        assert process.returncode in (0, 1, -signal.SIGTERM), (process.returncode, said + rest)
    return said
