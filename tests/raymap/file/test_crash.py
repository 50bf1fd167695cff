"""Whatever ends a recording, the portions completed before are served and the map goes on."""

from __future__ import annotations

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import raymap
from raymap.bytes import positional
from raymap.bytes.appender import ChunkAppender
from raymap.file.repair import repair
from raymap.file.verify import verify
from tests.raymap.maps import RGB, ids_of, portion_at, small_directory, write_small

_ROOT = Path(__file__).resolve().parents[3]
_RECORDER = """
import sys
import raymap
from tests.raymap.maps import RGB, portion_at, small_directory
with raymap.RayMapWriter.create(sys.argv[1], small_directory()) as writer:
    writer.add_channel_set(RGB)
    portion = portion_at(0, n_rays=2000)
    for k in range(int(sys.argv[2])):
        writer.append(portion)
        print(k, flush=True)
"""


def _check_and_continue(path):
    """What is there is sound, repairable, and can be continued; returns the rays before."""
    with raymap.open(path) as ray_map:
        assert not ray_map.finished
        rays = ray_map.rays
        assert not verify(ray_map).damage
        assert verify(ray_map).rays_readable == rays
        fixed = path.with_name("fixed.raymap")
        assert repair(ray_map, fixed, force=True) == len(ray_map.portions)
    with raymap.open(fixed) as ray_map:
        assert ray_map.finished
        assert ray_map.rays == rays
        assert ray_map.merged.paths.rays.sum() == rays
    with raymap.RayMapWriter.append_to(path) as writer:
        if not writer.channel_sets:
            writer.add_channel_set(RGB)
        writer.append(portion_at(writer.next_ray))
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        assert ray_map.rays == rays + 50
        assert list(ids_of(ray_map)[-2:]) == [rays + 48, rays + 49]
    return rays


@pytest.mark.parametrize("portions_before", [1, 4])
def test_sigkill_loses_no_completed_portion(tmp_path, portions_before):
    path = tmp_path / "a.raymap"
    command = [sys.executable, "-c", _RECORDER, str(path), "100000"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=_ROOT)
    assert process.stdout is not None
    for _ in range(portions_before):
        assert process.stdout.readline()
    time.sleep(0.003)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert _check_and_continue(path) >= 2000 * portions_before


def test_a_full_disk_ends_in_one_clear_line_and_a_sound_prefix(tmp_path, monkeypatch):
    path = tmp_path / "a.raymap"
    room = 60_000
    real = os.pwritev

    def pwritev(descriptor, buffers, offset):
        if offset >= room:
            raise OSError(errno.ENOSPC, "No space left on device")
        done = 0
        for buffer in buffers:
            part = memoryview(buffer)[: room - offset - done]
            if part.nbytes == 0:
                break
            done += real(descriptor, [part], offset + done)
        return done

    monkeypatch.setattr(positional, "_write_some", pwritev)
    writer = raymap.RayMapWriter.create(path, small_directory())
    writer.add_channel_set(RGB)

    def record():
        for k in range(1000):
            writer.append(portion_at(100 * k, n_rays=100, seed=k))

    with pytest.raises(raymap.RayMapError, match=r"disk is full.*--append"):
        record()
    with pytest.raises(raymap.RayMapError, match="disk is full"):
        writer.append(portion_at(10**6))
    with pytest.raises(raymap.RayMapError, match="disk is full"):
        writer.finish()
    writer.close()
    monkeypatch.undo()
    assert path.stat().st_size <= room
    with raymap.open(path) as ray_map:
        assert ray_map.torn_bytes == 0
        assert ray_map.rays >= 100
        assert not verify(ray_map).damage
    with raymap.RayMapWriter.append_to(path) as writer:
        writer.append(portion_at(writer.next_ray))


def test_a_real_limit_of_file_size_is_met_gracefully(tmp_path):
    path = tmp_path / "a.raymap"

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))

    command = [sys.executable, "-c", _RECORDER, str(path), "100000"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=_ROOT,
        preexec_fn=limit,
        check=False,
        env={**os.environ, "NUMBA_DISABLE_CACHING": "1"},
    )
    assert done.returncode == 1
    assert "cannot be continued" in done.stderr
    assert _check_and_continue(path) == 2000 * len(done.stdout.split())


def test_no_file_stays_behind_where_not_even_the_directory_fits(tmp_path, monkeypatch):
    def pwritev(descriptor, buffers, offset):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(positional, "_write_some", pwritev)
    with pytest.raises(raymap.RayMapError, match="disk is full"):
        raymap.RayMapWriter.create(tmp_path / "a.raymap", small_directory())
    assert not list(tmp_path.iterdir())


def test_an_exception_in_the_program_leaves_a_valid_map(tmp_path):
    path = tmp_path / "a.raymap"

    def record():
        with raymap.RayMapWriter.create(path, small_directory()) as writer:
            writer.add_channel_set(RGB)
            writer.append(portion_at(0))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record()
    assert _check_and_continue(path) == 50


@pytest.mark.parametrize("finish", [True, False])
def test_a_map_cut_anywhere_serves_what_is_complete(tmp_path, finish):
    path = tmp_path / "a.raymap"
    write_small(path, n_portions=3, n_rays=20, finish=finish)
    whole = path.read_bytes()
    with raymap.open(path) as ray_map:
        ends = [portion.offset + portion.stored_bytes for portion in ray_map.portions]
        first = ray_map.portions[0].offset
    cut = tmp_path / "cut.raymap"
    boundaries = {end + step for end in ends for step in (-1, 0, 1, 5, 8, 31, 32, 33)}
    for size in sorted({*boundaries, *range(first, len(whole), 997)} - {len(whole)}):
        if size > len(whole):
            continue
        cut.write_bytes(whole[:size])
        with raymap.open(cut) as ray_map:
            assert not ray_map.finished
            assert len(ray_map.portions) == sum(end <= size for end in ends)
            assert ray_map.rays == 20 * len(ray_map.portions)
    for size in range(0, first, 101):
        cut.write_bytes(whole[:size])
        try:
            with raymap.open(cut) as ray_map:
                assert ray_map.rays == 0
        except raymap.NotARayMap:
            pass


def test_the_writer_owns_what_it_appends(tmp_path):
    appender = ChunkAppender.create(tmp_path / "a")
    assert appender.append([b"abc", b"", memoryview(b"defg")]) == 0
    assert appender.append([bytes([k]) for k in range(256)] * 5) == 7
    assert appender.end == 7 + 1280
    appender.close()
    assert (tmp_path / "a").read_bytes() == b"abcdefg" + bytes(range(256)) * 5
