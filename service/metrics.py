"""Health and metrics for those who run a service: counts and times, no names, no tokens."""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import raymap
from raymap.model.errors import RayMapError

__all__ = ["Metrics", "MetricsServer"]

_HOSTS = ("localhost", "127.0.0.1")
_TEXT = "text/plain; version=0.0.4; charset=utf-8"
_SOCKET_SECONDS = 10.0
_MOST_CONNECTIONS = 32


class Metrics:
    """Counts of a service, as Prometheus reads them.

    Parameters
    ----------
    gauges : by name, the line that explains it and the function that tells its value
    """

    def __init__(self, gauges: Mapping[str, tuple[str, Callable[[], float]]]) -> None:
        self._gauges = dict(gauges)
        self._requests: Counter[tuple[str, str]] = Counter()
        self._seconds: Counter[str] = Counter()
        self._bytes: Counter[str] = Counter()
        self._running: Counter[str] = Counter()
        self._lock = threading.Lock()
        self.healthy = True

    def begin(self, call: str) -> None:
        """A call begins."""
        with self._lock:
            self._running[call] += 1

    def end(self, call: str, outcome: str | None, seconds: float) -> None:
        """A call has ended; without outcome only a part of it."""
        with self._lock:
            self._running[call] -= 1
            if outcome is not None:
                self._requests[call, outcome] += 1
            self._seconds[call] += seconds  # type: ignore[assignment]

    def refuse(self) -> None:
        """A call without a token was turned away."""
        with self._lock:
            self._requests["", "unauthenticated"] += 1

    def transfer(self, direction: str, size: int) -> None:
        """Bytes were ``sent`` or ``received``."""
        with self._lock:
            self._bytes[direction] += size

    def running(self) -> int:
        """Calls under way."""
        with self._lock:
            return sum(self._running.values())

    def text(self) -> str:
        """All of it in Prometheus' text format, version 0.0.4."""
        lines: list[str] = []

        def family(name: str, kind: str, about: str, rows: Mapping[str, float]) -> None:
            lines.append(f"# HELP raymap_{name} {about}")
            lines.append(f"# TYPE raymap_{name} {kind}")
            lines.extend(f"raymap_{name}{labels} {value:g}" for labels, value in rows.items())

        with self._lock:
            requests = {
                f'{{action="{call}",outcome="{outcome}"}}': number
                for (call, outcome), number in sorted(self._requests.items())
            }
            seconds = {f'{{action="{call}"}}': n for call, n in sorted(self._seconds.items())}
            moved = {f'{{direction="{way}"}}': self._bytes[way] for way in ("received", "sent")}
            running = {f'{{action="{call}"}}': n for call, n in sorted(self._running.items())}
        version = {f'{{version="{raymap.__version__}"}}': 1.0}
        family("info", "gauge", "Version of the service.", version)
        family("requests_total", "counter", "Ended requests by action and outcome.", requests)
        family("request_seconds_total", "counter", "Time that requests took.", seconds)
        family("bytes_total", "counter", "Bytes of requests and answers.", moved)
        family("requests_running", "gauge", "Requests under way, by action.", running)
        for name, (about, value) in self._gauges.items():
            family(name, "gauge", about, {"": value()})
        return "\n".join(lines) + "\n"


class _Server(ThreadingHTTPServer):
    """One thread for each connection, and so many of them; the one that came first gives way."""

    daemon_threads = True
    request_queue_size = _MOST_CONNECTIONS

    def __init__(self, *arguments: Any) -> None:
        self._open: dict[Any, None] = {}
        self._lock = threading.Lock()
        super().__init__(*arguments)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            self._open[request] = None
            oldest = next(iter(self._open)) if len(self._open) > _MOST_CONNECTIONS else None
            self._open.pop(oldest, None)
        if oldest is not None:
            # Its thread reads an end, and closes it
            with suppress(OSError):
                oldest.shutdown(socket.SHUT_RDWR)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing of who went away while it was answered; else the usual."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class MetricsServer:
    """Answers ``/metrics`` and ``/health`` on this machine's own loop.

    Parameters
    ----------
    metrics : what is told
    port : 0 takes a free one

    Raises
    ------
    RayMapError
        The port is taken.
    """

    def __init__(self, metrics: Metrics, port: int) -> None:
        began = time.monotonic()

        class Handler(BaseHTTPRequestHandler):
            timeout = _SOCKET_SECONDS

            def do_GET(self) -> None:
                # A page of another name that was led to this machine is no monitor
                host = self.headers.get("Host", "").rpartition(":")[0]
                if host not in _HOSTS:
                    self._answer(421, "this is not its address\n", _TEXT)
                elif self.path == "/metrics":
                    self._answer(200, metrics.text(), _TEXT)
                elif self.path == "/health":
                    status = "serving" if metrics.healthy else "stopping"
                    told = {"status": status, "seconds": round(time.monotonic() - began, 3)}
                    code = 200 if metrics.healthy else 503
                    self._answer(code, json.dumps(told) + "\n", "application/json")
                else:
                    self._answer(404, "there are /metrics and /health\n", _TEXT)

            def _answer(self, code: int, text: str, kind: str) -> None:
                body = text.encode()
                self.send_response(code)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.send_header("X-Content-Type-Options", "nosniff")
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *arguments: Any) -> None:
                """Nothing: each look would be a line."""

            def version_string(self) -> str:
                return "raymap"

        try:
            self._server = _Server(("127.0.0.1", port), Handler)
        except OSError as error:
            raise RayMapError(
                f"cannot tell metrics at port {port}: {error.strerror}; choose another with "
                "--metrics-port"
            ) from None
        self._thread = threading.Thread(
            target=self._server.serve_forever, name="metrics", daemon=True
        )
        self._thread.start()

    @property
    def address(self) -> str:
        """Where it is told."""
        return f"http://127.0.0.1:{self._server.server_port}"

    def close(self) -> None:
        """End it."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
