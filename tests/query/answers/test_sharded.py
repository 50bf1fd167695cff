"""Shards asked on the workers of an executor: the answers of a search here."""

from __future__ import annotations

import dataclasses
import multiprocessing
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest

import raymap
from query import select
from query.answers.paths.tables import path_table
from raymap.bytes.address import Address
from raymap.bytes.remotebytes import upload
from raymap.model.errors import DamagedPortion, RayMapError, UnknownName
from tests.raymap.maps import RGB, portion_at, small_directory

CRITERIA = [
    None,
    'hit("lens")',
    'hit("lens.front") & !hit("box")',
    'source("sun") | detected("sensor")',
    "length > 60 mm",
    'detected("sensor", rect(0, 0, 4, 5))',
    'hit("lens.#3")',
    'hit("box") & !hit("box")',
]


class Here(Executor):
    """Runs every task at once; counts them, and loses the first ones if told to."""

    def __init__(self, lose: int = 0) -> None:
        self.tasks, self.lose = 0, lose

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        self.tasks += 1
        future: Future[Any] = Future()
        try:
            if self.tasks <= self.lose:
                raise ConnectionError("the worker is gone")
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three shards whose portions interleave, one of them not finished."""
    place = tmp_path_factory.mktemp("shards")
    for number in range(3):
        writer = raymap.RayMapWriter.create(place / f"{number}.raymap", small_directory())
        writer.add_channel_set(RGB)
        writer.start_run(seed=7)
        for part in range(3):
            portion = portion_at(0, 300, seed=10 * number + part)
            portion = dataclasses.replace(portion, first_ray=1000 * part + 300 * number)
            writer.commit(writer.encode(portion, part))
        writer.close() if number == 1 else writer.finish()
    return place


@pytest.fixture
def shards(folder: Path) -> Iterator[raymap.RayMap]:
    with raymap.open(folder) as opened:
        yield opened


@pytest.mark.parametrize("criterion", CRITERIA)
def test_same_selection(shards: raymap.RayMap, criterion: str | None) -> None:
    for limit in (None, 1, 70, 10**6):
        mine = select(shards, criterion, limit=limit)
        executor = Here()
        there = select(shards, criterion, limit=limit, executor=executor)
        assert executor.tasks == 3
        assert (there.matched, there.rays) == (mine.matched, mine.rays)
        assert (there.flux, there.flux_se) == (mine.flux, mine.flux_se)
        assert there.limited == mine.limited
        assert there.complete
        assert np.array_equal(there.ray_ids, mine.ray_ids)
        assert there.reason == mine.reason
        if limit == 70:
            assert there.to_arrow().equals(mine.to_arrow())
    count = select(shards, criterion, rays=False, executor=Here())
    assert count.matched == select(shards, criterion).matched
    assert np.array_equal(count.ray_ids, select(shards, criterion).ray_ids)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("by", ["face", "object"])
def test_same_path_table(shards: raymap.RayMap, criterion: str | None, by: str) -> None:
    mine = path_table(shards, criterion, by=by)
    there = path_table(shards, criterion, by=by, executor=Here())
    assert there.n_paths == mine.n_paths
    assert there.to_json() == mine.to_json()
    if mine.n_paths:
        assert there.filter(min_rays=2).to_json(3) == mine.filter(min_rays=2).to_json(3)


def test_peaks(shards: raymap.RayMap) -> None:
    mine = path_table(shards, sort="peak", peak="sensor")
    there = path_table(shards, sort="peak", peak="sensor", executor=Here())
    assert there.to_json() == mine.to_json()


def test_other_processes_and_object_storage(folder: Path, shards: raymap.RayMap) -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = select(shards, CRITERIA[5], executor=pool)
    assert np.array_equal(there.ray_ids, select(shards, CRITERIA[5]).ray_ids)
    for path in folder.iterdir():
        upload(path.read_bytes(), Address("memory://asked") / path.name)
    with raymap.open("memory://asked") as stored:
        found = select(stored, CRITERIA[2], executor=Here())
        assert np.array_equal(found.ray_ids, select(shards, CRITERIA[2]).ray_ids)
        assert found.bytes_read > 0
    fsspec.filesystem("memory").rm("/asked", recursive=True)


def test_lost_workers_and_refusals(shards: raymap.RayMap, folder: Path, tmp_path: Path) -> None:
    found = select(shards, CRITERIA[1], executor=Here(lose=2))
    assert found.matched == select(shards, CRITERIA[1]).matched
    with pytest.raises(RayMapError, match=r"executor failed \(ConnectionError: the worker is gone"):
        select(shards, CRITERIA[1], executor=Here(lose=100))
    executor = Here()
    with pytest.raises(UnknownName):
        select(shards, 'hit("lense")', executor=executor)
    assert executor.tasks == 0
    # One map is asked here
    with raymap.open(folder / "0.raymap") as single:
        assert select(single, CRITERIA[1], executor=executor).matched
    assert executor.tasks == 0
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    with raymap.open(tmp_path) as gone:
        (tmp_path / "1.raymap").unlink()
        with pytest.raises(RayMapError, match="all machines share"):
            select(gone, executor=Here())


def test_damage_and_cancelling(folder: Path, tmp_path: Path) -> None:
    for path in folder.iterdir():
        data = bytearray(path.read_bytes())
        if path.name == "0.raymap":
            with raymap.open(path) as sound:
                entry = sound.portions[1].index
                stream = next(
                    e for e in sound.portions[1].stream_table() if e.name == "path_number"
                )
                data[entry.offset + stream.offset] ^= 0xFF
        (tmp_path / path.name).write_bytes(data)
    with raymap.open(tmp_path, on_damage="skip") as damaged:
        mine = select(damaged, "length > 60 mm")
    with raymap.open(tmp_path, on_damage="skip") as damaged:
        there = select(damaged, "length > 60 mm", executor=Here())
        assert (there.matched, there.rays, there.flux) == (mine.matched, mine.rays, mine.flux)
        assert there.damaged == mine.damaged
        assert there.damaged_portions == mine.damaged_portions
    with (
        raymap.open(tmp_path) as damaged,
        pytest.raises(DamagedPortion),
    ):
        select(damaged, "length > 60 mm", executor=Here())
    stop = threading.Event()
    with raymap.open(folder) as shards:
        part = select(shards, executor=Here(), progress=lambda _: stop.set(), cancel=stop)
        assert not part.complete
        assert 0 < part.rays < shards.rays
        assert part.matched == part.rays
        table = path_table(shards, executor=Here(), cancel=lambda: True)
        assert not table.complete
