"""Traces on many machines: the rays of one machine, whatever becomes of the workers."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest
from distributed import Client, LocalCluster
from typer.testing import CliRunner

import raymap
from raymap.cli import application
from raymap.model.errors import MapExists, MapLocked, RayMapError, SceneError, SceneMismatch
from raymap.remote.cluster import scheduler_executor, worker_count
from tests.scenes import MIRROR_BALL
from tracer.run.natural import NaturalTrace
from tracer.run.recording import record
from tracer.run.results import Progress
from tracer.run.shard_tasks import pack, unpack
from tracer.run.sharding import record_shards
from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.load import load_scene, parse_scene

GLASS_AND_SPLITS = """
[trace]
mode = "weighted"
split_depth = 2
rays_per_emission = 8
[media.glass]
index = 1.5
[surfaces.glass]
kind = "dielectric"
"""
RAYS = 6_000


class Here(Executor):
    """Runs every task at once, in this process, as if it were another machine."""

    _max_workers = 2

    def __init__(self, before: Callable[[int], None] | None = None) -> None:
        self.tasks = 0
        self.before = before

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.tasks += 1
        try:
            if self.before is not None:
                self.before(self.tasks)
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


@pytest.fixture(scope="module")
def scene() -> Compilation:
    return compile_scene(parse_scene(MIRROR_BALL))


@pytest.fixture(scope="module")
def alone(scene: Compilation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one machine records."""
    path = tmp_path_factory.mktemp("alone") / "alone.raymap"
    record(scene, path, rays=RAYS, threads=1)
    return path


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """Two worker processes, as on two machines."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as running:
        yield running


def columns(place: Any) -> dict[str, np.ndarray]:
    with raymap.open(place) as stored:
        portions = [portion.read() for portion in stored.portions]
        found = {"ids": np.concatenate([p.ray_ids() for p in stored.portions])}
        found["emitted"] = stored.emitted
        found["sums"] = stored.detector_result("screen")[0]
    names = ("position", "normal", "object", "triangle", "event", "medium", "descriptor_count")
    found |= {name: np.concatenate([getattr(p, name) for p in portions]) for name in names}
    found["uv"] = np.concatenate([p.descriptors.uv for p in portions])
    return found


def assert_same(place: Any, alone: Path) -> None:
    mine, other = columns(place), columns(alone)
    for name, values in other.items():
        if name == "sums":
            # Shards divide before they add
            assert np.allclose(mine[name], values, rtol=1e-12, atol=0)
        else:
            assert np.array_equal(mine[name], values), name


def test_shards_hold_the_rays_of_one_machine(
    scene: Compilation, alone: Path, tmp_path: Path
) -> None:
    reports: list[Progress] = []
    result = record_shards(
        scene, tmp_path / "a", Here(), rays=RAYS, seconds=None, seed=None, shard_rays=1_700,
        progress=reports.append,
    )  # fmt: skip
    assert result.rays == RAYS == reports[-1].rays
    assert len(list((tmp_path / "a").iterdir())) == 4
    assert_same(tmp_path / "a", alone)
    audit = result.audit["lamp"]
    assert sum(audit.values()) - audit["emitted"] == audit["emitted"] == RAYS
    # Meshes for pictures are stored once
    with raymap.open(tmp_path / "a") as stored:
        assert [bool(shard.meshes) for shard in stored.shards] == [True, False, False, False]
        assert stored.meshes


def test_worker_lost_in_the_middle(
    scene: Compilation, alone: Path, tmp_path: Path, cluster: LocalCluster
) -> None:
    killed: list[int] = []

    def kill_one(progress: Progress) -> None:
        if not killed:
            with Client(cluster) as client:
                killed.extend(client.run(os.getpid).values())
            os.kill(killed[0], signal.SIGKILL)

    with scheduler_executor(cluster.scheduler_address) as executor:
        assert worker_count(executor) == 2
        result = record_shards(
            scene, tmp_path / "a", executor, rays=RAYS, seconds=None, seed=None, shard_rays=500,
            progress=kill_one,
        )  # fmt: skip
    assert killed
    assert result.rays == RAYS
    assert_same(tmp_path / "a", alone)
    assert all(path.suffix == ".raymap" for path in (tmp_path / "a").iterdir())


def test_command_with_a_scheduler(alone: Path, tmp_path: Path, cluster: LocalCluster) -> None:
    (tmp_path / "scene.toml").write_text(MIRROR_BALL)
    command = ["record", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "a"), "--rays",
               str(RAYS), "--scheduler", cluster.scheduler_address, "--json"]  # fmt: skip
    answer = CliRunner().invoke(application(), command)
    assert answer.exit_code == 0, answer.output
    assert f'"rays": {RAYS}' in answer.stdout
    assert_same(tmp_path / "a", alone)
    # And asked there
    for command in (["query", "--count"], ["paths"]):
        asked = [command[0], str(tmp_path / "a"), 'hit("ball", reflected)', *command[1:], "--json"]
        here = json.loads(CliRunner().invoke(application(), asked).stdout)
        spread = [*asked, "--scheduler", cluster.scheduler_address]
        there = json.loads(CliRunner().invoke(application(), spread).stdout)
        if command[0] == "query":
            assert there["matched"] == here["matched"] > 0
            assert there["flux"] == here["flux"]
        else:
            assert there == here


@pytest.mark.slow
def test_process_pool_takes_part(scene: Compilation, alone: Path, tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        record(scene, tmp_path / "a", rays=RAYS, executor=pool)
    assert_same(tmp_path / "a", alone)


def test_workers_elsewhere_send_their_shards(
    scene: Compilation, alone: Path, tmp_path: Path
) -> None:
    class Elsewhere(Here):
        """A machine that does not see the folder."""

        def submit(self, function: Any, /, task: Any) -> Future[Any]:
            return super().submit(function, replace(task, folder=tmp_path / "not there"))

    record(scene, tmp_path / "a", rays=RAYS, executor=Elsewhere())
    assert_same(tmp_path / "a", alone)


def test_shards_go_to_object_storage(scene: Compilation, alone: Path) -> None:
    record(scene, "memory://traces/a", rays=RAYS, executor=Here())
    assert_same("memory://traces/a", alone)
    with pytest.raises(MapExists, match="--append"):
        record(scene, "memory://traces/a", rays=10, executor=Here())
    record(scene, "memory://traces/a", rays=10, executor=Here(), force=True)
    with raymap.open("memory://traces/a") as stored:
        assert stored.rays == 10
    fsspec.filesystem("memory").rm("/traces", recursive=True)


def test_continued_folder(scene: Compilation, alone: Path, tmp_path: Path) -> None:
    record(scene, tmp_path / "a", rays=RAYS - 1_000, executor=Here())
    with pytest.raises(MapExists, match="holds 1 maps"):
        record(scene, tmp_path / "a", rays=10, executor=Here())
    record(scene, tmp_path / "a", rays=1_000, executor=Here(), append=True)
    assert_same(tmp_path / "a", alone)
    other = compile_scene(parse_scene(MIRROR_BALL.replace("0.7", "0.8")))
    with pytest.raises(SceneMismatch):
        record(other, tmp_path / "a", rays=10, executor=Here(), append=True)


def test_a_failing_task_is_tried_again_and_at_last_named(
    scene: Compilation, alone: Path, tmp_path: Path
) -> None:
    def fail_twice(number: int) -> None:
        if number in (2, 3):
            raise ConnectionError("the worker is gone")

    record_shards(
        scene, tmp_path / "a", Here(fail_twice), rays=RAYS, seconds=None, seed=None,
        shard_rays=2_000,
    )  # fmt: skip
    assert_same(tmp_path / "a", alone)

    def fail_later(number: int) -> None:
        if number > 1:
            raise ConnectionError("the worker is gone")

    with pytest.raises(RayMapError, match=r"rays \d+ to \d+ could not be traced") as failure:
        record_shards(
            scene, tmp_path / "b", Here(fail_later), rays=RAYS, seconds=None, seed=None,
            shard_rays=2_000,
        )  # fmt: skip
    assert "2000 rays are complete" in str(failure.value)
    assert "\n" not in str(failure.value)
    with raymap.open(tmp_path / "b") as stored:
        assert stored.rays == 2_000


def test_errors_of_the_scene_are_not_tried_again(scene: Compilation, tmp_path: Path) -> None:
    def refuse(number: int) -> None:
        raise SceneError("the mirror is broken")

    executor = Here(refuse)
    with pytest.raises(SceneError, match="mirror is broken"):
        record(scene, tmp_path / "a", rays=100, executor=executor)
    assert executor.tasks <= 2


def test_cancelled_and_timed(scene: Compilation, tmp_path: Path) -> None:
    seen: list[int] = []
    result = record_shards(
        scene, tmp_path / "a", Here(), rays=RAYS, seconds=None, seed=None, shard_rays=500,
        progress=lambda progress: seen.append(progress.rays), cancel=lambda: len(seen) >= 2,
    )  # fmt: skip
    assert result.interrupted
    assert 1_000 <= result.rays < RAYS
    with raymap.open(tmp_path / "a") as stored:
        assert stored.rays == result.rays
    timed = record_shards(
        scene, tmp_path / "b", Here(), rays=None, seconds=0.3, seed=3, shard_rays=200
    )
    assert timed.rays > 0
    assert timed.seed == 3


def test_refused_in_one_line(
    scene: Compilation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("raymap.remote.cluster.CONNECT_SECONDS", 1)
    with pytest.raises(SceneError, match="name a folder"):
        record(scene, tmp_path / "a.raymap", rays=10, executor=Here())
    (tmp_path / "file").write_text("")
    with pytest.raises(MapExists, match="is a file"):
        record(scene, tmp_path / "file", rays=10, executor=Here())
    with pytest.raises(SceneError, match="no_rays"):
        record(scene, None, no_rays=True, rays=10, executor=Here())

    def record_beside(number: int) -> None:
        record(scene, tmp_path / "a", rays=10, executor=Here(), append=True)

    with pytest.raises(MapLocked, match="another program records"):
        record(scene, tmp_path / "a", rays=10, executor=Here(record_beside))
    with (
        pytest.raises(RayMapError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:9'"),
        scheduler_executor("tcp://127.0.0.1:9"),
    ):
        pass


@pytest.fixture
def solid(tmp_path: Path) -> Compilation:
    """A scene with a triangle mesh, whose file is gone."""
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(2, 2.0).export(tmp_path / "ball.stl")
    text = MIRROR_BALL.replace(
        'kind = "sphere"\nradius = 2\n', 'kind = "mesh"\nfile = "ball.stl"\nscale = 1\n'
    )
    (tmp_path / "scene.toml").write_text(text)
    compiled = compile_scene(load_scene(tmp_path / "scene.toml"))
    (tmp_path / "ball.stl").unlink()
    return compiled


def test_meshes_travel(solid: Compilation) -> None:
    trace = unpack(pack(NaturalTrace(solid)))
    assert isinstance(trace, NaturalTrace)
    there = trace.compilation
    assert solid.solids is not None
    assert there.solids is not None
    assert there.solids.arrays.handle != solid.solids.arrays.handle
    for name in ("corners", "triangles", "face", "center", "closed"):
        mine, other = getattr(solid.solids.arrays, name), getattr(there.solids.arrays, name)
        assert np.array_equal(mine, other), name
    assert there.directory == solid.directory


@pytest.mark.slow
def test_meshes_are_traced_alike(solid: Compilation, tmp_path: Path) -> None:
    record(solid, tmp_path / "one.raymap", rays=500, threads=1)
    record(solid, tmp_path / "a", rays=500, executor=Here())
    assert_same(tmp_path / "a", tmp_path / "one.raymap")


@pytest.fixture
def weighted() -> Compilation:
    """A scene whose rays split."""
    split = MIRROR_BALL.replace(
        "[surfaces.mirror]", GLASS_AND_SPLITS + "[surfaces.mirror]"
    ).replace('surface = "mirror"\n[sources', 'medium = "glass"\nsurface = "glass"\n[sources')
    return compile_scene(parse_scene(split))


def test_numbers_that_an_emission_takes(scene: Compilation, weighted: Compilation) -> None:
    assert (NaturalTrace(scene).max_branches, NaturalTrace(weighted).max_branches) == (1, 8)


@pytest.mark.slow
def test_rays_that_split_are_numbered_on(weighted: Compilation, tmp_path: Path) -> None:
    record(weighted, tmp_path / "one.raymap", rays=900, threads=1)
    record_shards(
        weighted, tmp_path / "a", Here(), rays=500, seconds=None, seed=None, shard_rays=300
    )
    record(weighted, tmp_path / "a", rays=400, executor=Here(), append=True)
    with raymap.open(tmp_path / "a") as shards:
        assert shards.rays > 900
    assert_same(tmp_path / "a", tmp_path / "one.raymap")
