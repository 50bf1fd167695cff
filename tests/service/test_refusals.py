"""Whatever a client sends, it gets one clear line, and the next client is served."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.flight as flight
import pytest

import raymap
from raymap.model.errors import CriterionError, NotARayMap, RayMapError, SceneError
from raymap.remote.client import Service
from service import Limits, RaymapService
from service.callers.access import Tls, choose_token
from service.files.confine import OutsideFolder, ServedFolder
from service.files.disk import LEDGER
from tests.service.conftest import TOKEN, Starter


def raw(service: RaymapService, action: str, body: bytes, token: str = TOKEN) -> str:
    """The error of a call, as any Flight client sees it."""
    options = flight.FlightCallOptions(headers=[(b"authorization", f"Bearer {token}".encode())])
    with flight.connect(service.address) as plain, pytest.raises(flight.FlightError) as failure:
        list(plain.do_action(flight.Action(action, body), options))
    return str(failure.value)


@pytest.fixture(autouse=True)
def still_up(service: RaymapService, capfd: Any):
    """After every test the service answers as before, and it has not stumbled."""
    yield
    with raymap.connect(service.address, token=TOKEN) as fresh:
        assert fresh.open("small.raymap").query().matched > 0
    assert "Traceback" not in capfd.readouterr().err


def test_without_token(service: RaymapService) -> None:
    for token in ("", "wrong", TOKEN + "x"):
        with pytest.raises(RayMapError, match="wants its token") as refused:
            raymap.connect(service.address, token=token)
        assert "\n" not in str(refused.value)
    with (
        flight.connect(service.address) as plain,
        pytest.raises(flight.FlightUnauthenticatedError),
    ):
        plain.do_get(flight.Ticket(b"{}")).read_all()


def test_nobody_there_and_no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RayMapError, match="cannot be reached"):
        raymap.connect("grpc://localhost:9", token=TOKEN)
    with pytest.raises(RayMapError, match="not the address"):
        raymap.connect("nonsense", token=TOKEN)
    monkeypatch.delenv("RAYMAP_SERVICE", raising=False)
    with pytest.raises(RayMapError, match="RAYMAP_SERVICE"):
        raymap.connect()


BOMBS = {
    "brackets": "(" * 9_000 + 'hit("L1")' + ")" * 9_000,
    "negations": "!" * 9_000 + 'hit("L1")',
    "huge": 'hit("L1") | ' * 100_000 + 'hit("L1")',
    "repetitions": 'path("lamp (((.{1000}){1000}){1000}){1000}")',
    "words": "hit(" + "L1 " * 3000,
    "nothing": "\0\1\2",
    "letters": "𝕳" * 15_000,
    "name": f'hit("{"*a" * 5000}")',
}


@pytest.mark.parametrize("kind", BOMBS)
def test_bombs_of_criteria(client: Service, kind: str) -> None:
    with pytest.raises(RayMapError) as refused:
        client.open("small.raymap").query(BOMBS[kind])
    assert len(str(refused.value)) < 2_000
    # The largest one is not even read
    assert isinstance(refused.value, CriterionError) == (kind != "huge")


def test_json_bombs(service: RaymapService, client: Service) -> None:
    deep: Any = {"op": "source", "names": ["lamp"]}
    for _ in range(400):
        deep = {"op": "not", "args": [deep]}
    with pytest.raises(CriterionError, match="nests deeper"):
        client.open("small.raymap").query(deep)
    wide = {"op": "or", "args": [{"op": "source", "names": ["lamp"]}] * 3_000}
    with pytest.raises(CriterionError, match="nodes"):
        client.open("small.raymap").query(wide)
    nested = b'{"map": "small.raymap", "criterion": ' + b'{"a":' * 100_000 + b"1" + b"}" * 100_000
    assert "nests too deeply" in raw(service, "count", nested + b"}")
    assert "no JSON" in raw(service, "count", b"\xff\xfe{")
    assert "JSON object" in raw(service, "count", b"[1, 2]")


def test_oversized_and_unknown(service: RaymapService, client: Service) -> None:
    assert "at most 1048576 are taken" in raw(service, "count", b" " * 5_000_000)
    assert "there is no action 'explode'" in raw(service, "explode", b"{}")
    assert "unknown keys: 'colour'" in raw(service, "describe", b'{"map": "a", "colour": 1}')
    assert "'map' is missing" in raw(service, "count", b"{}")
    assert "must be 1 to" in raw(service, "count", b'{"map": "small.raymap", "limit": -1}')
    assert "must be true or false" in raw(
        service, "record", b'{"scene": "a", "map": "b", "force": 3}'
    )
    with pytest.raises(RayMapError, match="'get' must be one of rays"):
        client.table("everything", {})
    with pytest.raises(RayMapError, match=r"8193|8192"):
        client.open("small.raymap").picture(size=(9_000, 9_000))
    with pytest.raises(RayMapError, match="detector"):
        client.open("small.raymap").image("sensr")
    with pytest.raises(raymap.RayNotFound):
        client.open("small.raymap").report(10**9)


OUTSIDE = [
    "../secret.raymap", "/etc/passwd", "a/../../secret.raymap", "..\\secret.raymap", "~/x.raymap",
    "C:\\secret.raymap", "link.raymap", "linked/secret.raymap", ".hidden.raymap", "", "a\0b",
    "x" * 2_000, "loop/a.raymap", "shards", "file:///etc/passwd", "http://127.0.0.1:9/a.raymap",
    "simplecache::file:///etc/passwd", "memory://a.raymap",
]  # fmt: skip


@pytest.mark.parametrize("name", OUTSIDE)
def test_paths_outside(client: Service, folder: Path, name: str) -> None:
    (folder / "link.raymap").symlink_to(folder.parent / "secret.raymap")
    (folder / "linked").symlink_to(folder.parent)
    (folder / "loop").symlink_to(folder / "loop")
    (folder / "shards").mkdir()
    (folder / "shards" / "a.raymap").symlink_to(folder.parent / "secret.raymap")
    with pytest.raises(RayMapError) as refused:
        client.open(name)
    assert "outside" in str(refused.value) or "hidden" in str(refused.value) or (
        "a path is a text" in str(refused.value) or "'map' is missing" in str(refused.value)
        or "cannot be followed" in str(refused.value)
    )  # fmt: skip
    assert str(folder.parent) not in str(refused.value)
    assert all("secret" not in row["name"] for row in client.files())
    with pytest.raises(RayMapError):
        client.record("scene.toml", name if name != "shards" else "linked/x.raymap", rays=1)
    with pytest.raises(RayMapError):
        client.upload_text("x", name or "/")


def test_scenes_that_reach_out(client: Service, folder: Path) -> None:
    (folder.parent / "secret.stl").write_text("solid secret")
    (folder / "link.stl").symlink_to(folder.parent / "secret.stl")
    text = (folder / "scene.toml").read_text()
    # Which paths and keys lead out, test_scene_files tries; here it is the way over the wire
    mesh = text.replace('kind = "sphere"\nradius = 2\n',
                        'kind = "mesh"\nfile = "link.stl"\nscale = 1\n')  # fmt: skip
    assert mesh != text
    for name in ("own.toml", "own"):
        (folder / name).write_text(mesh)
        with pytest.raises(RayMapError, match=r"'link\.stl' is outside the served folder"):
            client.scene(name)
    with pytest.raises(RayMapError, match="outside the served folder"):
        client.record(None, "x.raymap", text=mesh, rays=10)
    assert not (folder / "x.raymap").exists()
    # Titles are no paths
    assert client.scene(text='title = "/etc/passwd"\n' + text).objects == ["ball"]
    with pytest.raises(SceneError, match="not a TOML file"):
        client.scene(text="[[[")
    with pytest.raises(SceneError, match="unknown key"):
        client.scene(text=text + "\n[nonsense]\nx = 1\n")
    with pytest.raises(RayMapError, match="either 'scene'"):
        client.scene()


def test_recordings_are_bounded(client: Service, folder: Path) -> None:
    with pytest.raises(RayMapError, match="must be 1 to 10000000000"):
        client.record("scene.toml", "a.raymap", rays=10**18)
    with pytest.raises(RayMapError, match=r"must end in \.raymap"):
        client.record("scene.toml", "scene.toml", rays=1, force=True)
    with pytest.raises(raymap.MapExists):
        client.record("scene.toml", "small.raymap", rays=1)
    with pytest.raises(RayMapError, match="there is no folder"):
        client.record("scene.toml", "none/a.raymap", rays=1)
    with pytest.raises(RayMapError, match="not of a kind"):
        client.upload_text("x", "run.sh")
    kept = sorted(p.name for p in folder.iterdir() if not p.name.startswith("."))
    assert kept == ["scene.toml", "small.raymap"]


def test_uploads_are_bounded(start: Starter, folder: Path) -> None:
    other = start(limits=Limits(upload_bytes=3_000_000))
    with raymap.connect(other.address, token=TOKEN) as client:
        with pytest.raises(RayMapError, match="more than the 3000000 bytes"):
            client.upload_text("x" * 3_000_001, "big.stl")
        client.upload_text("x" * 2_000_000, "fits.stl")
    assert sorted(p.name for p in folder.glob("*.stl")) == ["fits.stl"]
    assert not [path for path in folder.glob(".*") if path.name != LEDGER]


def test_searches_are_bounded(start: Starter) -> None:
    hasty = start(limits=Limits(search_seconds=0.0, searches=1, turn_seconds=0.2))
    with raymap.connect(hasty.address, token=TOKEN) as client:
        there = client.open("small.raymap")
        with pytest.raises(RayMapError, match="longer than the 0 s"):
            there.query("length > 1 mm")
        with pytest.raises(RayMapError, match="longer than"):
            there.image("sensor")
        gate = hasty._questions.gate
        with gate.turn(), pytest.raises(RayMapError, match="ask again later"):
            there.query('hit("L1")')
    # The engine is compiled before: the time of a recording includes that
    with raymap.connect(start().address, token=TOKEN) as client:
        client.record("scene.toml", "short.raymap", rays=1000)
    slow = start(limits=Limits(record_seconds=15.0))
    with raymap.connect(slow.address, token=TOKEN) as client:
        stopped = client.record("scene.toml", "long.raymap", rays=10**9)
        assert stopped.interrupted
        assert stopped.seconds < 60
        assert client.open("long.raymap").finished


def test_a_mistake_of_the_service_itself(
    service: RaymapService, client: Service, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    monkeypatch.setattr(service._questions, "report", lambda *_: 1 / 0)
    with pytest.raises(RayMapError, match=r"failed at this request \(ZeroDivisionError\)"):
        client.open("small.raymap").report(0)
    assert "ZeroDivisionError" in capfd.readouterr().err


def test_maps_that_are_none(client: Service, folder: Path) -> None:
    (folder / "bad.raymap").write_bytes(b"nonsense" * 100)
    with pytest.raises(NotARayMap):
        client.open("bad.raymap")
    with pytest.raises(NotARayMap, match=r"none\.raymap does not exist"):
        client.open("none.raymap")


def test_other_machines_need_tls(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RayMapError, match="--tls-certificate"):
        RaymapService(folder, TOKEN, host="0.0.0.0")
    with pytest.raises(RayMapError, match="is not a folder"):
        RaymapService(folder / "none", TOKEN)
    (tmp_path / "short").write_text("abc")
    with pytest.raises(RayMapError, match="16 or more"):
        choose_token(tmp_path / "short")
    with pytest.raises(RayMapError, match="no PEM"):
        Tls.read(tmp_path / "short", tmp_path / "short")


def _certified(folder: Path) -> Tls:
    """A key and a certificate for localhost, as ``key.pem`` and ``cert.pem``."""
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-keyout",
               "key.pem", "-out", "cert.pem", "-subj", "/CN=localhost", "-addext",
               "subjectAltName=DNS:localhost"]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return Tls.read(folder / "cert.pem", folder / "key.pem")


@pytest.mark.parametrize("begun", [b"", b"\x16\x03\x01\x02\x00\x01"])
def test_handshakes_that_do_not_end_take_places_like_others(
    start: Starter, tmp_path: Path, begun: bytes
) -> None:
    """Silent, or within the first record of TLS (RFC 8446, section 5.1): the oldest give way."""
    limits = Limits(connections=3, spare_workers=0)
    secured = start(tls=_certified(tmp_path), limits=limits)
    port = int(secured.address.rpartition(":")[2])
    held = []
    for _ in range(20):
        held.append(socket.create_connection(("localhost", port)))
        held[-1].sendall(begun)
    ended = 0
    for each in held[:16]:
        each.settimeout(5.0)
        try:
            ended += each.recv(1) == b""
        except ConnectionError:
            ended += 1
    assert ended == 16
    with raymap.connect(
        secured.address, token=TOKEN, root_certificates=tmp_path / "cert.pem"
    ) as client:
        assert client.open("small.raymap").rays > 0
    for each in held:
        each.close()


def test_tls(start: Starter, tmp_path: Path) -> None:
    secured = start(tls=_certified(tmp_path))
    assert secured.address.startswith("grpc+tls://")
    with raymap.connect(
        secured.address, token=TOKEN, root_certificates=tmp_path / "cert.pem"
    ) as client:
        assert client.open("small.raymap").rays > 0
    with pytest.raises(RayMapError, match="cannot be reached"):
        raymap.connect(secured.address, token=TOKEN)
    with pytest.raises(RayMapError, match="cannot be reached"):
        raymap.connect(secured.address.replace("+tls", ""), token=TOKEN)


def test_folder_rules(tmp_path: Path) -> None:
    served = ServedFolder(tmp_path)
    assert served.path("a/b.raymap") == tmp_path.resolve() / "a" / "b.raymap"
    for name in (None, 3, "a/./../../b", "//host/share", "a:b", "."):
        with pytest.raises(OutsideFolder):
            served.path(name if name != "." else "..")


def test_command(folder: Path) -> None:
    """`raymap serve --json` as a plug-in would start it."""
    code = (
        "import typer; from service.cli import register; app = typer.Typer();"
        "app.callback()(lambda: None); register(app); app()"
    )
    environment = {**os.environ, "RAYMAP_TOKEN": ""}
    with subprocess.Popen(
        [sys.executable, "-c", code, "serve", str(folder), "--json", "--no-browser"],
        stdout=subprocess.PIPE, text=True, env=environment,
    ) as process:  # fmt: skip
        killer = threading.Timer(60, process.kill)
        killer.start()
        try:
            assert process.stdout is not None
            said = json.loads(process.stdout.readline())
            with raymap.connect(said["address"], token=said["token"]) as client:
                assert client.open("small.raymap").query('hit("L1")').matched > 0
            assert Path(said["folder"]) == folder.resolve()
        finally:
            process.terminate()
            process.wait(30)
            killer.cancel()


def test_errors_survive_the_wire() -> None:
    from raymap.remote.protocol import ServiceError, decode_error, encode_error

    for error in (CriterionError("a"), NotARayMap("b"), OutsideFolder("c")):
        back = decode_error(encode_error(error), "x")
        assert str(back) == str(error)
        assert type(back) is (ServiceError if isinstance(error, OutsideFolder) else type(error))
    assert str(decode_error(b"nonsense", "plain message")) == "plain message"
    assert isinstance(pa.ArrowInvalid("x"), Exception)
