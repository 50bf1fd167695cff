"""Requests that cost the service more than the client: each is bounded, and the next is served."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.flight as flight
import pytest

import raymap
from raymap.model.errors import RayMapError
from service import Limits
from service.answers.results import check_done, check_progress, check_scene, read_png
from service.files.confine import OutsideFolder, ServedFolder
from service.files.disk import LEDGER, Disk
from service.front import Frames, Refused, Sieve, Streams, Total
from service.limits import Busy, OutOfTime, Shares
from service.processes.workers import Bounds, Workers
from tests.service import http2
from tests.service.conftest import TOKEN, Starter
from tests.service.hostile import write_large_map
from tests.service.http2 import PREFACE, frame


def message(size: int, sent: int, flag: int = 0) -> bytes:
    """The beginning of a gRPC message: flag, length, some of its bytes."""
    return bytes([flag]) + size.to_bytes(4, "big") + b"x" * sent


def test_frames_in_any_pieces() -> None:
    data = frame(1, 4, 1, b"abc") + frame(0, 0, 1, b"x" * 300) + frame(4, 0, 0) + frame(0, 1, 1)
    for step in (1, 2, 7, 9, 10, 1000):
        frames, found = Frames(), []
        for at in range(0, len(data), step):
            found += frames.take(data[at : at + step])
        assert frames.at_boundary
        whole: list[tuple[Any, ...]] = []
        payload = b""
        for kind, flags, stream, part, last in found:
            payload += part
            if last:
                whole.append((kind, flags, stream, payload))
                payload = b""
        assert whole == [
            (1, 4, 1, b"abc"), (0, 0, 1, b"x" * 300), (4, 0, 0, b""), (0, 1, 1, b""),
        ]  # fmt: skip


def test_messages_are_judged_by_their_first_bytes() -> None:
    def sieve(**options: Any) -> Sieve:
        made = Sieve(Streams(options.pop("streams", 4)), 1000, options.pop("total", Total(2500)))
        made.take(PREFACE)
        return made

    with pytest.raises(Refused, match="no gRPC"):
        Sieve(Streams(4), 1000, Total(1)).take(b"GET / HTTP/1.1\r\n\r\n")
    with pytest.raises(Refused, match="1001 bytes; at most 1000"):
        sieve().take(frame(1, 4, 1) + frame(0, 0, 1, message(1001, 0)))
    with pytest.raises(Refused, match="compressed"):
        sieve().take(frame(1, 4, 1) + frame(0, 0, 1, message(10, 0, flag=1)))
    with pytest.raises(Refused, match="more than 4 requests"):
        sieve().take(b"".join(frame(1, 4, stream) for stream in (1, 3, 5, 7, 9)))
    for text in (b"\x1b[2J", b"a\nb", b"\xff"):
        for step in (3, 9, 100):
            data = frame(7, 0, 0, bytes(8) + text)
            pieces = [data[at : at + step] for at in range(0, len(data), step)]
            with pytest.raises(Refused, match="plain text"):
                list(map(sieve().take, pieces))
    sieve().take(frame(7, 0, 0, bytes(8) + b"so long") + frame(7, 0, 0, bytes(8)))
    # Unfinished messages of all connections count together, until they are whole or given up
    total = Total(2500)
    one, other = sieve(total=total), sieve(total=total)
    one.take(frame(1, 4, 1) + frame(0, 0, 1, message(1000, 1)))
    other.take(frame(1, 4, 1) + frame(0, 0, 1, message(1000, 1)))
    with pytest.raises(Refused, match="too many large messages"):
        other.take(frame(1, 4, 3) + frame(0, 0, 3, message(1000, 1)))
    other.close()
    assert total.taken == 1000
    one.take(frame(0, 0, 1, b"x" * 999))
    assert total.taken == 0
    # Several messages of one stream, an end, and a new one
    for number in range(100):
        stream = 2 * number + 3
        one.take(frame(1, 4, stream) + frame(0, 1, stream, message(600, 600) + message(10, 10)))
        one.streams.end(stream, "server")
    assert total.taken == 0
    assert list(one.streams.opened) == [1]


def test_requests_that_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice as many as may be open, at once; then as many in a second."""
    sieve = Sieve(Streams(4), 1000, Total(2500))
    sieve.take(PREFACE)
    numbers = iter(range(1, 10_000, 2))

    def give_up(often: int) -> None:
        for _ in range(often):
            stream = next(numbers)
            sieve.take(frame(1, 4, stream) + frame(3, 0, stream, bytes(4)))

    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now)
    give_up(8)
    now += 1.0
    give_up(4)
    # What has ended on both sides, or was never begun, may be given up as often as one likes
    for _ in range(100):
        stream = next(numbers)
        sieve.take(frame(1, 4 | 1, stream))
        sieve.streams.end(stream, "server")
        sieve.take(frame(3, 0, stream, bytes(4)) + frame(3, 0, 9_999, bytes(4)))
    with pytest.raises(Refused, match="begun and given up"):
        give_up(1)
    now += 100.0
    give_up(8)
    # The one that was refused ends with its connection
    assert len(sieve.streams.opened) == 1


@pytest.mark.parametrize("more", [b"", b"x" * 100], ids=["empty", "full"])
def test_headers_that_go_on(more: bytes) -> None:
    for step in (5, 50_000):
        sieve = Sieve(Streams(4), 1000, Total(2500))
        sieve.take(PREFACE)
        # Whole ones pass, again and again
        for stream in range(1, 2001, 2):
            sieve.take(frame(1, 1, stream, more) + frame(9, 4, stream, more))
            sieve.streams.end(stream, "server")
        data = frame(1, 0, 3001) + frame(9, 0, 3001, more) * (2**16 // (len(more) + 9) + 1)
        pieces = [data[at : at + step] for at in range(0, len(data), step)]
        with pytest.raises(Refused, match="headers of more than"):
            list(map(sieve.take, pieces))


def unread(address: str, data: bytes) -> bytes:
    """What a connection says to some bytes before it is closed."""
    host, _, port = address.removeprefix("grpc://").rpartition(":")
    with socket.create_connection((host, int(port)), timeout=20) as raw:
        said = b""
        try:
            raw.sendall(data)
            while part := raw.recv(65536):
                said += part
        except ConnectionError:
            pass
        return said


def test_large_messages_without_a_token(start: Starter) -> None:
    """Refused by the five bytes before a message: what follows is never taken in."""
    service = start()
    begun = PREFACE + frame(4, 0, 0) + frame(1, 4, 1, b"") + frame(0, 0, 1, message(600_000_000, 0))
    said = unread(service.address, begun)
    assert b"at most 8388608 are taken" in said
    # A client waits for ever unless it says how long; this one is refused at once
    patience = flight.FlightCallOptions(timeout=300)
    large = flight.Action("hello", b" " * 20_000_000)
    with flight.connect(service.address) as plain, pytest.raises(flight.FlightUnavailableError):
        list(plain.do_action(large, patience))
    with raymap.connect(service.address, token=TOKEN) as client:
        assert client.files()


def test_connections_that_say_nothing(start: Starter) -> None:
    service = start(limits=Limits(connections=3, spare_workers=0))
    host, port = "localhost", int(service.address.rpartition(":")[2])
    silent = [socket.create_connection((host, port)) for _ in range(12)]
    try:
        with raymap.connect(service.address, token=TOKEN) as client:
            assert client.open("small.raymap").query().matched > 0
    finally:
        for each in silent:
            each.close()
    assert unread(service.address, b"GET / HTTP/1.1\r\n\r\n" * 3) is not None


def test_a_reader_that_does_not_read(start: Starter, folder: Path) -> None:
    """It asks for 20 MB with windows as wide as they can be, takes nothing, and is cut off."""
    write_large_map(folder / "large.raymap", 3)
    service = start(limits=Limits(stall_seconds=1.0, streams=2, client_streams=1, spare_workers=0))
    asked = {"map": "large.raymap"}
    with http2.connect(service.address, narrow=True) as raw:
        wanted = http2.ticket({"get": "rays", **asked})
        raw.sendall(http2.greeting() + http2.asks("DoGet", TOKEN, wanted))
        assert raw.recv(1)
        front = service._front
        assert front is not None
        begun = 0
        for _ in range(600):
            begun += service.metrics.running() > 0
            if begun and not front._connections:
                break
            time.sleep(0.05)
        taken, ended = http2.take_all(raw, 20.0)
    assert ended
    assert taken < 10e6
    with raymap.connect(service.address, token=TOKEN) as client:
        for _ in range(100):
            # What was being sent ends a moment after its reader
            with contextlib.suppress(flight.FlightUnavailableError):
                assert client.stream("rays", asked).read_all().nbytes > 20e6
                break
            time.sleep(0.1)
        else:
            raise AssertionError("the place of the reader was not given back")


def test_a_writer_that_does_not_end(start: Starter) -> None:
    """Neither its message nor its headers; it is cut off, token or not."""
    service = start(limits=Limits(stall_seconds=1.0, spare_workers=0))
    token = http2.headers("DoPut", TOKEN)
    begun = [
        http2.frame(http2.HEADERS, http2.END_HEADERS, 1, token),
        http2.frame(http2.HEADERS, http2.END_HEADERS, 1, token)
        + http2.frame(http2.DATA, 0, 1, http2.message(1000, b"x")),
        http2.frame(http2.HEADERS, 0, 1, http2.headers("DoPut", None)),
    ]
    for data in begun:
        with http2.connect(service.address) as raw:
            raw.sendall(http2.greeting() + data)
            assert http2.take_all(raw, 30.0)[1]


def test_who_never_asked_gives_way(start: Starter) -> None:
    """All places are taken by connections that begin requests and do not end them."""
    service = start(limits=Limits(connections=3, spare_workers=0))
    begun = http2.frame(http2.HEADERS, 0, 1, http2.headers("DoPut", None))
    held = [http2.connect(service.address) for _ in range(9)]
    try:
        for raw in held:
            with contextlib.suppress(OSError):
                raw.sendall(http2.greeting() + begun)
        with raymap.connect(service.address, token=TOKEN) as client:
            assert client.open("small.raymap").query().matched > 0
    finally:
        for raw in held:
            raw.close()


def test_shares() -> None:
    shares = Shares(3, 2, "streams")
    with shares.one("a"), shares.one("a"), shares.one("b"):
        with pytest.raises(Busy, match="2 streams of yours"), shares.one("a"):
            pass
        with pytest.raises(Busy, match="3 streams are under way"), shares.one("b"):
            pass
    with shares.one("a"):
        pass


def test_disk_quota(tmp_path: Path) -> None:
    disk = Disk(ServedFolder(tmp_path), Limits(disk_bytes=10_000, spare_bytes=0))
    target = tmp_path / "a"
    with disk.writing(target, target, keeps=False):
        target.write_bytes(b"x" * 6000)
        assert disk.room() == 4000
    assert disk.room() == 4000
    with disk.writing(target, target, keeps=True):
        target.write_bytes(b"x" * 7000)
        assert disk.room() == 3000
    # Written over, the old bytes no longer count
    beside = tmp_path / "beside"
    with disk.writing(beside, target, keeps=False):
        beside.write_bytes(b"x" * 5000)
        beside.replace(target)
    assert disk.room() == 5000
    with pytest.raises(RayMapError, match="no room"):
        disk.check("upload", 5001)
    # What the owner removes while the service runs makes room
    removed = tmp_path / "removed"
    with disk.writing(removed, removed, keeps=False):
        removed.write_bytes(b"x" * 4500)
    with pytest.raises(RayMapError, match="no room"):
        disk.check("upload", 4096)
    removed.unlink()
    disk.check("upload", 4096)
    few = Disk(ServedFolder(tmp_path), Limits(written_files=1, spare_bytes=0))
    with pytest.raises(RayMapError, match="1 files"):
        few.check("upload")
    # A new start makes no new room; what the owner removes does
    again = Disk(ServedFolder(tmp_path), Limits(disk_bytes=10_000, spare_bytes=0))
    assert again.room() == 5000
    # Written when the service was killed
    killed = tmp_path / "killed"
    killed_while = again.writing(killed, killed, keeps=False)
    with contextlib.ExitStack() as stack:
        stack.enter_context(killed_while)
        killed.write_bytes(b"x" * 4500)
        third = Disk(ServedFolder(tmp_path), Limits(disk_bytes=10_000, spare_bytes=0))
        assert third.room() == 500
    killed.unlink()
    assert Disk(ServedFolder(tmp_path), Limits(disk_bytes=10_000, spare_bytes=0)).room() == 5000
    for wrong in ("", "[]", '{"files": []}', '{"files": {"../x": 1}}', '{"files": {"x": -1}}'):
        broken = tmp_path / "broken"
        broken.mkdir(exist_ok=True)
        (broken / LEDGER).write_text(wrong)
        with pytest.raises(RayMapError, match="remove it to begin at nothing"):
            Disk(ServedFolder(broken), Limits())
    # Empty files are not free
    for name in ("b", "c"):
        with disk.writing(tmp_path / name, tmp_path / name, keeps=False):
            (tmp_path / name).touch()
    with pytest.raises(RayMapError, match="no room"):
        disk.check("upload")
    # What the owner put there before does not count, what is added to it does
    apart = tmp_path / "apart"
    apart.mkdir()
    owners = apart / "owner"
    owners.write_bytes(b"x" * 50_000)
    other = Disk(ServedFolder(apart), Limits(disk_bytes=10_000, spare_bytes=0))
    for size in (55_000, 56_000):
        with other.writing(owners, owners, keeps=True):
            owners.write_bytes(b"x" * size)
        assert other.room() == 60_000 - size
    assert Disk(ServedFolder(tmp_path), Limits(spare_bytes=2**62)).room() < 0


def test_uploads_within_the_quota(start: Starter, folder: Path) -> None:
    service = start(limits=Limits(disk_bytes=1_000_000, spare_workers=0))
    with raymap.connect(service.address, token=TOKEN) as client:
        client.upload_text("x" * 600_000, "a.stl")
        with pytest.raises(RayMapError, match="there is no room"):
            client.upload_text("x" * 600_000, "b.stl")
        client.upload_text("x" * 700_000, "a.stl", force=True)
    assert sorted(path.name for path in folder.glob("*.stl")) == ["a.stl"]
    assert [path.name for path in folder.glob(".*")] == [LEDGER]


def test_folders_within_the_quota(start: Starter, folder: Path) -> None:
    """Folders that an upload makes count as files, whatever becomes of it."""
    service = start(limits=Limits(written_files=20, spare_workers=0))

    def folders() -> list[Path]:
        return [path for path in folder.rglob("*") if path.is_dir()]

    before = len(folders())
    with raymap.connect(service.address, token=TOKEN) as client:
        with pytest.raises(RayMapError, match="more than 16 folders"):
            client.upload_text("x", "/".join(["a"] * 17) + "/x.stl")
        assert len(folders()) == before
        client.upload_text("x", "a/b/c/x.stl")
        client.upload_text("x", "a/b/c/y.stl")
        with pytest.raises(RayMapError, match="20 files"):
            client.upload_text("x", "/".join(["b"] * 16) + "/x.stl")
        for number in range(5):
            name = json.dumps({"file": f"{number}/{number}/z.stl"}).encode()
            with pytest.raises(RayMapError, match="must be binary"):
                _put_numbers(service.address, name)
        assert len(folders()) == before + 13
        for number in range(5, 12):
            with contextlib.suppress(RayMapError):
                _put_numbers(service.address, json.dumps({"file": f"{number}/z.stl"}).encode())
        # With the two files they are 19: room for a file, not for a folder with one
        assert len(folders()) == before + 17
    # A new start counts them again; what its owner removes makes room
    disk = Disk(ServedFolder(folder), Limits(written_files=20))
    with pytest.raises(RayMapError, match="20 files"):
        disk.check("upload", folders=3)
    for number in range(5):
        shutil.rmtree(folder / str(number))
    disk.check("upload", folders=3)


def _put_numbers(address: str, command: bytes) -> None:
    """An upload whose column holds no files."""
    options = flight.FlightCallOptions(
        headers=[(b"authorization", f"Bearer {TOKEN}".encode())], timeout=60
    )
    with flight.connect(address) as plain:
        descriptor = flight.FlightDescriptor.for_command(command)
        try:
            batch = pa.record_batch({"v": [1]})
            writer, reader = plain.do_put(descriptor, batch.schema, options)
            writer.write_batch(batch)
            writer.done_writing()
            reader.read()
            writer.close()
        except pa.ArrowException as error:
            raise RayMapError(str(error)) from None


def bounds(**options: Any) -> Bounds:
    given = {"seconds": 60.0, "memory_bytes": 2**33, "file_bytes": 2**28, "threads": 1,
             "option": "--scene-seconds", **options}  # fmt: skip
    return Bounds(**given)


def job(folder: Path, text: str) -> dict[str, Any]:
    return {
        "folder": str(folder), "scene": None, "text": text, "scene_files_bytes": 2**30,
        "selected": {"variants": [], "simulation": None},
    }  # fmt: skip


def test_workers_end_in_time_and_with_their_client(folder: Path) -> None:
    workers = Workers(spares=False)
    asked = job(folder, (folder / "scene.toml").read_text())
    began = time.monotonic()
    with pytest.raises(OutOfTime, match=r"0\.2 s that this service allows"):
        workers.ask("scene", asked, bounds(seconds=0.2), lambda: False)
    with pytest.raises(OutOfTime, match="the client has gone"):
        workers.ask("scene", asked, bounds(), lambda: True)
    assert time.monotonic() - began < 50
    with pytest.raises(RayMapError, match="16 MiB of memory"):
        workers.ask("scene", asked, bounds(memory_bytes=2**24), lambda: False)
    with pytest.raises(RayMapError, match=r"no scene file 'none\.toml'"):
        workers.ask("scene", {**asked, "scene": "none.toml"}, bounds(), lambda: False)


def test_answers_of_workers_are_checked() -> None:
    for check in (check_done, check_progress, check_scene):
        for told in (None, {}, [], {"rays": -1}, {"rays": "1"}):
            with pytest.raises(RayMapError, match="nonsense"):
                check(told)
    for told in (None, {}, {"png": 3}, {"png": "####"}, {"png": "AAAA"}):
        with pytest.raises(RayMapError, match="no picture"):
            read_png(told)


def test_a_recording_stopped_by_the_quota_is_a_valid_map(start: Starter, folder: Path) -> None:
    service = start(limits=Limits(disk_bytes=3_000_000, end_seconds=60, spare_workers=0))
    with raymap.connect(service.address, token=TOKEN) as client:
        done = None
        # Which of the two bounds comes first, the watch or the system, is chance
        with contextlib.suppress(RayMapError):
            done = client.record("scene.toml", "long.raymap", rays=10**8, seed=3)
        assert done is None or done.interrupted
    with raymap.open(folder / "long.raymap", on_damage="skip") as found:
        assert found.rays > 0
        assert (folder / "long.raymap").stat().st_size <= 3_100_000


def test_a_recording_ended_by_force_is_a_valid_map(folder: Path) -> None:
    """Where it does not end when it is asked to, what it has written by then stays."""
    target = folder / "long.raymap"
    asked = {
        **job(folder, (folder / "scene.toml").read_text()), "map": str(target), "threads": 1,
        "options": {"rays": 10**10, "seconds": None, "seed": 1, "append": False, "force": False},
    }  # fmt: skip

    def gone() -> bool:
        # A portion is written in pieces: wait until there is a whole one
        if not target.exists() or target.stat().st_size < 1_000_000:
            return False
        with raymap.open(target, on_damage="skip") as written:
            return written.rays > 0

    with pytest.raises(OutOfTime, match="the client has gone"):
        list(Workers(spares=False).run("record", asked, bounds(end_seconds=0.0), gone))
    with raymap.open(target, on_damage="skip") as found:
        assert found.rays > 0


def test_no_link_takes_the_place_of_what_is_written(folder: Path) -> None:
    """Links that appear while a client writes change nothing outside the folder."""
    outside = folder.parent / "outside"
    outside.mkdir()
    served = ServedFolder(folder)
    (folder / "inner").mkdir()
    target = served.path("inner/new.stl")
    with served.holding(target.parent) as held:
        (folder / "inner").rename(folder / "moved")
        (folder / "inner").symlink_to(outside)
        with os.fdopen(held.create("new.stl"), "wb") as file:
            file.write(b"solid")
        held.replace("new.stl", "other.stl")
    assert list(outside.iterdir()) == []
    assert (folder / "moved" / "other.stl").read_bytes() == b"solid"
    with pytest.raises(OutsideFolder, match="link"), served.holding(target.parent):
        pass
    with served.holding(folder) as held:
        (folder / "link.raymap").symlink_to(outside / "made.raymap")
        with pytest.raises(OutsideFolder, match="link"):
            held.open_to_write("link.raymap")
        with pytest.raises(FileExistsError):
            held.create("link.raymap")
        os.mkfifo(folder / "pipe.raymap")
        with pytest.raises(OutsideFolder):
            held.open_to_write("pipe.raymap")
    assert list(outside.iterdir()) == []


def test_a_map_that_is_continued_stays_the_one_that_was_looked_at(folder: Path) -> None:
    """A link is put in its place again and again while recordings continue it."""
    text = (folder / "scene.toml").read_text()
    target, secret = folder / "long.raymap", folder.parent / "secret.raymap"
    options = {"rays": 500, "seconds": None, "seed": 1, "append": False, "force": False}
    asked = {**job(folder, text), "map": str(target), "threads": 1, "options": options}
    workers = Workers(spares=False)
    workers.ask("record", asked, bounds(), lambda: False)
    secret.write_bytes(target.read_bytes())
    outside = secret.read_bytes()
    ended = threading.Event()
    aside = folder / "aside.raymap"

    def swap() -> None:
        while not ended.is_set():
            target.rename(aside)
            # A recording may have begun a map of its own where there is none for a moment
            with contextlib.suppress(FileExistsError):
                target.symlink_to(secret)
            target.unlink()
            aside.rename(target)

    swapping = threading.Thread(target=swap)
    swapping.start()
    continued, said = 0, []
    try:
        for _ in range(4):
            try:
                more = {**asked, "options": {**options, "append": True, "seed": None}}
                answer = workers.ask("record", more, bounds(), lambda: False)
                continued += answer["done"]["rays"] > 0
            except RayMapError as error:
                said.append(str(error))
    finally:
        ended.set()
        swapping.join()
    assert not [line for line in said if str(folder) in line or "/dev/fd" in line]
    assert secret.read_bytes() == outside
    with raymap.open(target) as found:
        assert found.rays >= 500
    done = workers.ask("record", {**asked, "options": {**options, "append": True, "seed": None}},
                       bounds(), lambda: False)  # fmt: skip
    assert done["done"]["rays"] == 500
