"""Maps grow: by append, by shards, while they are read; ray numbers and emitted counts stay."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import numpy as np
import pytest

import raymap
from tests.raymap.maps import RGB, SPECTRAL, ids_of, portion_at, small_directory, write_small
from tests.strategies import assert_same_portion


def _append(path, portions, **options):
    with raymap.RayMapWriter.append_to(path, small_directory(), **options) as writer:
        for portion in portions:
            writer.append(portion)


@pytest.mark.parametrize("finished", [True, False])
def test_append_continues_a_finished_or_interrupted_map(tmp_path, finished):
    path = tmp_path / "a.raymap"
    written = write_small(path, finish=finished)
    more = [portion_at(400, seed=77), portion_at(500, seed=78)]
    _append(path, more)
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        assert [portion.number for portion in ray_map.portions] == [0, 1, 2, 3, 4, 5]
        for expected, stored in zip(written + more, ray_map.portions, strict=True):
            assert_same_portion(expected, stored.read())
        merged = ray_map.merged
        assert merged is not None
        assert merged.paths.rays.sum() == ray_map.rays == 300


def test_append_cuts_a_torn_tail(tmp_path):
    path = tmp_path / "a.raymap"
    written = write_small(path, finish=False)
    whole = path.read_bytes()
    path.write_bytes(whole + b"RMAP:POR" + bytes(500))
    with raymap.open(path) as ray_map:
        assert ray_map.torn_bytes == 508
        assert len(ray_map.portions) == 4
    _append(path, [portion_at(400)])
    with raymap.open(path) as ray_map:
        assert ray_map.torn_bytes == 0
        assert len(ray_map.portions) == 5
        assert_same_portion(written[3], ray_map.portions[3].read())


def test_append_may_change_from_rgb_to_spectral(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path)
    with raymap.RayMapWriter.append_to(path, small_directory()) as writer:
        assert writer.add_channel_set(RGB) == 0
        assert writer.add_channel_set(SPECTRAL) == 1
        assert writer.add_channel_set(SPECTRAL) == 1
        writer.append(portion_at(400, channels=SPECTRAL, channel_set_index=1))
    with raymap.open(path) as ray_map:
        assert ray_map.channel_sets == [RGB, SPECTRAL]
        assert [portion.channel_set for portion in ray_map.portions] == [0, 0, 0, 0, 1]
        sums = ray_map.merged.paths.sum_wc
        assert sums[0].sum() == pytest.approx(200)
        assert sums[1].sum() == pytest.approx(50)
        assert ray_map.portions[4].column("color").shape[1] == 5


def test_append_refuses_another_scene_and_names_the_difference(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path)
    before = path.read_bytes()
    other = small_directory(
        media=(raymap.Medium(name="air"), raymap.Medium(name="water")), scene_hash="other"
    )
    with pytest.raises(raymap.SceneMismatch, match="glass"):
        raymap.RayMapWriter.append_to(path, other)
    assert path.read_bytes() == before


def test_a_second_writer_is_refused(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path)
    with (
        raymap.RayMapWriter.append_to(path, small_directory()),
        pytest.raises(raymap.MapLocked, match="another program"),
    ):
        raymap.RayMapWriter.append_to(path, small_directory())
    raymap.RayMapWriter.append_to(path, small_directory()).close()


def test_a_second_process_is_refused_and_the_lock_dies_with_its_process(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path)
    code = (
        "import sys, raymap\n"
        "try: raymap.RayMapWriter.append_to(sys.argv[1])\n"
        "except raymap.MapLocked: print('locked')\n"
        "else: print('free')"
    )

    def ask():
        command = [sys.executable, "-c", code, str(path)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    writer = raymap.RayMapWriter.append_to(path)
    assert ask() == "locked"
    writer.close()
    assert ask() == "free"
    assert raymap.RayMapWriter.append_to(path).next_ray == 350


def test_an_existing_map_is_not_written_over(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path)
    before = path.read_bytes()
    with pytest.raises(raymap.MapExists, match="--append"):
        raymap.RayMapWriter.create(path, small_directory())
    assert path.read_bytes() == before
    with raymap.open(path) as old:
        with raymap.RayMapWriter.create(path, small_directory(), force=True) as writer:
            writer.add_channel_set(RGB)
        # Who reads the old map keeps it
        assert len(ids_of(old)) == 200
    with raymap.open(path) as new:
        assert new.rays == 0


def test_reading_while_recording_sees_a_growing_prefix(tmp_path):
    path = tmp_path / "a.raymap"
    writer = raymap.RayMapWriter.create(path, small_directory())
    with raymap.open(path) as early:
        assert early.rays == 0
        writer.add_channel_set(RGB)
        for k in range(3):
            writer.append(portion_at(100 * k, seed=k))
            assert early.refresh()
            assert len(early.portions) == k + 1
            assert not early.finished
            assert early.merged is None
            assert list(ids_of(early)[-2:]) == [100 * k + 48, 100 * k + 49]
        assert not early.refresh()
        writer.finish()
        assert early.refresh()
        assert early.finished
        assert early.merged.paths.rays.sum() == 150


def test_portions_are_committed_in_number_order_from_many_threads(tmp_path):
    path = tmp_path / "a.raymap"
    portions = [portion_at(100 * k, seed=k) for k in range(12)]
    order = np.random.default_rng(3).permutation(12)
    with raymap.RayMapWriter.create(path, small_directory()) as writer:
        writer.add_channel_set(RGB)

        def work(numbers):
            for number in numbers:
                writer.commit(writer.encode(portions[number], int(number)))

        threads = [threading.Thread(target=work, args=(order[k::3],)) for k in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        with pytest.raises(raymap.InvalidPortion, match="committed before"):
            writer.commit(writer.encode(portions[0], 0))
    alone = tmp_path / "b.raymap"
    with raymap.RayMapWriter.create(alone, small_directory()) as writer:
        writer.add_channel_set(RGB)
        for portion in portions:
            writer.append(portion)
    assert path.read_bytes() == alone.read_bytes()


def test_a_missing_portion_is_named_and_the_prefix_served(tmp_path):
    path = tmp_path / "a.raymap"
    writer = raymap.RayMapWriter.create(path, small_directory())
    writer.add_channel_set(RGB)
    writer.commit(writer.encode(portion_at(0), 0))
    writer.commit(writer.encode(portion_at(200), 2))
    with pytest.raises(raymap.InvalidPortion, match="portion 1"):
        writer.finish()
    with raymap.open(path) as ray_map:
        assert ray_map.rays == 50


def test_ray_numbers_must_increase(tmp_path):
    with raymap.RayMapWriter.create(tmp_path / "a.raymap", small_directory()) as writer:
        writer.add_channel_set(RGB)
        writer.append(portion_at(0))
        writer.append(portion_at(0, seed=3))
        assert writer.next_ray == 100
        late = writer.encode(portion_at(20), writer.next_portion)
        with pytest.raises(raymap.InvalidPortion, match="increase"):
            writer.commit(late)
        writer.close()


def test_runs_are_remembered(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path, seed=4)
    with raymap.RayMapWriter.append_to(path) as writer:
        assert [run["seed"] for run in writer.runs] == [4]
        writer.start_run(seed=9)
        writer.append(portion_at(400))
        writer.finish({"seconds": 2.0})
    with raymap.open(path) as ray_map:
        assert [run["seed"] for run in ray_map.runs] == [4, 9]
        assert [run["statistics"]["seconds"] for run in ray_map.runs] == [1.0, 2.0]
        assert [run["first_portion"] for run in ray_map.runs] == [0, 4]


def test_rays_are_found_by_number(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path)
    with raymap.open(path) as ray_map:
        assert ray_map.find_ray(0) == (0, 0)
        assert ray_map.find_ray(249) == (2, 49)
        for missing in (50, 99, 350, -1, 10**12):
            with pytest.raises(raymap.RayNotFound, match=str(missing)):
                ray_map.find_ray(missing)


def _shards(folder):
    folder.mkdir()
    a = write_small(folder / "a.raymap", seed=1)
    with raymap.RayMapWriter.create(folder / "b.raymap", small_directory()) as writer:
        writer.add_channel_set(SPECTRAL)
        writer.add_channel_set(RGB)
        writer.start_run(seed=2)
        b = [
            portion_at(1000, seed=5, channels=SPECTRAL),
            portion_at(1100, seed=6, channel_set_index=1),
        ]
        for portion in b:
            writer.append(portion)
    return a, b


def test_shards_open_as_one_map(tmp_path):
    a, b = _shards(tmp_path / "shards")
    with raymap.open(tmp_path / "shards") as ray_map:
        assert ray_map.finished
        assert ray_map.rays == 300
        assert ray_map.channel_sets == [RGB, SPECTRAL]
        assert [portion.channel_set for portion in ray_map.portions] == [0, 0, 0, 0, 1, 0]
        for expected, stored in zip(a + b, ray_map.portions, strict=True):
            found = stored.read()
            assert found.records_per_ray.sum() == expected.records_per_ray.sum()
            np.testing.assert_array_equal(found.position, expected.position)
        assert ray_map.find_ray(1102) == (5, 2)
        emitted = sum(portion.emitted for portion in a + b)
        np.testing.assert_array_equal(ray_map.emitted, emitted)
        merged = ray_map.merged
        assert merged.paths.rays.sum() == 300
        assert merged.paths.sum_wc[0].sum() == pytest.approx(250)
        assert merged.paths.sum_wc[1].sum() == pytest.approx(50)
        for stored, numbers in zip(ray_map.portions, merged.local_to_global, strict=True):
            local = stored.paths()
            for path, whole in enumerate(numbers):
                own = local.event[local.offsets[path] : local.offsets[path + 1]]
                all_ = merged.paths
                other = all_.event[all_.offsets[whole] : all_.offsets[whole + 1]]
                np.testing.assert_array_equal(own, other)


def test_shards_of_another_scene_or_of_equal_rays_are_refused(tmp_path):
    write_small(tmp_path / "a.raymap", seed=1)
    write_small(tmp_path / "b.raymap", seed=1)
    with pytest.raises(raymap.SceneMismatch, match="repeat each other"):
        raymap.open([tmp_path / "a.raymap", tmp_path / "b.raymap"])
    write_small(tmp_path / "c.raymap", seed=2)
    with raymap.open([tmp_path / "a.raymap", tmp_path / "c.raymap"]) as ray_map:
        assert ray_map.rays == 400
    other = small_directory(scene_hash="x", bounding_sphere=raymap.BoundingSphere(radius=7))
    write_small(tmp_path / "d.raymap", seed=3, directory=other)
    with pytest.raises(raymap.SceneMismatch, match="bounding sphere"):
        raymap.open([tmp_path / "a.raymap", tmp_path / "d.raymap"])
    os.mkdir(tmp_path / "empty")
    with pytest.raises(raymap.NotARayMap, match="no ray maps"):
        raymap.open(tmp_path / "empty")


def test_detector_results_add_up_over_runs_and_shards(tmp_path):
    def write(path, seed, value, first):
        with raymap.RayMapWriter.create(path, small_directory()) as writer:
            writer.add_channel_set(RGB)
            writer.start_run(seed=seed)
            writer.append(portion_at(first, seed=seed))
            sums = np.full((5, 7, 3), float(value))
            writer.add_detector_result(0, sums, sums**2)
            writer.add_detector_result(0, sums, sums**2)

    write(tmp_path / "a.raymap", 1, 1.0, 0)
    with raymap.RayMapWriter.append_to(tmp_path / "a.raymap") as writer:
        writer.start_run(seed=2)
        writer.append(portion_at(100, seed=8))
        writer.add_detector_result(0, np.full((5, 7, 3), 5.0), np.full((5, 7, 3), 25.0))
    write(tmp_path / "b.raymap", 3, 10.0, 1000)
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        sums, sums2 = ray_map.detector_result("sensor")
        assert (sums == 7).all()
        assert (sums2 == 27).all()
        assert ray_map.detector_result("sky") is None
    with raymap.open([tmp_path / "a.raymap", tmp_path / "b.raymap"]) as ray_map:
        assert (ray_map.detector_result("sensor")[0] == 27).all()
    # Results that do not cover every portion are no results
    with raymap.RayMapWriter.append_to(tmp_path / "a.raymap") as writer:
        writer.append(portion_at(200, seed=9))
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert ray_map.detector_result("sensor") is None
