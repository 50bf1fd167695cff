"""Path dictionaries against a plain grouping of rays; the merged one against all portions."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import raymap
from tests.examples import examples
from tests.raymap.maps import RGB, portion_at, small_directory, write_small


def _key(portion, faces, ray):
    """The itinerary of one ray, spelled out."""
    start = int(portion.records_per_ray[:ray].sum())
    crossing = int(portion.descriptor_count[:start].sum())
    key = [int(portion.source[ray])]
    for i in range(start, start + int(portion.records_per_ray[ray])):
        n = int(portion.descriptor_count[i])
        d = portion.descriptors
        crossings = tuple(
            (int(d.detector[k]), bool(d.registered[k])) for k in range(crossing, crossing + n)
        )
        crossing += n
        key.append(
            (
                int(portion.object[i]),
                int(faces[i]),
                int(portion.event[i]),
                int(portion.medium[i]),
                crossings,
            )
        )
    return tuple(key)


def _path_key(paths, number):
    key = [int(paths.source[number])]
    for i in range(paths.offsets[number], paths.offsets[number + 1]):
        crossings = tuple(
            (int(paths.detector[k]), bool(paths.registered[k]))
            for k in range(paths.detector_offsets[i], paths.detector_offsets[i + 1])
        )
        key.append(
            (
                int(paths.object[i]),
                int(paths.face[i]),
                int(paths.event[i]),
                int(paths.medium[i]),
                crossings,
            )
        )
    return tuple(key)


def _sums(portion):
    """Per itinerary: rays, Σw, Σw² (emissions first), Σ w·colour at the end."""
    directory = small_directory()
    faces = np.where(portion.object == 0, np.minimum(portion.triangle, 1), -1)
    assert len(directory.faces.names) == 2
    ends = np.cumsum(portion.records_per_ray) - 1
    pure = np.eye(3)
    colors = np.concatenate((pure, portion.color_table / 65535))[portion.color_code[ends]]
    weight = np.ones(portion.n_rays) if portion.weight is None else portion.weight.astype(float)
    rays, sum_w, sum_wc = defaultdict(int), defaultdict(float), defaultdict(float)
    groups = defaultdict(float)
    for ray in range(portion.n_rays):
        key = _key(portion, faces, ray)
        rays[key] += 1
        sum_w[key] += weight[ray]
        sum_wc[key] = sum_wc[key] + weight[ray] * colors[ray]
        group = ray if portion.emission is None else int(portion.emission[ray])
        groups[key, group] += weight[ray]
    sum_w2 = defaultdict(float)
    for (key, _), value in groups.items():
        sum_w2[key] += value**2
    return rays, sum_w, sum_w2, sum_wc


@settings(max_examples=examples(30), suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10**6),
    n_paths=st.sampled_from([1, 4, 12, None]),
    weighted=st.booleans(),
    grouped=st.booleans(),
)
def test_dictionary_is_the_grouping_of_its_rays(tmp_path_factory, seed, n_paths, weighted, grouped):
    portion = portion_at(
        0, n_rays=60, seed=seed, n_paths=n_paths, weighted=weighted, grouped=grouped
    )
    path = tmp_path_factory.mktemp("paths") / "a.raymap"
    with raymap.RayMapWriter.create(path, small_directory()) as writer:
        writer.add_channel_set(RGB)
        writer.append(portion)
    rays, sum_w, sum_w2, sum_wc = _sums(portion)
    with raymap.open(path) as ray_map:
        stored = ray_map.portions[0]
        paths = stored.paths()
        assert paths.grouped == grouped
        numbers = stored.path_numbers()
        faces = np.where(portion.object == 0, np.minimum(portion.triangle, 1), -1)
        keys = [_path_key(paths, number) for number in range(paths.n_paths)]
        for ray in range(portion.n_rays):
            assert keys[numbers[ray]] == _key(portion, faces, ray)
        if not stored.has_paths:
            assert ray_map.merged.local_to_global == [None]
            return
        assert len(set(keys)) == len(keys)
        assert (np.diff(paths.rays) <= 0).all()
        merged = ray_map.merged
        for number, key in enumerate(keys):
            assert paths.rays[number] == rays[key]
            assert paths.sum_w[number] == pytest.approx(sum_w[key])
            assert paths.sum_w2[number] == pytest.approx(sum_w2[key])
            np.testing.assert_allclose(paths.sum_wc[0][number], sum_wc[key], atol=1e-9)
            assert _path_key(merged.paths, merged.local_to_global[0][number]) == key


def test_merged_dictionary_is_the_sum_of_the_portions(tmp_path):
    path = tmp_path / "a.raymap"
    portions = write_small(path, n_portions=5, n_rays=60, n_paths=6, weighted=True)
    total = defaultdict(float)
    squares = defaultdict(float)
    counts = defaultdict(int)
    for portion in portions:
        rays, sum_w, sum_w2, _ = _sums(portion)
        for key in rays:
            counts[key] += rays[key]
            total[key] += sum_w[key]
            squares[key] += sum_w2[key]
    with raymap.open(path) as ray_map:
        paths = ray_map.merged.paths
        keys = [_path_key(paths, number) for number in range(paths.n_paths)]
        assert sorted(keys) == sorted(counts)
        for number, key in enumerate(keys):
            assert paths.rays[number] == counts[key]
            assert paths.sum_w[number] == pytest.approx(total[key])
            assert paths.sum_w2[number] == pytest.approx(squares[key])


def test_plain_portions_show_the_same_view(tmp_path):
    portion = portion_at(0, n_rays=40, n_paths=None, weighted=True)
    path = tmp_path / "a.raymap"
    with raymap.RayMapWriter.create(path, small_directory()) as writer:
        writer.add_channel_set(RGB)
        writer.append(portion)
    with raymap.open(path) as ray_map:
        stored = ray_map.portions[0]
        assert not stored.has_paths
        view = stored.paths()
        stored.stream_table()
        before = ray_map.bytes_read
        np.testing.assert_array_equal(view.object, portion.object)
        assert ray_map.bytes_read - before < stored.stored_bytes / 2
        assert view.n_paths == portion.n_rays
        assert view.n_points == portion.n_records
        np.testing.assert_array_equal(np.diff(view.offsets), portion.records_per_ray)
        np.testing.assert_array_equal(np.diff(view.detector_offsets), portion.descriptor_count)
        np.testing.assert_array_equal(view.detector, portion.descriptors.detector)
        np.testing.assert_array_equal(view.sum_w, portion.weight)
        np.testing.assert_allclose(view.sum_w2, portion.weight.astype(float) ** 2)
        assert view.sum_wc[0].sum() == pytest.approx(portion.weight.sum(dtype=float))
        np.testing.assert_array_equal(stored.path_numbers(), np.arange(40))


def test_equal_hashes_do_not_join_different_paths():
    """The hash only finds candidates: itineraries are compared in full."""
    from raymap.encoding.dictionary import find_paths
    from raymap.encoding.pathwords import face_columns

    portion = portion_at(0, n_rays=60, n_paths=12)
    table = face_columns(small_directory().faces)
    faces = np.where(portion.object == 0, np.minimum(portion.triangle, 1), -1)
    keys = [_key(portion, faces, ray) for ray in range(60)]
    found = find_paths(portion, table, np.uint64(0))
    usual = find_paths(portion, table)
    assert found.table.source.size == len(set(keys))
    np.testing.assert_array_equal(found.numbers, usual.numbers)
    assert len({(number, key) for number, key in zip(found.numbers, keys, strict=True)}) == len(
        set(keys)
    )
