"""Requests that mean harm, tried against a real server: attack, tried, survived, memory, time.

    python -m tests.service.hostile            # all of it: about ten minutes
    python -m tests.service.hostile --short    # what the test run does

A try is survived when it is refused or bounded as the service promises, and an honest client is
answered while it goes on and afterwards. Peak memory is that of the server's own process (Linux).
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.flight as flight

import raymap
from raymap.model.errors import RayMapError
from raymap.remote.client import Service
from service import Limits, RaymapService
from service.callers.rights import RIGHTS
from service.callers.tokens import TokenFile
from service.server import serve
from tests.scenes import MIRROR_BALL
from tests.service import http2
from tests.service.test_scene_files import CUBE, KEYS, SUFFIX
from tests.viewer.small_map import make_directory, make_portion, rgb_channels

HONEST = "the-honest-client-of-these-attacks"
SECRET = "the-word-that-stands-outside-only"
_ROOT = Path(__file__).parents[2]


# -- the server ------------------------------------------------------------------------------------


def write_large_map(path: Path, portions: int) -> None:
    """A map whose rays are many bytes on the wire: 20,000 rays, again and again."""
    with raymap.RayMapWriter.create(path, make_directory()) as writer:
        writer.add_channel_set(rgb_channels())
        writer.start_run(seed=1, parameters={})
        portion = make_portion(20_000)
        for number in range(portions):
            writer.append(dataclasses.replace(portion, first_ray=20_000 * number))
        writer.finish(statistics={})


class Server:
    """A service in a process of its own.

    Parameters
    ----------
    folder : that it serves
    limits : fields of `Limits`
    """

    def __init__(self, folder: Path, **limits: Any) -> None:
        self.folder, self.limits = folder, Limits(**{"spare_workers": 0, **limits})
        self.tokens = TokenFile(folder.parent / "config" / "tokens.json")
        if not self.tokens.path.exists():
            for number in range(5):
                self.tokens.add(f"spare{number}", frozenset(RIGHTS))
        self.errors = (folder.parent / "stderr.txt").open("a+")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.service.hostile", "--serve", str(folder),
             str(self.tokens.path), json.dumps({"spare_workers": 0, **limits})],
            cwd=_ROOT, stdout=subprocess.PIPE, stderr=self.errors, text=True,
            env={**os.environ, "RAYMAP_TOKEN": HONEST},
        )  # fmt: skip
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the server did not start"
        self.address = str(json.loads(line)["address"])
        self.peak, self._watching = 0, True
        self._watch = threading.Thread(target=self._look, daemon=True)
        self._watch.start()

    def _look(self) -> None:
        while self._watching:
            self.peak = max(self.peak, self.memory())
            time.sleep(0.02)

    def memory(self) -> int:
        """Bytes that the server's process has in memory."""
        with contextlib.suppress(OSError):
            pages = Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]
            return int(pages) * os.sysconf("SC_PAGE_SIZE")
        return 0

    def rests(self) -> bool:
        """Whether it does nothing for somewhat longer than readers may stall."""
        began = self._ticks()
        time.sleep(1.25 * self.limits.stall_seconds)
        return self._ticks() - began < 0.1 * os.sysconf("SC_CLK_TCK")

    def _ticks(self) -> int:
        """Processor time of its process."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return int(fields[11]) + int(fields[12])

    def workers(self) -> list[int]:
        """Processes that do a job for it."""
        found: list[int] = []
        for task in Path(f"/proc/{self.process.pid}/task").glob("*/children"):
            with contextlib.suppress(OSError):
                found += [int(child) for child in task.read_text().split()]
        return found

    def token(self, name: str) -> str:
        """A new token with all rights."""
        with contextlib.suppress(RayMapError):
            self.tokens.remove(name)
        return self.tokens.add(name, frozenset(RIGHTS))

    @contextlib.contextmanager
    def client(self) -> Iterator[Service]:
        with raymap.connect(self.address, token=HONEST) as connected:
            yield connected

    def answers(self) -> bool:
        """Whether a client that means no harm is answered."""
        try:
            with self.client() as client:
                return client.open("large.raymap").query('hit("L1")').matched > 0
        except RayMapError as error:
            print(f"an honest client was told: {error}", file=sys.stderr)
            return False

    def stop(self, number: int = signal.SIGTERM, seconds: float = 120.0) -> int:
        """End it; its exit status."""
        self._watching = False
        self.process.send_signal(number)
        try:
            return self.process.wait(seconds)
        finally:
            self.process.kill()
            self.process.wait()
            assert self.process.stdout is not None
            self.process.stdout.close()
            self.errors.close()


def _serve(folder: str, tokens: str, limits: str) -> None:
    service = RaymapService(
        folder, os.environ["RAYMAP_TOKEN"], limits=Limits(**json.loads(limits)), threads=1,
        browser=False, tokens=TokenFile(Path(tokens)),
    )  # fmt: skip
    print(json.dumps({"address": service.address}), flush=True)
    serve(service, stop_seconds=30.0)


# -- what comes before a token ---------------------------------------------------------------------


def large_messages(server: Server, tries: int) -> tuple[int, int]:
    """600 MB are announced, and sent as long as they are taken."""
    survived = 0
    for _ in range(tries):
        with http2.connect(server.address) as raw:
            said = b""
            with contextlib.suppress(OSError):
                raw.sendall(http2.greeting())
                raw.sendall(http2.frame(http2.HEADERS, http2.END_HEADERS, 1,
                                        http2.headers("DoAction", None)))  # fmt: skip
                begun = http2.message(600_000_000, b"x" * 8192)
                for _ in range(4000):
                    raw.sendall(http2.frame(http2.DATA, 0, 1, begun))
                    begun = b"x" * 16384
            with contextlib.suppress(OSError):
                while part := raw.recv(65536):
                    said += part
        survived += b"are taken at a time" in said or not said
    return tries, survived * server.answers()


def _held(server: Server, kind: int) -> socket.socket:
    """A connection that begins something without a token, and does not go on."""
    begun = [
        b"",
        http2.PREFACE[:10],
        http2.greeting(),
        # Headers that say that more of them follow
        http2.greeting() + http2.frame(http2.HEADERS, 0, 1, http2.headers("DoAction", None)),
        http2.greeting()
        + http2.frame(http2.HEADERS, http2.END_HEADERS, 1, http2.headers("DoPut", None))
        + http2.frame(http2.DATA, 0, 1, http2.message(1000, b"x" * 10)),
    ]
    raw = http2.connect(server.address)
    with contextlib.suppress(OSError):
        raw.sendall(begun[kind])
    return raw


def slow_writers(server: Server, tries: int) -> tuple[int, int]:
    """Connections that begin in five ways and then say nothing, all of them held open."""
    held, survived = [], 0
    for kind in range(5):
        held += [_held(server, kind) for _ in range(tries // 5)]
        survived += tries // 5 * server.answers()
    for raw in held:
        raw.close()
    return len(held), survived


def many_connections(server: Server, tries: int) -> tuple[int, int]:
    """All at once, held open."""
    held = []
    for _ in range(tries):
        with contextlib.suppress(OSError):
            held.append(http2.connect(server.address))
    survived = server.answers()
    for raw in held:
        raw.close()
    return tries, tries * (survived and server.answers())


def many_requests(server: Server, tries: int) -> tuple[int, int]:
    """A thousand requests without token on each of some connections."""
    survived = 0
    for _ in range(tries // 1000):
        with http2.connect(server.address) as raw:
            with contextlib.suppress(OSError):
                raw.sendall(http2.greeting())
                for stream in range(1, 2001, 2):
                    raw.sendall(http2.asks("DoAction", None, b"", stream))
            http2.take_all(raw, 1.0)
        survived += 1000 * server.answers()
    return tries, survived


def given_up_requests(server: Server, tries: int) -> tuple[int, int]:
    """Requests without token that are given up at once, so that none counts as open."""
    given_up, at_a_time = http2.frame(http2.RESET, 0, 1, bytes(4)), 200
    begun = http2.frame(http2.HEADERS, http2.END_HEADERS, 1, http2.headers("DoAction", None))
    sent, before = 0, server.memory()
    while sent < tries:
        with http2.connect(server.address) as raw, contextlib.suppress(OSError):
            raw.sendall(http2.greeting())
            for first in range(0, tries // 10, at_a_time):
                pieces = []
                for number in range(first, first + at_a_time):
                    stream = (2 * number + 1).to_bytes(4, "big")
                    pieces += [begun[:5], stream, begun[9:], given_up[:5], stream, given_up[9:]]
                raw.sendall(b"".join(pieces))
        sent += tries // 10
    bounded = server.peak - before < 100e6
    return tries, tries * bounded * server.answers()


def endless_headers(server: Server, tries: int) -> tuple[int, int]:
    """Headers that go on and on, in frames that are full or empty."""
    survived = 0
    for number in range(tries):
        more = b"\0\1a\x7f\x81\x7c" + b"x" * 16_000 if number % 2 else b""
        going_on = http2.frame(http2.CONTINUATION, 0, 1, more)
        with http2.connect(server.address) as raw:
            with contextlib.suppress(OSError):
                raw.sendall(http2.greeting() + http2.frame(
                    http2.HEADERS, 0, 1, http2.headers("DoAction", None)))  # fmt: skip
                for _ in range(20):
                    raw.sendall(going_on * 1_000)
            survived += http2.take_all(raw, 5.0)[1]
    return tries, survived * server.answers()


def wrong_tokens(server: Server, tries: int) -> tuple[int, int]:
    """Calls with tokens that are none."""
    refused = 0
    with flight.connect(server.address) as plain:
        for number in range(tries):
            token = f"Bearer {HONEST[:-1]}{number}".encode()
            options = flight.FlightCallOptions(headers=[(b"authorization", token)], timeout=60)
            try:
                list(plain.do_action(flight.Action("files", b""), options))
            except flight.FlightUnauthenticatedError:
                refused += 1
    return tries, refused * server.answers()


def nonsense(server: Server, tries: int) -> tuple[int, int]:
    """Random frames behind a right beginning, and random bytes."""
    rng, survived = random.Random(7), 0
    for number in range(tries):
        data = http2.greeting() if number % 4 else b""
        for _ in range(rng.randrange(1, 20)):
            payload = rng.randbytes(rng.randrange(200))
            kind, flags = rng.randrange(12), rng.randrange(256)
            data += http2.frame(kind, flags, rng.choice((0, 1, 3, 2**31 - 1)), payload)
        with contextlib.suppress(OSError), http2.connect(server.address) as raw:
            raw.sendall(data)
            raw.settimeout(0.02)
            raw.recv(1000)
        survived += 1
    return tries, survived * server.answers()


# -- with a token ----------------------------------------------------------------------------------


def _full(server: Server) -> int:
    """Bytes of all rays of the large map on the wire, at least."""
    return 300 * int(raymap.open(server.folder / "large.raymap").rays)


def stalled_readers(server: Server, tries: int) -> tuple[int, int]:
    """All rays are asked for, with windows as wide as they can be; then nothing is read."""
    names = [server.token(f"reader{number}") for number in range(-(-tries // 12))]
    held = []
    for number in range(tries):
        raw = http2.connect(server.address, narrow=True)
        wanted = http2.ticket({"get": "rays", "map": "large.raymap"})
        raw.sendall(http2.greeting() + http2.asks("DoGet", names[number // 12], wanted))
        held.append(raw)
    answered = server.answers()
    # Streams wait for their searches before they stall
    _wait(server.rests, 10 * server.limits.stall_seconds)
    answered &= server.answers()
    survived = cut = 0
    for raw in held:
        taken, ended = http2.take_all(raw, 3.0)
        cut += ended
        survived += taken < _full(server) / 2
        raw.close()
    # Those that were let in were cut off, the others were told to come later
    assert cut >= min(tries, server.limits.client_streams), f"{cut} were cut off"
    return tries, survived * answered


def stalled_writers(server: Server, tries: int) -> tuple[int, int]:
    """Uploads that stop within a message."""
    token, held = server.token("writer"), []
    for _ in range(tries):
        raw = http2.connect(server.address)
        raw.sendall(
            http2.greeting()
            + http2.frame(http2.HEADERS, http2.END_HEADERS, 1, http2.headers("DoPut", token))
            + http2.frame(http2.DATA, 0, 1, http2.message(1_000_000, b"x" * 100))
        )
        held.append(raw)
    answered, cut = server.answers(), 0
    end = time.monotonic() + 2 * server.limits.stall_seconds + 5
    for raw in held:
        cut += http2.take_all(raw, max(0.5, end - time.monotonic()))[1]
        raw.close()
    return tries, cut * answered


def withdrawn_tokens(server: Server, tries: int) -> tuple[int, int]:
    """A token is withdrawn while it gets all rays."""
    survived = 0
    for number in range(tries):
        token = server.token(f"leaver{number}")
        with http2.connect(server.address, narrow=True) as raw:
            wanted = http2.ticket({"get": "rays", "map": "large.raymap"})
            raw.sendall(http2.greeting() + http2.asks("DoGet", token, wanted))
            raw.recv(100)
            server.tokens.remove(f"leaver{number}")
            time.sleep(1.5)
            survived += http2.take_all(raw, 5.0)[0] < _full(server) / 2
    return tries, survived * server.answers()


def _json_depth(levels: int) -> dict[str, Any]:
    tree: dict[str, Any] = {"op": "hit", "name": "L1"}
    for _ in range(levels):
        tree = {"op": "not", "args": [tree]}
    return tree


CRITERIA: list[Any] = [
    'hit("' + "*a" * 150 + '")',
    'hit("' + "*" * 15_000 + '")',
    'hit("' + "?*" * 5_000 + 'x")',
    'hit("*.' + "*b" * 500 + '")',
    'path("' + "(.*)*" * 100 + 'x")',
    'path("' + "(" * 500 + "." + ")*" * 500 + '")',
    'path("' + "(a|b|.)*" * 200 + '")',
    'path("' + ".{1,1000}" * 50 + '")',
    "(" * 9_000 + 'hit("L1")' + ")" * 9_000,
    "!" * 19_000 + 'hit("L1")',
    " -> ".join(['hit("*")'] * 1_000),
    " & ".join(['hit("L1")'] * 1_900),
    "count(" * 3_000 + 'hit("L1")' + ") > 0" * 3_000,
    'count(hit("*")) >= 1' + "0" * 10_000,
    "length > 1e999",
    "x" * 21_000,
    "\0" * 1_000,
    "{" * 10_000,
    _json_depth(2_000),
    {"op": "and", "args": [{"op": "hit", "name": "L1"}] * 50_000},
]


def hostile_criteria(server: Server, tries: int) -> tuple[int, int]:
    """Stars, path expressions and trees that are deep, wide or long, asked and read."""
    survived = 0
    with server.client() as client:
        for criterion in CRITERIA[:tries]:
            for action in ("count", "criterion"):
                began = time.monotonic()
                with contextlib.suppress(RayMapError):
                    client.ask(action, {"map": "large.raymap", "criterion": criterion})
                survived += time.monotonic() - began < 30.0
    return 2 * len(CRITERIA[:tries]), survived * server.answers()


def large_pictures(server: Server, tries: int) -> tuple[int, int]:
    """Pictures of up to 10⁹ × 10⁹ pixels."""
    sizes = [(10**9, 10**9), (2**62, 1), (1, 2**62), (-1, 5), (32_768, 32_768), (10**30, 1)]
    refused = 0
    with server.client() as client:
        for width, height in sizes[:tries]:
            asked = {"map": "large.raymap", "width": width, "height": height}
            try:
                client.stream("picture", asked).read_all()
            except RayMapError:
                refused += 1
    return len(sizes[:tries]), refused * server.answers()


def unbounded_recordings(server: Server, tries: int) -> tuple[int, int]:
    """Rays and seconds without end."""
    wanted: list[dict[str, Any]] = [
        {"rays": 10**18}, {"rays": -1}, {"rays": 1e300}, {"seconds": 1e300}, {"seconds": -1},
        {"rays": True}, {"seconds": "1"}, {"rays": 2**70}, {"seed": 2**64}, {"rays": [1]},
    ]  # fmt: skip
    refused = 0
    with server.client() as client:
        for asked in wanted[:tries]:
            try:
                client.ask("record", {"text": MIRROR_BALL, "map": "endless.raymap", **asked})
            except RayMapError:
                refused += not (server.folder / "endless.raymap").exists()
    return len(wanted[:tries]), refused * server.answers()


def uploads_beyond_the_quota(server: Server, tries: int) -> tuple[int, int]:
    """Uploads until there is no room; then the service is started anew and asked again."""
    refused = 0
    with server.client() as client:
        for number in range(100):
            if _is_refused(client, f"filler{number}.stl"):
                break
        for number in range(tries // 2):
            refused += _is_refused(client, f"more{number}.stl")
    again = Server(server.folder, **_options(server))
    try:
        with again.client() as client:
            for number in range(tries - tries // 2):
                refused += _is_refused(client, f"again{number}.stl")
    finally:
        again.stop()
    for path in server.folder.glob("*.stl"):
        path.unlink()
    return tries, refused * server.answers()


def _options(server: Server) -> dict[str, Any]:
    """What differs from the limits that a service has by default."""
    default = vars(Limits())
    return {name: value for name, value in vars(server.limits).items() if value != default[name]}


def _is_refused(client: Service, name: str) -> bool:
    try:
        client.upload_text("x" * 4_000_000, name)
    except RayMapError as error:
        return "no room" in str(error)
    return False


# -- worker processes ------------------------------------------------------------------------------


def scenes_reaching_out(server: Server, tries: int) -> tuple[int, int]:
    """Each key of a scene that names a file, with paths that leave the folder in all ways."""
    outside = server.folder.parent
    refused = tried = 0
    with server.client() as client:
        for key, text in KEYS.items():
            suffix = SUFFIX.get(key, ".stl")
            secret = outside / f"secret{suffix}"
            secret.write_text(CUBE.replace("solid s", f"solid {SECRET}"))
            link = server.folder / f"link{suffix}"
            link.unlink(missing_ok=True)
            link.symlink_to(secret)
            names = [
                str(secret), f"../secret{suffix}", link.name, f"file://{secret}",
                "./" * 600 + f"../secret{suffix}", f"x/../../secret{suffix}",
            ]  # fmt: skip
            for name in names:
                if tried == tries:
                    break
                tried += 1
                asked = text.replace("{file}", json.dumps(name)).replace("{{", "{")
                asked = asked.replace("}}", "}")
                variants = {"variants": ["v"]} if "variants" in asked else {}
                try:
                    client.ask("scene", {"text": asked, **variants})
                except RayMapError as error:
                    said = str(error)
                    # What the client itself wrote may stand there
                    told = said.replace(str(secret), "")
                    refused += SECRET not in told and str(outside) not in told
                else:
                    print(f"read {key} {name[:40]}", file=sys.stderr)
            link.unlink()
    return tried, refused * server.answers()


def _recording(server: Server, name: str) -> tuple[threading.Thread, list[Any]]:
    """A client that records for ever, and what it was told in the end."""
    said: list[Any] = []
    (server.folder / name).unlink(missing_ok=True)

    def record() -> None:
        try:
            with server.client() as client:
                said.append(client.record("scene.toml", name, rays=10**10, force=True))
        except RayMapError as error:
            said.append(error)

    running = threading.Thread(target=record)
    running.start()
    _wait(lambda: _size(server.folder / name) > 500_000 or not running.is_alive(), 200.0)
    return running, said


def _size(path: Path) -> int:
    with contextlib.suppress(OSError):
        return path.stat().st_size
    return 0


def _wait(done: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.05)
    return done()


def _is_sound(path: Path) -> bool:
    with raymap.open(path, on_damage="skip") as found:
        return bool(found.rays > 0)


def killed_workers(server: Server, tries: int) -> tuple[int, int]:
    """The process that records is killed from outside."""
    survived = 0
    for _ in range(tries):
        running, said = _recording(server, "killed.raymap")
        for worker in server.workers():
            os.kill(worker, signal.SIGKILL)
        running.join(60)
        told = bool(said) and isinstance(said[0], RayMapError) and "SIGKILL" in str(said[0])
        survived += told and _is_sound(server.folder / "killed.raymap")
        (server.folder / "killed.raymap").unlink(missing_ok=True)
    return tries, survived * server.answers()


def clients_that_go(server: Server, tries: int) -> tuple[int, int]:
    """Clients leave while their recording is traced, compiled, or its files are read."""
    token, survived = server.token("goer"), 0
    for number in range(tries):
        body = json.dumps({"scene": "scene.toml", "map": "gone.raymap", "rays": 10**10,
                           "force": True}).encode()  # fmt: skip
        kind = b"record"
        content = b"\x0a" + http2._varint(len(kind)) + kind
        content += b"\x12" + http2._varint(len(body)) + body
        raw = http2.connect(server.address)
        raw.sendall(http2.greeting() + http2.asks("DoAction", token, content))
        _wait(lambda: bool(server.workers()), 30.0)
        if number % 2:
            _wait(lambda: _size(server.folder / "gone.raymap") > 100_000, 120.0)
        raw.close()
        survived += _wait(lambda: not server.workers(), server.limits.end_seconds + 15)
        (server.folder / "gone.raymap").unlink(missing_ok=True)
    return tries, survived * server.answers()


def full_disks(server: Server, tries: int) -> tuple[int, int]:
    """Recordings that go on until the quota is used up."""
    survived = 0
    for _ in range(tries):
        running, said = _recording(server, "full.raymap")
        running.join(300)
        target = server.folder / "full.raymap"
        most = server.limits.disk_bytes + 2**20
        told = bool(said) and (isinstance(said[0], RayMapError) or said[0].interrupted)
        survived += told and _size(target) < most and _is_sound(target)
        target.unlink(missing_ok=True)
    return tries, survived * server.answers()


def full_memory(folder: Path, tries: int) -> tuple[int, int, int]:
    """Scenes that need more memory than a process may use."""
    server = Server(folder, memory_bytes=2**27, disk_bytes=2**34)
    survived = 0
    try:
        with server.client() as client:
            for _ in range(tries):
                try:
                    client.record("scene.toml", "memory.raymap", rays=10**9, force=True)
                except RayMapError as error:
                    survived += "MiB of memory" in str(error)
        survived *= server.answers() and not server.workers()
    finally:
        server.stop()
    return tries, survived, server.peak


def endless_requests(folder: Path, tries: int) -> tuple[int, int, int]:
    """Reading and recording that go on beyond their deadline."""
    server = Server(folder, scene_seconds=0.5, record_seconds=15.0)
    survived = tried = 0
    try:
        with server.client() as client:
            for _ in range(tries):
                tried += 2
                try:
                    client.ask("scene", {"text": MIRROR_BALL})
                except RayMapError as error:
                    survived += "--scene-seconds" in str(error)
                with contextlib.suppress(RayMapError):
                    done = client.record("scene.toml", "endless.raymap", rays=10**10, force=True)
                    survived += done.interrupted and _is_sound(folder / "endless.raymap")
        survived *= server.answers() and not server.workers()
    finally:
        server.stop()
    return tried, survived, server.peak


def stops_with_work(folder: Path, tries: int) -> tuple[int, int, int]:
    """SIGTERM while one client records and another does not read."""
    survived = peak = 0
    for _ in range(tries):
        server = Server(folder)
        running, said = _recording(server, "stopped.raymap")
        with http2.connect(server.address, narrow=True) as raw:
            wanted = http2.ticket({"get": "rays", "map": "large.raymap"})
            raw.sendall(http2.greeting() + http2.asks("DoGet", HONEST, wanted))
            raw.recv(100)
            status = server.stop()
        running.join(60)
        ended = bool(said) and not isinstance(said[0], Exception) and said[0].interrupted
        # 1 says that somebody was cut off: the one that does not read
        survived += status in (0, 1) and ended and _is_sound(folder / "stopped.raymap")
        peak = max(peak, server.peak)
    return tries, survived, peak


# -- the table -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One attack and what became of it."""

    attack: str
    tried: int
    survived: int
    peak: int
    seconds: float

    def __str__(self) -> str:
        return (
            f"| {self.attack} | {self.tried:,} | {self.survived:,} | {self.peak / 1e6:,.0f} MB "
            f"| {self.seconds:,.0f} s |"
        )


HEAD = "| attack | tried | survived | server's peak memory | time |\n|---|---|---|---|---|"
Attack = Callable[[Server, int], tuple[int, int]]

BEFORE_A_TOKEN: list[tuple[str, Attack, int, int]] = [
    ("messages of 600 MB without token", large_messages, 60, 4),
    ("connections that begin in five ways and stop, all held open", slow_writers, 1_000, 150),
    ("connections at once", many_connections, 3_000, 300),
    ("requests without token, a thousand on a connection", many_requests, 20_000, 1_000),
    ("requests without token that are begun and given up", given_up_requests, 200_000, 20_000),
    ("headers without an end", endless_headers, 40, 2),
    ("calls with wrong tokens", wrong_tokens, 2_000, 20),
    ("random frames and bytes", nonsense, 2_000, 60),
]
WITH_A_TOKEN: list[tuple[str, Attack, int, int]] = [
    ("readers that ask for all rays and read nothing", stalled_readers, 60, 24),
    ("uploads that stop within a message", stalled_writers, 24, 4),
    ("tokens withdrawn while a stream is sent", withdrawn_tokens, 10, 1),
    ("criteria of many stars, repetitions, levels, conditions", hostile_criteria, 99, 99),
    ("pictures of up to 10⁹ × 10⁹ pixels", large_pictures, 99, 99),
    ("recordings of endless rays or seconds", unbounded_recordings, 99, 99),
    ("uploads beyond the quota, also after a new start", uploads_beyond_the_quota, 20, 4),
]
IN_WORKERS: list[tuple[str, Attack, int]] = [
    ("scene files outside: absolute, `..`, links, `file://`, 1,200 characters, in each key",
     scenes_reaching_out, 48),
    ("recording processes that are killed", killed_workers, 3),
    ("clients that leave while a scene is compiled or traced", clients_that_go, 4),
    ("recordings that fill the quota of the disk", full_disks, 2),
]  # fmt: skip
WITH_OTHER_LIMITS: list[tuple[str, Callable[[Path, int], tuple[int, int, int]], int]] = [
    ("scenes that need more memory than they may have", full_memory, 3),
    ("scenes and recordings beyond their deadline", endless_requests, 2),
    ("SIGTERM with a recording, and a reader that does not read", stops_with_work, 2),
]


def attack(folder: Path, *, short: bool, tell: Callable[[Row], None], only: str = "") -> None:
    """Try them all.

    Parameters
    ----------
    folder : an empty one
    short : less often, and none that takes worker processes
    tell : hears of each
    only : those whose name has this text in it
    """
    served = folder / "served"
    served.mkdir()
    (served / "scene.toml").write_text(MIRROR_BALL)
    write_large_map(served / "large.raymap", 3 if short else 20)
    stall = 6.0 if short else Limits().stall_seconds
    server = Server(served, stall_seconds=stall, disk_bytes=40_000_000)
    try:
        assert server.answers()
        for name, function, often, seldom in (*BEFORE_A_TOKEN, *WITH_A_TOKEN):
            if only in name:
                tell(_measured(server, name, function, seldom if short else often))
        for name, function, often in () if short else IN_WORKERS:
            if only in name:
                tell(_measured(server, name, function, often))
    finally:
        server.stop()
    for name, apart, often in () if short else WITH_OTHER_LIMITS:
        if only not in name:
            continue
        began = time.monotonic()
        tell(Row(name, *apart(served, often), time.monotonic() - began))


def _measured(server: Server, name: str, function: Attack, tries: int) -> Row:
    server.peak, began = 0, time.monotonic()
    tried, survived = function(server, tries)
    return Row(name, tried, survived, server.peak, time.monotonic() - began)


def main() -> int:
    """The command; exit status 1 if anything was not survived."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--short", action="store_true", help="what the test run does")
    parser.add_argument("--only", default="", help="attacks with this text in their name")
    parser.add_argument("--serve", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        _serve(*given.serve)
        return 0
    rows: list[Row] = []

    def tell(row: Row) -> None:
        rows.append(row)
        print(row, flush=True)

    print(HEAD, flush=True)
    with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
        attack(Path(folder), short=given.short, tell=tell, only=given.only)
    return int(any(row.survived < row.tried for row in rows))


if __name__ == "__main__":
    sys.exit(main())
