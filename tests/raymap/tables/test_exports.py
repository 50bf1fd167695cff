"""Exports say the same as the map, to programs that no one here wrote."""

from __future__ import annotations

import json
import os
from itertools import pairwise
from pathlib import Path

import duckdb
import numpy as np
import polars
import pyarrow.parquet as pq
import pytest

import query
import raymap
from raymap.file.verify import verify
from raymap.model.errors import RayMapError
from raymap.tables.arrow import export
from tests.raymap.maps import SPECTRAL, ids_of, portion_at, small_directory, write_small
from tests.strategies import assert_same_portion


@pytest.fixture(scope="module")
def ray_map(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "a.raymap"
    write_small(path, n_portions=3, n_rays=40, weighted=True)
    with raymap.RayMapWriter.append_to(path) as writer:
        number = writer.add_channel_set(SPECTRAL)
        writer.append(portion_at(300, channels=SPECTRAL, channel_set_index=number, n_rays=30))
    with raymap.open(path) as opened:
        yield opened


def _records(ray_map, name):
    return np.concatenate([portion.column(name) for portion in ray_map.portions])


def test_duckdb_counts_as_the_map_does(ray_map, tmp_path):
    path = tmp_path / "a.parquet"
    assert raymap.export(ray_map, path) == ray_map.records
    with duckdb.connect() as base:
        for number, item in enumerate(ray_map.directory.objects):
            question = (
                "select count(*), count(distinct ray_id) from read_parquet(?) where object = ?"
            )
            records, rays = base.execute(question, [str(path), item.name]).fetchone()
            hit = [portion.column("object") == number for portion in ray_map.portions]
            assert records == sum(int(each.sum()) for each in hit)
            own = 0
            for portion, each in zip(ray_map.portions, hit, strict=True):
                ends = portion.record_offsets()
                own += sum(each[a:b].any() for a, b in pairwise(ends))
            assert rays == own
        question = """
            select sum(weight) from (
              select any_value(weight) as weight from read_parquet(?)
              where len(list_filter(descriptors,
                        lambda d : d.detector = 'sensor' and d.registered)) > 0
              group by ray_id)"""
        (weight,) = base.execute(question, [str(path)]).fetchone()
    expected = 0.0
    for portion in ray_map.portions:
        d = portion.descriptors()
        ray = np.repeat(np.arange(portion.n_rays), np.diff(portion.record_offsets()))
        ray = np.repeat(ray, portion.column("descriptor_count"))
        rays = np.unique(ray[(d.detector == 0) & d.registered])
        expected += portion.column("weight")[rays].sum(dtype=float)
    assert weight == pytest.approx(expected)


def test_every_column_of_the_segments(ray_map, tmp_path):
    path = tmp_path / "a.arrow"
    raymap.export(ray_map, path)
    table = polars.read_ipc(path)
    assert table.columns == [
        *("ray_id", "step", "source", "object", "face", "medium", "triangle"),
        *("x", "y", "z", "nx", "ny", "nz", "event", "color", "weight", "descriptors"),
    ]
    position = _records(ray_map, "position")
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(table[name].to_numpy(), position[:, axis])
    np.testing.assert_array_equal(table["event"].to_numpy(), _records(ray_map, "event"))
    np.testing.assert_array_equal(table["triangle"].to_numpy(), _records(ray_map, "triangle"))
    ids = np.repeat(
        ids_of(ray_map), np.concatenate([np.diff(p.record_offsets()) for p in ray_map.portions])
    )
    np.testing.assert_array_equal(table["ray_id"].to_numpy(), ids)
    names = ray_map.directory.faces.names
    faces = _records(ray_map, "face")
    objects = table["object"].cast(str).to_list()
    parts = table["face"].cast(str).to_list()
    for face, item, part in zip(faces, objects, parts, strict=True):
        assert (part is None) == (face < 0)
        if face >= 0:
            assert f"{item}.{part}" == names[face]
    lengths = table["color"].list.len().to_numpy()
    assert set(lengths) == {3, 5}
    np.testing.assert_allclose(table["color"].list.sum().to_numpy(), 1, atol=1e-5)
    counts = table["descriptors"].list.len().to_numpy()
    np.testing.assert_array_equal(counts, _records(ray_map, "descriptor_count"))


def test_rows_of_rays_nest_their_records(ray_map, tmp_path):
    path = tmp_path / "a.parquet"
    assert raymap.export(ray_map, path, rows="rays") == ray_map.rays
    table = pq.read_table(path)
    assert table.column_names == ["ray_id", "source", "weight", "segments"]
    lengths = [len(ray) for ray in table["segments"].to_pylist()]
    expected = np.concatenate([np.diff(p.record_offsets()) for p in ray_map.portions])
    np.testing.assert_array_equal(lengths, expected)
    metadata = table.schema.metadata
    directory = raymap.Directory.model_validate_json(metadata[b"raymap.model.directory"])
    assert directory == ray_map.directory
    emitted = json.loads(metadata[b"raymap.emitted"])
    assert list(emitted.values()) == ray_map.emitted.tolist()


def test_csv_is_flat_and_rays_are_refused(ray_map, tmp_path):
    path = tmp_path / "a.csv"
    assert raymap.export(ray_map, path) == ray_map.records
    table = polars.read_csv(path, infer_schema_length=None)
    assert table.height == ray_map.records
    assert {"color_0", "color_4", "descriptors"} <= set(table.columns)
    assert table["descriptors"].sum() == sum(p.n_descriptors for p in ray_map.portions)
    with pytest.raises(raymap.RayMapError, match="no nested rows"):
        raymap.export(ray_map, tmp_path / "b.csv", rows="rays")
    assert not (tmp_path / "b.csv").exists()


def test_a_folder_gets_parquet_files_and_chosen_rays_only(ray_map, tmp_path):
    wanted = np.array([3, 105, 139, 320])
    folder = tmp_path / "folder"
    assert raymap.export(ray_map, folder, rows="rays", ray_ids=wanted, form="folder") == 4
    table = polars.read_parquet(tmp_path / "folder" / "*.parquet")
    assert table["ray_id"].to_list() == wanted.tolist()


@pytest.mark.parametrize("name", ["a", "a.foo", "a.parquet.gz"])
def test_a_name_that_says_no_form_is_refused(ray_map, tmp_path, name):
    target = tmp_path / name
    with pytest.raises(raymap.RayMapError, match=r"\.parquet, \.arrow, \.csv.*--format"):
        raymap.export(ray_map, target)
    assert not list(tmp_path.iterdir())
    assert raymap.export(ray_map, target, form="csv") == ray_map.records
    assert polars.read_csv(target, infer_schema_length=None).height == ray_map.records


def test_folders_are_known_by_a_slash_or_by_being_there(ray_map, tmp_path):
    (tmp_path / "there").mkdir()
    for path in (f"{tmp_path}/slash/", tmp_path / "there"):
        assert raymap.export(ray_map, path) == ray_map.records
        assert polars.read_parquet(f"{Path(path)}/*.parquet").height == ray_map.records


def test_endings_may_be_capitals(ray_map, tmp_path):
    path = tmp_path / "A.CSV"
    assert raymap.export(ray_map, path) == ray_map.records
    assert path.read_bytes().startswith(b'"ray_id"')


def test_existing_files_are_not_written_over(ray_map, tmp_path):
    path = tmp_path / "a.parquet"
    path.write_bytes(b"mine")
    with pytest.raises(raymap.MapExists):
        raymap.export(ray_map, path)
    assert path.read_bytes() == b"mine"
    raymap.export(ray_map, path, force=True)
    assert [each.name for each in tmp_path.iterdir()] == ["a.parquet"]


def test_a_saved_selection_is_a_full_map(ray_map, tmp_path):
    path = tmp_path / "some.raymap"
    wanted = np.array([1, 2, 39, 110, 305, 329, 10**9])
    assert raymap.copy_selection(ray_map, wanted, path, description="a test") == 6
    with pytest.raises(raymap.MapExists):
        raymap.copy_selection(ray_map, wanted, path)
    with raymap.open(path) as some:
        assert some.finished
        assert not verify(some).damage
        assert ids_of(some).tolist() == wanted[:-1].tolist()
        np.testing.assert_array_equal(some.emitted, ray_map.emitted)
        assert some.channel_sets == ray_map.channel_sets
        assert some.runs[0]["parameters"]["selection"] == "a test"
        for ray_id in wanted[:-1]:
            (a, i), (b, j) = ray_map.find_ray(ray_id), some.find_ray(ray_id)
            ours, theirs = some.portions[b], ray_map.portions[a]
            for name in ("position", "normal", "event", "color", "triangle", "medium"):
                x = ours.column(name)[slice(*ours.record_offsets()[j : j + 2])]
                y = theirs.column(name)[slice(*theirs.record_offsets()[i : i + 2])]
                np.testing.assert_array_equal(x, y)
            assert ours.column("weight")[j] == theirs.column("weight")[i]
    # A selection of a selection, and of nothing
    with raymap.open(path) as some:
        assert raymap.copy_selection(some, np.array([39]), tmp_path / "one.raymap") == 1
        assert raymap.copy_selection(some, np.array([]), tmp_path / "none.raymap") == 0
    for name in ("one", "none"):
        with raymap.open(tmp_path / f"{name}.raymap") as few:
            np.testing.assert_array_equal(few.emitted, ray_map.emitted)


def test_all_rays_selected_is_the_same_content(tmp_path):
    path = tmp_path / "a.raymap"
    written = write_small(path, n_portions=2, n_rays=30, extra=True, grouped=True)
    with raymap.open(path) as whole:
        raymap.copy_selection(whole, ids_of(whole), tmp_path / "b.raymap")
    joined = raymap.join_portions(written)
    with raymap.open(tmp_path / "b.raymap") as copy:
        found = copy.portions[0].read()
        np.testing.assert_array_equal(found.position, joined.position)
        np.testing.assert_array_equal(copy.emitted, joined.emitted)
        np.testing.assert_array_equal(found.emission, joined.emission)
        np.testing.assert_array_equal(found.extra["phase"], joined.extra["phase"])
        assert copy.directory == small_directory()


def test_taking_all_rays_of_a_portion_changes_nothing():
    portion = portion_at(7, n_rays=30, weighted=True, extra=True)
    ids = np.arange(7, 37)
    taken = raymap.take_rays(portion, np.arange(30), ids)
    np.testing.assert_array_equal(taken.ray_ids, ids)
    # Every row of its colour table is used
    assert_same_portion(portion, taken)


def test_duckdb_answers_like_the_query(ray_map, tmp_path):
    """The same questions as criteria and as SQL on the exported rows."""
    path = tmp_path / "a.parquet"
    raymap.export(ray_map, path)
    reflected = int(raymap.FAMILIES["reflected"])
    questions = {
        'hit("lens")': "bool_or(object = 'lens' and step > 0)",
        'hit("lens.mesh")': "bool_or(object = 'lens' and face = 'mesh' and step > 0)",
        'source("sun") & !hit("box")': "any_value(source) = 'sun' "
        "and not coalesce(bool_or(object = 'box' and step > 0), false)",
        'count(hit("*", reflected)) >= 1': "count(*) filter "
        f"(where object is not null and step > 0 and (event & {reflected}) != 0) >= 1",
        'medium("glass")': "bool_or(medium = 'glass' and step < n)",
        'detected("sensor")': "bool_or(len(list_filter(descriptors, "
        "lambda d : d.detector = 'sensor' and d.registered)) > 0)",
    }
    with duckdb.connect() as base:
        base.execute(
            "create table rows as select *, max(step) over (partition by ray_id) as n "
            "from read_parquet(?)",
            [str(path)],
        )
        for criterion, condition in questions.items():
            rows = base.execute(
                f"select ray_id from rows group by ray_id having {condition} order by ray_id"
            ).fetchall()
            found = query.select(ray_map, criterion).ray_ids
            assert [ray_id for (ray_id,) in rows] == list(found), criterion


@pytest.mark.parametrize("folder", ["missing", "file"])
def test_a_table_without_a_place_is_refused_by_its_name(tmp_path, folder):
    write_small(tmp_path / "file", n_portions=1)
    target = tmp_path / folder / "table.csv"
    with raymap.open(tmp_path / "file") as ray_map, pytest.raises(RayMapError) as caught:
        export(ray_map, target)
    assert str(caught.value).startswith(f"{target} cannot be written: ")


def test_what_is_no_file_is_not_replaced(tmp_path):
    fifo = tmp_path / "pipe"
    os.mkfifo(fifo)
    with pytest.raises(RayMapError, match="is not a regular file and stays"):
        raymap.RayMapWriter.create(fifo, small_directory(), force=True)
    assert fifo.is_fifo()
