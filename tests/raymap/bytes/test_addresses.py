"""Maps behind addresses: the same answers as from the disk, and only the needed bytes fetched."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest
from typer.testing import CliRunner

import raymap
from raymap.bytes.address import Address, place_of
from raymap.bytes.remotebytes import BLOCK, RemoteBytes, upload
from raymap.cli import application
from raymap.model.errors import DamagedPortion, NotARayMap
from tests.raymap.maps import RGB, portion_at, small_directory

RAYS = 40_000


class RangeHandler(SimpleHTTPRequestHandler):
    """Serves files, byte ranges too, and counts what it sends."""

    sent = 0
    serves_ranges = True

    def log_message(self, *_: Any) -> None:
        pass

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        wanted = self.headers.get("Range")
        if path.is_dir() or wanted is None or not self.serves_ranges:
            super().do_GET()
            return
        size = path.stat().st_size
        start, _, last = wanted.removeprefix("bytes=").partition("-")
        data = path.read_bytes()[int(start) : int(last) + 1]
        type(self).sent += len(data)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {start}-{last}/{size}")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two shards of one scene."""
    place = tmp_path_factory.mktemp("maps") / "shards"
    place.mkdir()
    directory = small_directory()
    for number in range(2):
        with raymap.RayMapWriter.create(place / f"{number}.raymap", directory) as writer:
            writer.add_channel_set(RGB)
            writer.start_run(seed=7)
            for part in range(4):
                place_of_part = 4 * number + part
                portion = portion_at(place_of_part * RAYS // 8, RAYS // 8, seed=place_of_part)
                writer.commit(writer.encode(portion, part))
    return place


@pytest.fixture
def web(folder: Path) -> Iterator[str]:
    RangeHandler.sent, RangeHandler.serves_ranges = 0, True
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(RangeHandler, directory=folder.parent))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()
    thread.join(5)


@pytest.fixture
def memory(folder: Path) -> Iterator[str]:
    for path in folder.iterdir():
        upload(path.read_bytes(), Address("memory://bucket/shards") / path.name)
    yield "memory://bucket/shards"
    fsspec.filesystem("memory").rm("/bucket", recursive=True)


def test_addresses_are_told_from_paths(tmp_path: Path) -> None:
    assert place_of("lens.raymap") == Path("lens.raymap")
    assert place_of(Path("C:/lens.raymap")) == Path("C:/lens.raymap")
    address = place_of("s3://bucket/a/lens.raymap")
    assert address == Address("s3://bucket/a/lens.raymap")
    assert (address.name, address.stem, address.suffix) == ("lens.raymap", "lens", ".raymap")
    assert str(address.parent) == "s3://bucket/a"
    assert address.parent / "b.raymap" == Address("s3://bucket/a/b.raymap")
    # A command line hands over paths, which lose a slash
    assert place_of(Path("https://host/a.raymap")) == Address("https://host/a.raymap")
    signed = Address("https://host/a/lens.raymap?key=1/2")
    assert signed.name == "lens.raymap"
    assert str(signed.parent) == "https://host/a?key=1/2"


@pytest.mark.parametrize("kind", ["memory", "web"])
def test_same_rays_as_from_the_disk(folder: Path, kind: str, request: Any) -> None:
    base = request.getfixturevalue(kind)
    place = base if kind == "memory" else [f"{base}/shards/{n}.raymap" for n in range(2)]
    with raymap.open(folder) as local, raymap.open(place) as there:
        assert there.rays == local.rays == RAYS
        assert there.finished
        for mine, other in zip(local.portions, there.portions, strict=True):
            assert np.array_equal(mine.ray_ids(), other.ray_ids())
            assert np.array_equal(mine.read().position, other.read().position)
        assert there.bytes_read <= there.bytes + 2 * BLOCK * len(there.portions)


def test_only_the_needed_bytes_come_over(folder: Path, web: str) -> None:
    path = folder / "0.raymap"
    size = path.stat().st_size
    assert size > 8 * BLOCK
    with raymap.open(f"{web}/shards/0.raymap") as there:
        # Opening: the last block, in which the footer repeats the directory
        assert there.file.bytes.requests == 1
        assert there.bytes_read == BLOCK
        with raymap.open(path) as here:
            assert there.directory == here.directory
            assert there.describe() | {"verified": 0} == here.describe() | {"verified": 0}
        assert there.file.bytes.requests == 1
        # The path dictionary, if it does not lie in that block, and a portion's table
        assert there.merged is not None
        opened = there.bytes_read
        assert opened == RangeHandler.sent
        assert opened < size / 4
        assert there.file.bytes.requests < 8
        # One stream of one portion: this stream, and at most the blocks around headers
        portion = there.portions[2]
        portion.path_numbers()
        fetched = there.bytes_read - opened
        assert fetched == RangeHandler.sent - opened
        assert (
            fetched
            <= sum(
                entry.stored_size for entry in portion.stream_table() if entry.name == "path_number"
            )
            + 2 * BLOCK
            + BLOCK // 2
        )


def test_folder_of_a_web_server(folder: Path, web: str) -> None:
    with raymap.open(f"{web}/shards") as there:
        assert there.rays == RAYS
        assert len(there.shards) == 2


def test_a_command_takes_an_address(memory: str) -> None:
    answer = CliRunner().invoke(application(), ["info", memory, "--json"])
    assert answer.exit_code == 0, answer.output
    assert f'"rays": {RAYS}' in answer.stdout


def test_missing_maps_and_unknown_protocols_are_refused_in_one_line(web: str) -> None:
    for place in (f"{web}/none.raymap", "memory://none.raymap", "http://127.0.0.1:9/x.raymap"):
        with pytest.raises(NotARayMap) as refused:
            raymap.open(place)
        assert place in str(refused.value)
        assert "\n" not in str(refused.value)
    with pytest.raises(NotARayMap, match="nonsense://bucket"):
        raymap.open("nonsense://bucket/x.raymap")
    fsspec.filesystem("memory").makedirs("/empty", exist_ok=True)
    with pytest.raises(NotARayMap, match="holds no ray maps"):
        raymap.open("memory://empty")


@pytest.mark.parametrize(
    "chain",
    [
        "simplecache::{web}/shards/0.raymap",
        "filecache::{web}/shards/0.raymap",
        "blockcache::{web}/shards/0.raymap",
        "simplecache::file://{folder}/0.raymap",
        "dir::{web}/shards/0.raymap",
        "reference::{web}/list.json",
        "reference://0.raymap",
        "dir:///shards/0.raymap",
        "generic://{folder}/0.raymap",
        "memory://a::{web}/shards/0.raymap",
    ],
)
def test_what_leads_through_other_file_systems_is_refused(
    chain: str, folder: Path, web: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before a byte is asked for, and before one is written here."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    place = chain.format(web=web, folder=folder)
    options = {"target_protocol": "file"} if place.startswith(("dir:///", "reference://")) else {}
    for call in (
        lambda: raymap.open(Address(place, options)),
        lambda: upload(b"x", Address(place, options)),
    ):
        with pytest.raises(NotARayMap, match="other file systems") as refused:
            call()
        assert "\n" not in str(refused.value)
    assert RangeHandler.sent == 0
    assert not list(tmp_path.iterdir())


def test_commands_refuse_caches_in_one_line(web: str, run: Any) -> None:
    code, _, error = run("info", f"simplecache::{web}/shards/0.raymap")
    assert code != 0
    assert "other file systems" in " ".join(error.split())
    assert "Traceback" not in error


def test_a_server_without_byte_ranges_is_named(folder: Path, web: str) -> None:
    RangeHandler.serves_ranges = False
    with pytest.raises(NotARayMap, match="serves byte ranges"):
        raymap.open(f"{web}/shards/0.raymap")


def test_a_broken_line_is_tried_again_and_then_damage(
    memory: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures = {"left": 1}

    def flaky(self: Any, path: str, start: int | None = None, end: int | None = None) -> bytes:
        if failures["left"] > 0:
            failures["left"] -= 1
            raise ConnectionResetError("line broke")
        return honest(self, path, start=start, end=end)

    system = type(fsspec.filesystem("memory"))
    honest = system.cat_file
    monkeypatch.setattr("raymap.bytes.remotebytes._PAUSE", 0.0)
    with raymap.open(f"{memory}/0.raymap") as there:
        monkeypatch.setattr(system, "cat_file", flaky)
        assert there.portions[0].read().n_rays == RAYS // 8
        failures["left"] = 10**6
        with pytest.raises(DamagedPortion, match="ConnectionResetError: line broke"):
            there.portions[1].read()


def test_a_map_that_grows_is_read_on(memory: str, tmp_path: Path) -> None:
    path = tmp_path / "growing.raymap"
    address = Address("memory://bucket/growing.raymap")
    writer = raymap.RayMapWriter.create(path, small_directory())
    writer.add_channel_set(RGB)
    writer.append(portion_at(0, 500, seed=1))
    upload(path.read_bytes(), address)
    with raymap.open(str(address)) as there:
        assert (there.rays, there.finished) == (500, False)
        writer.append(portion_at(500, 500, seed=2))
        writer.finish()
        upload(path.read_bytes(), address)
        assert there.refresh()
        assert (there.rays, there.finished) == (1000, True)
        assert there.portions[1].read().n_rays == 500


def test_closed_bytes_are_not_read(memory: str) -> None:
    source = RemoteBytes(Address(f"{memory}/0.raymap"))
    assert len(source.read(0, 8)) == 8
    assert source.read(source.size + 5, 8) == b""
    source.close()
    with pytest.raises(raymap.FormatError, match="closed"):
        source.read(0, 8)
