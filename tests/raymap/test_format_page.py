"""The format page, the program and the independent reader say the same."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import raymap
from raymap import chunks, layout, portionmeta, streams
from raymap.verify import verify
from tests.data.golden.v1.make import HERE, MAKERS, columns_of, traced_portion
from tests.naive.format_reader import read_map
from tests.raymap.maps import RGB
from tests.strategies import assert_same_portion, channel_sets, directories, portions

_PAGE = (Path(__file__).resolve().parents[2] / "docs" / "format.md").read_text()


def _assert_same_columns(expected, found):
    assert set(found) == set(expected)
    for name, column in expected.items():
        other = np.asarray(found[name])
        assert column.shape == other.shape, name
        if column.dtype.kind in "iub":
            np.testing.assert_array_equal(other, column, err_msg=name)
        else:
            assert column.dtype == other.dtype, name
            assert column.tobytes() == other.tobytes(), name


@pytest.mark.parametrize("name", MAKERS)
def test_golden_files_are_read_as_when_they_were_made(name):
    expected = np.load(HERE / f"{name}.npz")
    path = HERE / f"{name}.raymap"
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        assert not verify(ray_map).damage
        for k, stored in enumerate(ray_map.portions):
            columns = {n[len(f"{k}/") :]: expected[n] for n in expected if n.startswith(f"{k}/")}
            _assert_same_columns(columns, columns_of(stored))
    directory, sets, read = read_map(path)
    assert len(directory["sources"]) == 2
    assert len(sets) == (2 if name == "lens" else 1)
    assert len(read) == len(ray_map.portions)
    for k, found in enumerate(read):
        columns = {n[len(f"{k}/") :]: expected[n] for n in expected if n.startswith(f"{k}/")}
        _assert_same_columns(columns, found)


def test_golden_lens_uses_every_encoding():
    with raymap.open(HERE / "lens.raymap") as ray_map:
        flags = {stored.index.meta.flags for stored in ray_map.portions}
        assert all(flag & 0x1F1 == 0x1F1 for flag in flags)
        _assert_lens_content(ray_map)


def _assert_lens_content(ray_map):
    """The content was computed, not only written and read."""
    assert_same_portion(traced_portion(300, 0), ray_map.portions[0].read())


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(drawn=st.data())
def test_the_independent_reader_reads_any_portion(tmp_path_factory, drawn):
    directory = drawn.draw(directories())
    channels = drawn.draw(channel_sets())
    portion = drawn.draw(portions(directory, channels, max_rays=20))
    path = tmp_path_factory.mktemp("any") / "a.raymap"
    compact = drawn.draw(st.booleans())
    with raymap.RayMapWriter.create(path, directory, compact=compact) as writer:
        writer.add_channel_set(channels)
        writer.append(portion)
    (found,) = read_map(path)[2]
    with raymap.open(path) as ray_map:
        _assert_same_columns(columns_of(ray_map.portions[0]), found)


def test_the_page_names_every_chunk_stream_flag_and_limit(tmp_path):
    for tag in layout.KNOWN_TAGS:
        assert f"`{tag.decode()}`" in _PAGE
    for code, dtype in streams.KINDS.items():
        assert re.search(rf"\b{code} (`{dtype.str.strip('<|')}`|bytes|Boolean|complex)", _PAGE)
    for flag in portionmeta.Encoding:
        assert re.search(rf"\b{int(flag)}\b", _PAGE)
    assert " ".join(f"{byte:02X}" for byte in layout.MAGIC) in _PAGE
    for number in (layout.MAX_STREAMS, chunks.MAX_RATIO, layout.CHUNK_HEADER_SIZE):
        assert str(number) in _PAGE
    assert f"version {layout.VERSION[0]}.{layout.VERSION[1]}" in _PAGE
    path = tmp_path / "a.raymap"
    MAKERS["random"](path)
    with raymap.open(path) as ray_map:
        for stored in ray_map.portions:
            for entry in stored.stream_table():
                name = "x:NAME" if entry.name.startswith("x:") else entry.name
                assert f"`{name}`" in _PAGE
        for entry in ray_map.footer_chunk.header.streams:
            name = re.sub(r"\.\d+$", ".K", entry.name).removeprefix("portion.")
            assert f"`{name}`" in _PAGE or f"`portion.{name}`" in _PAGE or "path." in name
    assert RGB.n_channels == 3


def test_the_independent_reader_is_short_and_independent():
    source = (Path(__file__).resolve().parents[1] / "naive" / "format_reader.py").read_text()
    code = [line for line in source.splitlines() if line.strip()]
    assert len(code) <= 200
    imported = set(re.findall(r"^(?:import|from) (\w+)", source, re.MULTILINE))
    assert imported <= {"json", "math", "struct", "numpy", "xxhash", "zstandard"}
