"""Each token does what it was made for and nothing else, and none is ever written down."""

from __future__ import annotations

import json
import os
import stat
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.flight as flight
import pytest

import raymap
from raymap.model.errors import RayMapError
from service.answers.streams import STREAMS
from service.callers.rights import ANY, NEEDS, RIGHTS, read_rights
from service.callers.tokens import TokenFile
from service.server import ACTIONS
from tests.scenes import MIRROR_BALL
from tests.service.conftest import TOKEN, Starter


@pytest.fixture
def tokens(tmp_path: Path) -> TokenFile:
    file = TokenFile(tmp_path / "config" / "tokens.json")
    for right in RIGHTS:
        file.add(f"spare-{right}", frozenset({right}))
    return file


def call(address: str, token: str, what: str, fields: dict[str, Any]) -> str:
    """What a call of any kind ends with: ``ok``, or the name of Flight's error."""
    options = flight.FlightCallOptions(
        headers=[(b"authorization", f"Bearer {token}".encode())], timeout=400
    )
    with flight.connect(address) as plain:
        try:
            if what == "list_actions":
                plain.list_actions(options)
            elif what == "list_flights":
                list(plain.list_flights(b"", options))
            elif what in STREAMS:
                ticket = json.dumps({"get": what, **fields}).encode()
                descriptor = flight.FlightDescriptor.for_command(ticket)
                try:
                    plain.get_flight_info(descriptor, options)
                except flight.FlightError as error:
                    with pytest.raises(type(error)):
                        plain.do_get(flight.Ticket(ticket), options).read_all()
                    raise
                plain.do_get(flight.Ticket(ticket), options).read_all()
            elif what == "upload":
                schema = pa.schema([("data", pa.large_binary())])
                descriptor = flight.FlightDescriptor.for_command(json.dumps(fields).encode())
                writer, reader = plain.do_put(descriptor, schema, options)
                writer.done_writing()
                reader.read()
                writer.close()
            else:
                list(plain.do_action(flight.Action(what, json.dumps(fields).encode()), options))
        except flight.FlightError as error:
            return type(error).__name__
    return "ok"


ASKED: dict[str, dict[str, Any]] = {
    "scene": {"text": MIRROR_BALL},
    "record": {"text": MIRROR_BALL, "map": "new.raymap", "rays": 10},
    "describe": {"map": "small.raymap"},
    "criterion": {"criterion": 'hit("L1")'},
    "count": {"map": "small.raymap"},
    "report": {"map": "small.raymap", "ray_id": 1},
    "view": {"map": "none.raymap"},
    "drawn": {"view": "none"},
    "close_view": {"view": "none"},
    **{kind: {"map": "small.raymap", "limit": 3} for kind in ("rays", "ray_ids", "lines")},
    "paths": {"map": "small.raymap"},
    "image": {"map": "small.raymap", "detector": "sensor"},
    "picture": {"map": "small.raymap", "width": 64, "height": 64},
    "upload": {"file": "new.toml"},
}
REFUSED_ANYHOW = {"view", "drawn", "close_view"}


def test_the_table_names_every_call() -> None:
    others = {"list_actions", "list_flights", "upload"}
    assert set(NEEDS) == {*ACTIONS, *STREAMS, *others}
    assert set(NEEDS.values()) == {ANY, *RIGHTS}
    methods = {name for name in vars(flight.FlightServerBase) if name.startswith(("do_", "list_"))}
    # Every way in that Flight has is one of the table's, or is not served
    assert methods <= {"do_action", "do_get", "do_put", "do_exchange", "list_actions",
                       "list_flights"}  # fmt: skip


def test_all_calls_with_all_rights(start: Starter, tokens: TokenFile, folder: Path) -> None:
    service = start(tokens=tokens)
    given = {right: tokens.add(right, frozenset({right})) for right in RIGHTS}
    for right, token in given.items():
        for what, need in NEEDS.items():
            fields = ASKED.get(what, {})
            ended = call(service.address, token, what, fields)
            if need in (ANY, right):
                wanted = "FlightServerError" if what in REFUSED_ANYHOW else "ok"
            else:
                wanted = "FlightUnauthorizedError"
            assert ended == wanted, (right, what)
            (folder / "new.raymap").unlink(missing_ok=True)
            (folder / "new.toml").unlink(missing_ok=True)
    # What replaces or adds to a map changes what is there: that is writing
    for change in ("force", "append"):
        asked = {"text": MIRROR_BALL, "map": "other.raymap", "rays": 10, change: True}
        assert call(service.address, given["record"], "record", asked) == "FlightUnauthorizedError"
    both = tokens.add("both", read_rights(["record", "write"]))
    assert call(service.address, both, "record", asked) == "ok"
    # The one token of the service goes on as before
    for what, fields in ASKED.items():
        if what not in REFUSED_ANYHOW:
            assert call(service.address, TOKEN, what, fields) == "ok", what


@pytest.mark.parametrize("name", ["other.raymap", "link.raymap", "sub/small.raymap", "sub"])
def test_a_token_of_one_map(
    start: Starter, tokens: TokenFile, folder: Path, served_map: Path, name: str
) -> None:
    (folder / "sub").mkdir()
    for place in ("other.raymap", "sub/small.raymap"):
        (folder / place).write_bytes(served_map.read_bytes())
    (folder / "link.raymap").symlink_to(folder / "other.raymap")
    service = start(tokens=tokens)
    token = tokens.add("one", read_rights(RIGHTS), maps=("small.raymap",))
    for what, fields in ASKED.items():
        if "map" not in fields or what == "view":
            continue
        other = call(service.address, token, what, {**fields, "map": name})
        assert other == "FlightUnauthorizedError", what
        if what != "record":
            assert call(service.address, token, what, fields) == "ok", what
    assert call(service.address, token, "criterion", {"criterion": 'hit("L1")', "map": name}) == (
        "FlightUnauthorizedError"
    )
    with raymap.connect(service.address, token=token) as client:
        assert [row["name"] for row in client.files()] == ["small.raymap"]
        assert client.about["maps"] == ["small.raymap"]
        # However its name is spelled it is that map
        assert client.open("./small.raymap").rays > 0
    options = flight.FlightCallOptions(headers=[(b"authorization", f"Bearer {token}".encode())])
    with flight.connect(service.address) as plain:
        [only] = plain.list_flights(b"", options)
        assert json.loads(only.descriptor.command)["map"] == "small.raymap"


def test_withdrawn_and_expired(start: Starter, tokens: TokenFile, folder: Path) -> None:
    service = start(tokens=tokens)
    kept, gone = tokens.add("kept", read_rights(RIGHTS)), tokens.add("gone", read_rights(RIGHTS))
    short = tokens.add("short", frozenset({"ask"}), expires=time.time() + 3)
    old = tokens.add("old", frozenset({"ask"}), expires=time.time() - 1)
    asked = {"map": "small.raymap"}
    assert call(service.address, short, "count", asked) == "ok"
    assert call(service.address, old, "count", asked) == "FlightUnauthenticatedError"
    # A recording under way ends, too, with a valid map
    began = threading.Event()

    def record() -> None:
        with raymap.connect(service.address, token=gone) as client:
            client.record("scene.toml", "long.raymap", seconds=60, progress=lambda _: began.set())

    running = threading.Thread(target=record)
    started = time.monotonic()
    running.start()
    assert began.wait(30)
    tokens.remove("gone")
    assert call(service.address, gone, "count", asked) == "FlightUnauthenticatedError"
    running.join(40)
    assert not running.is_alive()
    assert time.monotonic() - started < 50
    with raymap.open(folder / "long.raymap") as made:
        assert made.finished
        assert made.rays > 0
    assert call(service.address, kept, "count", asked) == "ok"
    time.sleep(max(0.0, started + 3.5 - time.monotonic()))
    assert call(service.address, short, "count", asked) == "FlightUnauthenticatedError"
    # Without its file, or open to others, nobody is let in by it
    tokens.path.chmod(0o644)
    assert call(service.address, kept, "count", asked) == "FlightUnauthenticatedError"
    tokens.path.chmod(0o600)
    assert call(service.address, kept, "count", asked) == "ok"
    tokens.path.unlink()
    assert call(service.address, kept, "count", asked) == "FlightUnauthenticatedError"
    assert call(service.address, TOKEN, "count", asked) == "ok"


def test_no_token_is_written_down(
    start: Starter, tokens: TokenFile, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    service = start(tokens=tokens)
    token = tokens.add("secret", read_rights(RIGHTS))
    monkeypatch.setattr(service._questions, "report", lambda *_: 1 / 0)
    assert call(service.address, token, "report", {"map": "small.raymap", "ray_id": 1}) == (
        "FlightInternalError"
    )
    for wrong in (token + "x", token[:-1]):
        assert call(service.address, wrong, "hello", {}) == "FlightUnauthenticatedError"
    assert call(service.address, token, "explode", {}) == "FlightServerError"
    said = "".join(capfd.readouterr())
    assert "ZeroDivisionError" in said
    texts = [said, service.metrics.text(), tokens.path.read_text(), repr(vars(service))]
    for text in texts:
        assert token not in text
        assert TOKEN not in text
    assert stat.S_IMODE(tokens.path.stat().st_mode) == 0o600
    command = Path("/proc/self/cmdline")
    if command.exists():
        assert token.encode() not in command.read_bytes()


def test_the_command(run: Any, tmp_path: Path, folder: Path, start: Starter) -> None:
    file = tmp_path / "own" / "tokens.json"
    code, token, told = run("token", "add", "cad", "--rights", "ask,record", "--tokens", file)
    assert code == 0
    assert len(token.strip()) == 32
    assert token.strip() not in told
    assert run("token", "add", "cad", "--tokens", file)[0] == 1
    assert run("token", "add", "x", "--rights", "rule", "--tokens", file)[2].startswith("error: ")
    assert run("token", "add", "../x", "--tokens", file)[0] == 1
    code, _, _ = run(
        "token", "add", "guest", "--map", "small.raymap", "--days", "2", "--tokens", file
    )
    assert code == 0
    code, listed, _ = run("token", "list", "--tokens", file)
    assert listed.splitlines()[0] == "cad: ask, record; all maps; never expires"
    assert listed.splitlines()[1].startswith("guest: ask; small.raymap; expires ")
    rows = json.loads(run("token", "list", "--json", "--tokens", file)[1])["tokens"]
    assert [row["name"] for row in rows] == ["cad", "guest"]
    assert "sha256" not in rows[0]
    service = start(tokens=TokenFile(file))
    assert call(service.address, token.strip(), "files", {}) == "ok"
    assert run("token", "remove", "cad", "--tokens", file)[0] == 0
    assert call(service.address, token.strip(), "files", {}) == "FlightUnauthenticatedError"
    assert run("token", "remove", "cad", "--tokens", file)[0] == 1


@pytest.mark.parametrize(
    "content",
    ["", "[]", '{"tokens": 3}', '{"tokens": [{}]}', "[" * 100_000, '{"tokens": [' + "1," * 10**6,
     '{"tokens": [{"name": "a", "sha256": "0", "rights": ["ask"], "maps": null, "made": 0, '
     '"expires": null}]}', "\0"],
)  # fmt: skip
def test_files_that_hold_no_tokens(tmp_path: Path, content: str) -> None:
    path = tmp_path / "tokens.json"
    path.write_text(content)
    path.chmod(0o600)
    for act in (TokenFile(path).check, TokenFile(path).rows):
        with pytest.raises(RayMapError, match="no file of tokens"):
            act()
    assert TokenFile(path).find("0" * 64) is None
    os.unlink(path)
    with pytest.raises(RayMapError, match="raymap token add"):
        TokenFile(path).check()


def test_an_application_ends_with_its_token_and_shows_nothing_of_the_services_user(
    start: Starter, tokens: TokenFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("trame")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    kept = tmp_path / "home" / "raymap" / "criteria.json"
    kept.parent.mkdir(parents=True)
    kept.write_text('{"recent": ["hit(\\"tube\\")"], "saved": {"mine": "hit(\\"L1\\")"}}')
    service = start(tokens=tokens)
    guest = tokens.add("guest", frozenset({"ask"}))
    with raymap.connect(service.address, token=guest) as client:
        opened = client.ask("view", {"map": "small.raymap"})
    with urllib.request.urlopen(opened["url"], timeout=30) as page:
        assert page.status == 200
    (shown,) = service.applications._opened.values()
    state = shown.server.application.page
    assert (state.recent, state.saved) == ([], [])
    shown.server.application.registry.use('hit("L1")')
    assert json.loads(kept.read_text())["recent"] == ['hit("tube")']
    tokens.remove("guest")
    for _ in range(300):
        if not len(service.applications):
            break
        time.sleep(0.1)
    assert not len(service.applications)
    shown.server._thread.join(30)
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(opened["url"], timeout=30)
