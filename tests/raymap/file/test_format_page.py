"""The format page, the program and the independent reader say the same."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import raymap
from raymap.bytes import layout, streams
from raymap.encoding import portionmeta
from raymap.file.verify import verify
from raymap.model import limits
from raymap.model.events import ENDINGS, Event
from tests.data.golden.v1.make import HERE, MAKERS, columns_of, traced_portion
from tests.examples import examples
from tests.naive.format_reader import read_map
from tests.raymap.compact import write_compactly
from tests.raymap.format_example import bytes_of, directory, lines
from tests.raymap.maps import RGB
from tests.strategies import assert_same_portion, channel_sets, directories, portions

_PAGE = (Path(__file__).resolve().parents[3] / "docs" / "format.md").read_text()


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


@settings(max_examples=examples(25), suppress_health_check=[HealthCheck.too_slow])
@given(drawn=st.data())
def test_the_independent_reader_reads_any_portion(tmp_path_factory, drawn):
    directory = drawn.draw(directories())
    channels = drawn.draw(channel_sets())
    portion = drawn.draw(portions(directory, channels, max_rays=20))
    path = tmp_path_factory.mktemp("any") / "a.raymap"
    compact = drawn.draw(st.booleans())
    with raymap.RayMapWriter.create(path, directory) as writer:
        if compact:
            write_compactly(writer)
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
    assert str(layout.CHUNK_HEADER_SIZE) in _PAGE
    assert f"version {layout.VERSION[0]}.{layout.VERSION[1]}" in _PAGE
    path = tmp_path / "a.raymap"
    MAKERS["random"](path)
    with raymap.open(path) as ray_map:
        directory = ray_map.file.chunk_at(layout.FILE_HEADER_SIZE, ray_map.bytes)
        merged = next(offset for offset, tag in ray_map.other_chunks if tag == layout.PATHS)
        for chunk in (directory, ray_map.file.chunk_at(merged, ray_map.bytes)):
            for entry in chunk.header.streams:
                assert f"`{re.sub(r'[.][0-9]+$', '.K', entry.name)}`" in _PAGE
        for stored in ray_map.portions:
            for entry in stored.stream_table():
                name = "x:NAME" if entry.name.startswith("x:") else entry.name
                assert f"`{name}`" in _PAGE
        for entry in ray_map.footer_chunk.header.streams:
            name = entry.name.removeprefix("portion.").removeprefix("directory.")
            assert f"`{name}`" in _PAGE or f"`portion.{name}`" in _PAGE
    assert RGB.n_channels == 3


def test_the_page_has_every_limit_with_its_number():
    table = _PAGE[_PAGE.index("## Limits") : _PAGE.index("## Directory")]
    powers = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
    numbers = {name: getattr(limits, name) for name in limits.__all__ if name.isupper()}
    assert len(numbers) >= 15
    for name, number in numbers.items():
        power = f"2{str(number.bit_length() - 1).translate(powers)}"
        digits = len(str(number)) - 1
        ten = f"10{str(digits).translate(powers)}"
        there = (
            str(number) in table
            or (number == 10**digits and ten in table)
            or (number & (number - 1) == 0 and power in table)
        )
        assert there or name in ("MAX_EXTRA_NAME", "MAX_STREAM_NAME"), name
    assert f"1 to {limits.MAX_STREAM_NAME} bytes" in _PAGE


def test_the_page_has_every_event_bit():
    table = _PAGE[
        _PAGE.index("| bit | event |") : _PAGE.index("The first record of a ray has bit 0")
    ]
    rows = [row.strip("|").split("|") for row in table.splitlines()[2:] if row]
    cells = [cell.strip() for row in rows for cell in row]
    said = dict(zip(cells[::2], cells[1::2], strict=True))
    for event in Event:
        words = said[str(int(event).bit_length() - 1)]
        assert ("*end*" in words) == bool(event & ENDINGS), event
        assert any(word in words for word in _WORDS[event.name]), event


_WORDS = {
    "EMITTED": ["emitted"],
    "SPECULAR_REFLECTION": ["specular reflection"],
    "SPECULAR_REFRACTION": ["refraction"],
    "DIFFUSE_REFLECTION": ["diffuse reflection"],
    "DIFFUSE_TRANSMISSION": ["diffuse transmission"],
    "GLOSSY_REFLECTION": ["glossy reflection"],
    "TIR": ["total internal reflection"],
    "SURFACE_ABSORPTION": ["absorbed at a surface"],
    "VOLUME_SCATTER": ["scattered in a volume"],
    "VOLUME_ABSORPTION": ["absorbed in a volume"],
    "LEFT_SCENE": ["left the scene"],
    "DETECTOR_CROSSED": ["crossed"],
    "DETECTOR_REGISTERED": ["registered"],
    "POLARISER": ["polariser"],
    "BIREFRINGENT_SPLIT": ["birefringent split"],
    "ORDINARY": ["ordinary ray"],
    "EXTRAORDINARY": ["extraordinary ray"],
    "DEPTH_LIMIT": ["depth limit"],
    "ROULETTE_KILL": ["roulette"],
    "DISPERSIVE_SELECT": ["wavelength"],
    "RIM_HIT": ["rim"],
    "CONICAL_REFRACTION": ["conical refraction"],
    "FLUORESCENCE": ["fluorescence"],
    "GEOMETRY_ERROR": ["geometry error"],
    "MEDIUM_CHANGED": ["medium changed"],
    "GLOSSY_TRANSMISSION": ["glossy transmission"],
}


def test_the_example_of_the_page_is_the_map_that_it_describes(tmp_path):
    data = bytes_of(_PAGE[_PAGE.index("## An example") :])
    (tmp_path / "page.raymap").write_bytes(data)
    described, sets, read = read_map(tmp_path / "page.raymap")
    assert described["sources"] == [{"name": "lamp", "flux": 2.0}]
    (mirror,) = described["objects"]
    assert (mirror["name"], mirror["faces"][0]["name"]) == ("mirror", "top")
    assert list(mirror["faces"][0]["quadrics"][0]["coefficients"]) == [0] * 8 + [1, 0]
    assert not sets
    assert not read
    with raymap.open(tmp_path / "page.raymap") as ray_map:
        assert ray_map.directory == directory()
    # What is written today differs at most in compressed bytes, their size and the hashes of them
    assert bytes_of("\n".join(lines()))[:24] == data[:24]
    words = [
        row.rpartition("    ")[2] for row in _PAGE.splitlines() if re.match("[0-9A-F]{4}  ", row)
    ]
    assert [row.rpartition("    ")[2] for row in lines()][:6] == words[:6]


def test_the_independent_reader_is_short_and_independent():
    source = (Path(__file__).resolve().parents[2] / "naive" / "format_reader.py").read_text()
    code = [line for line in source.splitlines() if line.strip()]
    assert len(code) <= 240
    imported = set(re.findall(r"^(?:import|from) (\w+)", source, re.MULTILINE))
    assert imported <= {"json", "math", "struct", "numpy", "xxhash", "zstandard"}
