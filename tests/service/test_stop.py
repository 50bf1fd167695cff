"""Those who run a service see how it goes, and stop it without losing what it does."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

import raymap
from raymap.model.errors import RayMapError
from service import Limits
from service.metrics import MetricsServer
from tests.service.conftest import TOKEN, Starter

LINE = re.compile(r'[a-z_]+(\{[a-z]+="[^"]*"(,[a-z]+="[^"]*")*\})? [0-9.e+-]+')
"""Of Prometheus' text format, version 0.0.4, as its documentation draws it."""


def look(address: str, host: str | None = None) -> tuple[int, str]:
    request = urllib.request.Request(address, headers={} if host is None else {"Host": host})
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def test_many_who_look_at_metrics_and_say_nothing(
    start: Starter, capfd: pytest.CaptureFixture[str]
) -> None:
    """So many threads, and no more; who asks is answered, and who goes away makes no noise."""
    server = MetricsServer(start().metrics, 0)
    place = ("127.0.0.1", int(server.address.rpartition(":")[2]))
    before = threading.active_count()
    with contextlib.ExitStack() as stack:
        for _ in range(100):
            held = stack.enter_context(socket.create_connection(place, timeout=30))
            held.sendall(b"GET /met")
        assert json.loads(look(f"{server.address}/health")[1])["status"] == "serving"
        assert threading.active_count() - before < 50
        for _ in range(30):
            gone = socket.create_connection(place, timeout=30)
            # Closed by a reset
            gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            gone.sendall(b"GET /metrics HTTP/1.0\r\nHost: localhost:1\r\n\r\n")
            gone.close()
        assert look(f"{server.address}/metrics")[0] == 200
    server.close()
    assert capfd.readouterr().err == ""


def test_metrics(start: Starter) -> None:
    service = start(limits=Limits(search_seconds=20, turn_seconds=5))
    server = MetricsServer(service.metrics, 0)
    try:
        with raymap.connect(service.address, token=TOKEN) as client:
            there = client.open("small.raymap")
            for _ in range(3):
                there.query('hit("L1")').matched  # noqa: B018
            with pytest.raises(RayMapError):
                there.query("(((")
        with pytest.raises(RayMapError):
            raymap.connect(service.address, token="wrong")
        status, text = look(f"{server.address}/metrics")
        assert status == 200
        rows = [line for line in text.splitlines() if not line.startswith("#")]
        assert all(LINE.fullmatch(row) for row in rows), rows
        values = dict(row.rsplit(" ", 1) for row in rows)
        assert values['raymap_requests_total{action="hello",outcome="ok"}'] == "1"
        assert values['raymap_requests_total{action="",outcome="unauthenticated"}'] == "1"
        assert float(values['raymap_bytes_total{direction="sent"}']) > 0
        assert values["raymap_maps_open"] == "1"
        assert values["raymap_applications_open"] == "0"
        refused = sum(float(value) for name, value in values.items() if 'outcome="refused"' in name)
        assert refused == 1
        assert all(value == "0" for name, value in values.items() if "_running" in name)
        assert TOKEN not in text
        assert "small" not in text
        assert json.loads(look(f"{server.address}/health")[1])["status"] == "serving"
        assert look(f"{server.address}/metrics", "evil.example")[0] == 421
        assert look(f"{server.address}/")[0] == 404
        service.metrics.healthy = False
        assert look(f"{server.address}/health")[0] == 503
        with pytest.raises(RayMapError, match="--metrics-port"):
            MetricsServer(service.metrics, int(server.address.rpartition(":")[2]))
    finally:
        server.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_recordings_with_a_valid_map(folder: Path, number: int) -> None:
    command = [sys.executable, "-m", "raymap", "serve", str(folder), "--json", "--no-browser",
               "--metrics-port", "0", "--stop-seconds", "60"]  # fmt: skip
    environment = {**os.environ, "RAYMAP_TOKEN": TOKEN}
    began = threading.Event()
    results: list[object] = []
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        killer = threading.Timer(300, process.kill)
        killer.start()
        try:
            assert process.stdout is not None
            said = json.loads(process.stdout.readline())
            assert look(f"{said['metrics']}/health")[0] == 200

            def record() -> None:
                with raymap.connect(said["address"], token=TOKEN) as client:
                    results.append(
                        client.record(
                            "scene.toml", "made.raymap", seconds=200,
                            progress=lambda _: began.set(),
                        )
                    )  # fmt: skip

            running = threading.Thread(target=record)
            running.start()
            assert began.wait(200)
            process.send_signal(number)
            stopped = time.monotonic()
            assert process.wait(100) == 0
            assert time.monotonic() - stopped < 60
            running.join(20)
            assert process.stderr is not None
            assert process.stderr.read() == ""
        finally:
            process.kill()
            killer.cancel()
    assert [result.interrupted for result in results] == [True]
    with raymap.open(folder / "made.raymap") as made:
        assert made.finished
        assert made.rays == results[0].rays > 0


def test_what_does_not_end_is_cut_off_and_said(start: Starter) -> None:
    service = start()
    held = threading.Event()

    def wait_long(request: object, gone: object) -> dict[str, object]:
        held.set()
        while not gone():
            time.sleep(0.01)
        return {}

    service._questions.count = wait_long
    caller = threading.Thread(
        target=lambda: raymap.connect(service.address, token=TOKEN).ask(
            "count", {"map": "small.raymap"}
        )
    )
    caller.start()
    assert held.wait(20)
    began = time.monotonic()
    assert service.calls.stop(lambda: time.monotonic() > began + 0.3) == 1
    caller.join(20)
    assert not caller.is_alive()
    with pytest.raises(RayMapError, match="stopping"):
        raymap.connect(service.address, token=TOKEN)
