"""Reading and writing at places, with the system's calls for it and without."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import raymap
from raymap.bytes import positional
from raymap.model.errors import RayMapError
from tests.raymap.maps import small_directory, write_small
from tests.strategies import assert_same_portion


@pytest.fixture(params=["at a place", "after moving there"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The calls of POSIX, or what stands in for them on Windows."""
    if request.param != "at a place":
        monkeypatch.setattr(positional, "_read_some", positional._move_and_read)
        monkeypatch.setattr(positional, "_write_some", positional._move_and_write)
    return str(request.param)


def test_many_threads_read_and_write_one_file(tmp_path: Path, way: str) -> None:
    content = np.random.default_rng(4).bytes(1 << 18)
    descriptor = os.open(tmp_path / "a", os.O_RDWR | os.O_CREAT)
    size = 1 << 11
    starts = range(0, len(content), size)

    def put(start: int) -> None:
        views = [memoryview(content)[start : start + 7], memoryview(content)[start + 7 :]]
        left, at = [views[0], views[1][: size - 7]], start
        while left:
            done = positional.write_at(descriptor, left, at)
            at += done
            while left and done >= left[0].nbytes:
                done -= left.pop(0).nbytes
            if done:
                left[0] = left[0][done:]

    try:
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(put, starts))
            assert (tmp_path / "a").read_bytes() == content
            found = pool.map(lambda start: positional.read_at(descriptor, size, start), starts)
            assert b"".join(found) == content
        assert positional.read_at(descriptor, 10, len(content) - 4) == content[-4:]
        assert positional.read_at(descriptor, 10, len(content)) == b""
    finally:
        os.close(descriptor)


def test_a_map_is_the_same_either_way(tmp_path: Path, way: str) -> None:
    path = tmp_path / "a.raymap"
    written = write_small(path, n_portions=6)
    with raymap.open(path) as ray_map, ThreadPoolExecutor(4) as pool:
        assert ray_map.finished
        found = pool.map(lambda stored: stored.read(), ray_map.portions)
        for expected, portion in zip(written, found, strict=True):
            assert_same_portion(expected, portion)


def test_a_map_that_cannot_be_removed_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.raymap"
    write_small(path)
    before = path.read_bytes()

    def refuse(self: Path, missing_ok: bool = False) -> None:
        raise PermissionError(13, "in use by another process")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", refuse)
        with pytest.raises(RayMapError, match=r"cannot be replaced \(in use by another process\)"):
            raymap.RayMapWriter.create(path, small_directory(), force=True)
    assert path.read_bytes() == before
