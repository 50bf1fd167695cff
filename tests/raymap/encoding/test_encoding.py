"""Encoding a portion: what it leans on, and what it must not lean on."""

from __future__ import annotations

import dataclasses
import os
import time

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

import raymap
from raymap.bytes.streams import WHOLE, Scope, StreamSet, decode_column, frame_of_zeros
from raymap.encoding import dictionary, pathwords
from raymap.encoding.dictionary import find_paths
from raymap.encoding.encoder import PortionEncoder
from tests.raymap.compact import write_compactly
from tests.raymap.maps import RGB, portion_at, small_directory
from tests.strategies import assert_same_portion


def _overwrite(portion):
    """What a tracer does that uses its columns again."""
    for holder in (portion, portion.descriptors):
        for field in dataclasses.fields(holder):
            column = getattr(holder, field.name)
            if isinstance(column, np.ndarray):
                column.view(np.uint8)[:] = 0x5A
    for column in portion.extra.values():
        column.view(np.uint8)[:] = 0x5A


@pytest.mark.parametrize("form", ["usual", "raw", "compact"])
@pytest.mark.parametrize("n_paths", [3, None])
def test_columns_may_be_used_again_once_a_portion_is_encoded(tmp_path, form, n_paths):
    path = tmp_path / "a.raymap"
    options = {"n_rays": 40, "n_paths": n_paths, "weighted": True, "extra": True}
    expected = [portion_at(100 * k, seed=k, **options) for k in range(6)]
    with raymap.RayMapWriter.create(path, small_directory(), raw=form == "raw") as writer:
        if form == "compact":
            write_compactly(writer)
        writer.add_channel_set(RGB)
        encoded = []
        for number in range(6):
            portion = portion_at(100 * number, seed=number, **options)
            encoded.append(writer.encode(portion, number))
            _overwrite(portion)
            # Some are written while others wait
            if number % 2:
                for each in encoded[-2:]:
                    writer.commit(each)
        with pytest.raises(raymap.InvalidPortion, match="before"):
            writer.copy_portion(encoded[0])
    with raymap.open(path) as ray_map:
        for portion, stored in zip(expected, ray_map.portions, strict=True):
            assert_same_portion(portion, stored.read())


@pytest.mark.parametrize("n_paths", [5, 40])
def test_faces_that_are_searched_are_those_that_are_looked_up(monkeypatch, n_paths):
    portion = portion_at(0, n_rays=300, n_paths=n_paths)
    faces = small_directory().faces
    looked_up = find_paths(portion, pathwords.face_columns(faces))
    monkeypatch.setattr(pathwords, "_MOST", 0)
    searched = find_paths(portion, pathwords.face_columns(faces))
    np.testing.assert_array_equal(looked_up.numbers, searched.numbers)
    np.testing.assert_array_equal(looked_up.explicit, searched.explicit)
    for a, b in zip(looked_up.table, searched.table, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("most", [0, 65_536])
@pytest.mark.parametrize(
    ("item", "primitive"), [(-1, 0), (-2, -1), (0, 10), (0, -2), (1, -2), (2, 0), (32767, 5)]
)
def test_records_of_primitives_that_are_none_are_refused(monkeypatch, most, item, primitive):
    monkeypatch.setattr(pathwords, "_MOST", most)
    portion = portion_at(0)
    portion.object[17], portion.triangle[17] = item, primitive
    with pytest.raises(raymap.InvalidPortion, match="record 17"):
        find_paths(portion, pathwords.face_columns(small_directory().faces))


@pytest.mark.parametrize("n_paths", [1, 100])
def test_numbering_that_is_judged_early_gives_the_same_paths(monkeypatch, n_paths):
    portion = portion_at(0, n_rays=6000, n_paths=n_paths, seed=4)
    faces = pathwords.face_columns(small_directory().faces)
    early = find_paths(portion, faces)
    monkeypatch.setattr(dictionary, "_FEWEST", 10**9)
    late = find_paths(portion, faces)
    np.testing.assert_array_equal(early.numbers, late.numbers)
    np.testing.assert_array_equal(early.explicit, late.explicit)
    for a, b in zip(early.table, late.table, strict=True):
        np.testing.assert_array_equal(a, b)


def test_paths_that_do_not_repeat_are_given_up_early(monkeypatch):
    """An eighth of the rays foretells it; the same rays in a small portion are all looked at."""
    looked_at = []
    number = dictionary.number_rays

    def counting(rays, *others):
        looked_at.append(len(rays.source))
        number(rays, *others)

    monkeypatch.setattr(dictionary, "number_rays", counting)
    faces = pathwords.face_columns(small_directory().faces)
    assert find_paths(portion_at(0, n_rays=6000, n_paths=None, seed=4), faces) is None
    assert sum(looked_at) == 6000 // 8


@given(
    n=st.integers(1, 300_000), places=st.sets(st.integers(0, 2**18), max_size=9), seed=st.integers()
)
def test_frames_of_zeros_are_frames(n, places, seed):
    at = np.array(sorted(place for place in places if place < n) or [n - 1], np.int32)
    values = np.random.default_rng(abs(seed)).integers(1, 256, len(at)).astype(np.uint8)
    frame = frame_of_zeros(n, at, values)
    column = np.zeros(n, np.uint8)
    column[at] = values
    assert zstandard.frame_content_size(frame) == n
    assert zstandard.ZstdDecompressor().decompress(frame, max_output_size=n) == column.tobytes()


@pytest.mark.parametrize("n_rays", [40, 3000])
@pytest.mark.parametrize("shapes", ["each", "some", "front", "rim", "none"])
def test_implied_normals_are_those_of_the_shapes(tmp_path, n_rays, shapes):
    """Said to be implied or compared with what is implied: the same normals come back."""
    front = _face("front", 0, known=(shapes not in ("rim", "none"),))
    known = {"some": (False, True), "front": (), "none": ()}.get(shapes, (True, True))
    rim = _face("rim", 1, 2, known=known)
    directory = small_directory(objects=(raymap.SceneObject(name="ball", faces=(front, rim)),))
    portion = _portion_on_balls(directory, n_rays)
    read = []
    for implied in (False, True):
        path = tmp_path / f"{implied}.raymap"
        with raymap.RayMapWriter.create(path, directory) as writer:
            writer.add_channel_set(RGB)
            writer.append(dataclasses.replace(portion, implied_normals=implied))
        with raymap.open(path) as ray_map:
            read.append(ray_map.portions[0].column("normal"))
    np.testing.assert_array_equal(*read)
    np.testing.assert_array_equal(read[0], portion.normal)


def test_normals_that_are_all_implied(tmp_path):
    portion = _portion_on_balls(small_directory(), 3)
    table = dataclasses.replace(
        portion, normal=np.zeros_like(portion.normal), event=portion.event & 1, implied_normals=True
    )
    path = tmp_path / "a.raymap"
    directory = small_directory(objects=(raymap.SceneObject(name="ball"),))
    with raymap.RayMapWriter.create(path, directory, trusted=True) as writer:
        writer.add_channel_set(RGB)
        writer.append(table)
    with raymap.open(path) as ray_map:
        assert not ray_map.portions[0].column("normal").any()


def _face(name, first, count=1, known=(True,)):
    ball = raymap.Quadric(coefficients=(1, 1, 1, 0, 0, 0, 0, 0, 0, -4.0))
    quadrics = tuple(ball if each else None for each in known)
    return raymap.Face(name=name, first_primitive=first, primitive_count=count, quadrics=quadrics)


def _portion_on_balls(directory, n_rays):
    """Rays from a lamp to a ball about the origin and away from there."""
    rng = np.random.default_rng(3)
    position = rng.normal(size=(n_rays, 3, 3)).astype(np.float32)
    position[:, 2] *= 20
    normal = np.zeros((n_rays, 3, 3), np.int16)
    normal[:, 0] = (0, 0, 32767)
    normal[n_rays // 2 :, 0] = (1000, -2000, 30000)
    there = position[:, 1].astype(np.float64)
    normal[:, 1] = np.floor(there * (32767 / np.sqrt((there**2).sum(1)))[:, None] + 0.5)
    # Some directions of light that leaves are a step off what the positions say
    way = position[:, 2].astype(np.float64) - there
    normal[:, 2] = np.floor(way * (32767 / np.sqrt((way**2).sum(1)))[:, None] + 0.5)
    normal[:: (7 if n_rays < 1000 else 11), 2] += 1
    n = 3 * n_rays
    event = np.tile([raymap.Event.EMITTED, raymap.Event.SPECULAR_REFLECTION, 1 << 10], n_rays)
    return raymap.Portion(
        emitted=np.array([n_rays, 0]),
        source=np.zeros(n_rays, np.int16),
        records_per_ray=np.full(n_rays, 3, np.int32),
        position=position.reshape(n, 3),
        normal=normal.reshape(n, 3),
        object=np.tile([-1, 0, -1], n_rays).astype(np.int16),
        triangle=np.array([[-1, k % 3, -1] for k in range(n_rays)], np.int32).reshape(-1),
        event=event.astype(np.int32),
        medium=np.zeros(n, np.int16),
        color_code=np.zeros(n, np.int32),
        color_table=np.empty((0, 3), np.uint16),
        descriptor_count=np.zeros(n, np.uint16),
        descriptors=raymap.Descriptors(
            detector=np.empty(0, np.int16),
            cell=np.empty((0, 2), np.uint16),
            cosine=np.empty(0, np.int16),
            uv=np.empty((0, 2), np.uint16),
            registered=np.empty(0, np.bool_),
        ),
    )


@pytest.mark.parametrize(("steps", "whole"), [(1, True), (3, True), (2**20, False)])
def test_coordinates_that_repeat_are_stored_whole(steps, whole):
    """Light goes up and down between faces across an axis, or is met everywhere."""
    rng = np.random.default_rng(5)
    column = rng.integers(-steps, steps + 1, 50_000).astype(np.float32) / np.float32(3.3)
    column[::2] = 1.0
    if not whole:
        column = rng.normal(size=50_000).astype(np.float32)
    planes = np.ascontiguousarray(column.view(np.uint8).reshape(-1, 4).T)
    streams = StreamSet()
    streams.add_split("z", column, planes, Scope.RECORD)
    assert [entry.plane for entry in streams.entries] == ([WHOLE] if whole else [0, 1, 2, 3])
    stored = dict(zip(map(id, streams.entries), streams.buffers, strict=True))
    read = decode_column(streams.entries, lambda entry: bytes(stored[id(entry)]), 50_000)
    np.testing.assert_array_equal(read, column)


def test_memory_of_written_portions_is_used_again():
    encoder = PortionEncoder(small_directory())
    first = encoder.encode(portion_at(0), 0, [RGB])
    memory = first.lent[0]
    waiting = encoder.encode(portion_at(0), 1, [RGB])
    assert waiting.lent[0] is not memory
    first.release()
    assert encoder.encode(portion_at(0), 2, [RGB]).lent[0] is memory


def test_the_disk_takes_bytes_while_more_are_written(tmp_path, monkeypatch):
    """What is asked of the disk early is asked while nothing waits, and is over at the end."""
    from raymap.bytes import appender

    monkeypatch.setattr(appender, "_BEHIND", 1000)
    asked = []
    flush = appender.ChunkAppender._flush

    def slow(self):
        time.sleep(0.01)
        os.fstat(self._descriptor)
        flush(self)
        asked.append(self.end)

    monkeypatch.setattr(appender.ChunkAppender, "_flush", slow)
    portions = [portion_at(100 * k, seed=k) for k in range(8)]
    with raymap.RayMapWriter.create(tmp_path / "a.raymap", small_directory()) as writer:
        writer.add_channel_set(RGB)
        for portion in portions:
            writer.append(portion)
    assert asked
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        for portion, stored in zip(portions, ray_map.portions, strict=True):
            assert_same_portion(portion, stored.read())
