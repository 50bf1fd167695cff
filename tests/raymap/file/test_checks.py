"""Portions of any tracer are checked on entry, and each refusal names what is wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import raymap
from raymap.model.events import Event
from tests.raymap.maps import RGB, portion_at, small_directory


@pytest.fixture
def portion():
    return portion_at(0, n_rays=30, weighted=True, extra=True, n_paths=8)


def _refused(portion, words):
    with pytest.raises(raymap.InvalidPortion, match=words):
        raymap.check_portion(portion, small_directory(), RGB)


def _with(portion, name, change):
    column = getattr(portion, name).copy()
    change(column)
    return dataclasses.replace(portion, **{name: column})


def test_a_sound_portion_passes(portion):
    raymap.check_portion(portion, small_directory(), RGB)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("source", 2, "source"),
        ("source", -1, "source"),
        ("object", 2, "object"),
        ("medium", 2, "medium"),
        ("color_code", 1000, "color_code"),
        ("color_code", -1, "color_code"),
        ("emitted", -1, "emitted"),
        ("position", np.nan, "finite"),
        ("weight", -1.0, "weights"),
        ("weight", np.inf, "weights"),
        ("records_per_ray", 0, "no record"),
    ],
)
def test_values_out_of_range(portion, name, value, words):
    def change(column):
        column[(1,) * column.ndim] = value

    _refused(_with(portion, name, change), words)


@pytest.mark.parametrize("name", ["source", "position", "event", "descriptor_count", "weight"])
def test_wrong_types_and_lengths(portion, name):
    column = getattr(portion, name)
    _refused(dataclasses.replace(portion, **{name: column.astype(np.complex128)}), name)
    _refused(dataclasses.replace(portion, **{name: column[:-1]}), "expected|record|adds")


def test_events_that_do_not_begin_or_end_a_ray(portion):
    starts = np.cumsum(portion.records_per_ray) - portion.records_per_ray
    ends = np.cumsum(portion.records_per_ray) - 1

    def no_start(event):
        event[starts[3]] &= ~int(Event.EMITTED)

    def two_endings(event):
        event[ends[4]] |= int(Event.LEFT_SCENE | Event.SURFACE_ABSORPTION)

    def no_ending(event):
        event[ends[5]] = int(Event.EMITTED)

    _refused(_with(portion, "event", no_start), "ray 3 is not EMITTED")
    _refused(_with(portion, "event", two_endings), "ray 4")
    _refused(_with(portion, "event", no_ending), "ray 5")
    long = int(np.flatnonzero(portion.records_per_ray > 2)[0])

    def early_end(event):
        event[starts[long] + 1] |= int(Event.DEPTH_LIMIT)

    _refused(_with(portion, "event", early_end), "before its end")


def test_primitives_that_no_face_has(portion, tmp_path):
    lens = int(np.flatnonzero(portion.object == 0)[0])

    def change(triangle):
        triangle[lens] = 10

    wrong = _with(portion, "triangle", change)
    with raymap.RayMapWriter.create(tmp_path / "a.raymap", small_directory()) as writer:
        writer.add_channel_set(RGB)
        with pytest.raises(raymap.InvalidPortion, match=f"record {lens} names object 0"):
            writer.append(wrong)


def test_colours_that_do_not_sum_to_one(portion):
    table = np.array([[65535, 1, 0]], np.uint16)
    codes = np.minimum(portion.color_code, 3)
    _refused(dataclasses.replace(portion, color_table=table, color_code=codes), "sums to 65536")


def test_cells_outside_of_the_detector():
    portion = portion_at(0, n_rays=60, n_paths=8)
    d = portion.descriptors
    assert len(d.cell)
    cell = d.cell.copy()
    cell[0] = 60000
    broken = dataclasses.replace(d, cell=cell)
    _refused(dataclasses.replace(portion, descriptors=broken), "descriptor 0")


def test_ray_numbers(portion):
    ids = np.arange(30) * 2
    raymap.check_portion(dataclasses.replace(portion, ray_ids=ids), small_directory(), RGB)
    _refused(dataclasses.replace(portion, ray_ids=ids[::-1].copy()), "increase")
    _refused(dataclasses.replace(portion, first_ray=-1), "negative")


def test_extra_columns(portion):
    _refused(dataclasses.replace(portion, extra={"phase": np.zeros(3)}), "phase")
    _refused(dataclasses.replace(portion, extra={"x" * 31: np.zeros(30)}), "1 to 30 bytes")


def test_a_portion_needs_its_channel_set(portion, tmp_path):
    writer = raymap.RayMapWriter.create(tmp_path / "a.raymap", small_directory())
    with pytest.raises(raymap.InvalidPortion, match="add_channel_set"):
        writer.append(portion)
    writer.close()


def test_the_limit_of_records():
    portion = portion_at(0, n_rays=1)
    huge = dataclasses.replace(portion, object=np.broadcast_to(np.int16(-1), 2**24 + 1))
    with pytest.raises(raymap.LimitExceeded, match="16777216"):
        raymap.check_portion(huge, small_directory(), RGB)
