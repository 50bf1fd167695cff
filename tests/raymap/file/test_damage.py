"""Damage and malice end in a named error or a skipped portion: never a crash or a wrong ray."""

from __future__ import annotations

import contextlib
import struct
import tracemalloc
import warnings

import numpy as np
import pytest
import xxhash
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import raymap
from raymap.bytes.layout import (
    CHUNK_HEADER_SIZE,
    FILE_HEADER_SIZE,
    PORTION,
    STREAM_ENTRY_SIZE,
    parse_chunk_header,
)
from raymap.file.repair import repair
from raymap.file.verify import verify
from tests.examples import examples
from tests.raymap.damaging import check_damaged, chunk_offsets, with_sound_header
from tests.raymap.maps import write_small

_SETTINGS = settings(
    max_examples=examples(50),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


@pytest.fixture(scope="module", params=[4, None], ids=["paths", "plain"])
def sound(request, tmp_path_factory):
    """(bytes, portions by number) of a sound map."""
    path = tmp_path_factory.mktemp("sound") / "a.raymap"
    written = write_small(
        path, n_portions=3, n_rays=12, n_paths=request.param, weighted=True, extra=True
    )
    return path.read_bytes(), dict(enumerate(written))


def _flip_bits(sound, path, step, structural_step):
    """Flip a bit at every so many bytes, more densely where chunks begin and the file ends."""
    data, written = sound
    places = set(range(0, len(data), step))
    for offset in [*chunk_offsets(data), len(data) - 40]:
        places |= set(range(offset, offset + 40, structural_step))
    for place in sorted(places):
        damaged = bytearray(data)
        damaged[place] ^= 1 << (place % 8)
        path.write_bytes(damaged)
        served = check_damaged(path, written)
        if served is not None:
            assert len(served) >= 2, f"a flipped bit at {place} cost more than one portion"


def test_flipped_bits_are_noticed_or_harmless(sound, tmp_path):
    _flip_bits(sound, tmp_path / "a.raymap", 997, 7)


@pytest.mark.slow
def test_flipped_bits_everywhere_are_noticed_or_harmless(sound, tmp_path):
    _flip_bits(sound, tmp_path / "a.raymap", 17, 1)


@_SETTINGS
@given(drawn=st.data())
def test_random_damage(sound, tmp_path, drawn):
    data, written = sound
    damaged = bytearray(data)
    for _ in range(drawn.draw(st.integers(1, 4))):
        place = drawn.draw(st.integers(0, len(damaged) - 1))
        kind = drawn.draw(st.sampled_from(["flip", "cut", "insert", "remove", "zero", "repeat"]))
        length = drawn.draw(st.integers(1, 2000))
        if kind == "flip":
            damaged[place] ^= 1 << drawn.draw(st.integers(0, 7))
        elif kind == "cut":
            del damaged[place:]
        elif kind == "insert":
            damaged[place:place] = drawn.draw(st.binary(max_size=50))
        elif kind == "remove":
            del damaged[place : place + length]
        elif kind == "zero":
            damaged[place : place + length] = bytes(len(damaged[place : place + length]))
        else:
            damaged[place:place] = damaged[place : place + length]
        if not damaged:
            break
    path = tmp_path / "a.raymap"
    path.write_bytes(damaged)
    check_damaged(path, written)


@_SETTINGS
@given(
    chunk=st.integers(0, 7),
    field=st.integers(8, 4000),
    value=st.binary(min_size=1, max_size=8),
)
def test_headers_that_lie_with_sound_checksums(sound, tmp_path, chunk, field, value):
    data, written = sound
    offsets = chunk_offsets(data)
    offset = offsets[chunk % len(offsets)]
    place = offset + field
    forged = bytearray(data)
    forged[place : place + len(value)] = value
    with contextlib.suppress(raymap.FormatError):
        forged = with_sound_header(bytes(forged), offset)
    path = tmp_path / "a.raymap"
    path.write_bytes(forged)
    check_damaged(path, written, exact=False)


def _portion_chunk(data):
    for offset in chunk_offsets(data):
        if data[offset : offset + 8] == PORTION:
            return offset, parse_chunk_header(data[offset:])
    raise AssertionError


def _replace_stream(data, name, codec, raw_size, stored):
    """Forge a stream of the first portion; the file ends after that portion."""
    offset, header = _portion_chunk(data)
    table = offset + CHUNK_HEADER_SIZE + len(header.meta)
    chunk = bytearray(data[offset : offset + header.size])
    number, entry = next((n, e) for n, e in enumerate(header.streams) if e.name == name)
    row = table - offset + number * STREAM_ENTRY_SIZE
    digest = xxhash.xxh3_64_intdigest(stored)
    chunk[row + 33] = codec
    chunk[row + 40 : row + 64] = struct.pack("<QQQ", raw_size, len(stored), digest)
    start = entry.offset
    chunk[start : start + entry.stored_size] = stored
    chunk[16:24] = struct.pack("<Q", len(chunk))
    forged = data[:offset] + bytes(chunk)
    return with_sound_header(forged, offset)


def test_decompression_bombs_do_not_explode(sound, tmp_path):
    data, written = sound
    path = tmp_path / "a.raymap"
    name = "path.source"
    bomb = zstandard.ZstdCompressor(level=19).compress(bytes(2**28))
    honest = zstandard.ZstdCompressor().compress(bytes(2 * 12))
    unsized = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(2**22))
    tracemalloc.start()
    for codec, raw_size, stored in (
        (1, 2**28, bomb),
        (1, 24, bomb),
        (1, 2**40, honest),
        (1, 24, unsized),
        (2, 2**62, b"\0"),
        (2, 2**33, b"\0"),
        (0, 2**30, b"\0" * 10),
        (9, 24, b"\0" * 24),
        (1, 24, b""),
        (1, 0, b"no frame at all"),
    ):
        path.write_bytes(_replace_stream(data, name, codec, raw_size, stored))
        assert check_damaged(path, written, exact=False) in (set(), None)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 * 2**20


def test_damage_raises_by_default_and_names_place_and_loss(sound, tmp_path):
    data, _ = sound
    offset, header = _portion_chunk(data)
    damaged = bytearray(data)
    entry = next(e for e in header.streams if e.name == "position.y" and e.stored_size > 1)
    damaged[offset + entry.offset] ^= 1
    path = tmp_path / "a.raymap"
    path.write_bytes(damaged)
    with raymap.open(path) as ray_map:
        stored = ray_map.portions[0]
        stored.column("object")
        with pytest.raises(raymap.DamagedPortion) as caught:
            stored.read()
        text = str(caught.value)
        assert "portion 0" in text
        assert "position.y" in text
        assert f"{stored.n_records} records are unreadable" in text
        assert 'on_damage="skip"' in text
        assert ray_map.damage[0].portion == 0
        result = verify(ray_map)
        assert (result.portions, result.good) == (3, 2)
        assert [damage.portion for damage in result.damage] == [0]


def test_a_bit_of_the_footer_is_never_lost_without_a_word(sound, tmp_path):
    data, written = sound
    size = int.from_bytes(data[-24:-16], "little")
    rays = sum(portion.n_rays for portion in written.values())
    path = tmp_path / "changed.raymap"
    lost = 0
    for place in range(len(data) - size, len(data) - 24, max(1, size // 60)):
        changed = bytearray(data)
        changed[place] ^= 4
        path.write_bytes(changed)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            opened = raymap.open(path)
        assert opened.rays == rays
        if not opened.finished:
            # The portions are read instead, with one warning
            assert [item.category for item in told] == [raymap.DamageWarning]
            lost += 1
        found = verify(opened)
        assert found.damage, place
        assert found.torn_bytes == 0
    assert lost > 20


def test_damage_of_an_unfinished_map_raises_or_skips_at_opening(tmp_path):
    path = tmp_path / "a.raymap"
    written = write_small(path, n_portions=3, n_rays=12, finish=False)
    data = bytearray(path.read_bytes())
    offset, _ = _portion_chunk(bytes(data))
    data[offset + 50] ^= 1
    path.write_bytes(data)
    with pytest.raises(raymap.DamagedPortion):
        raymap.open(path)
    with raymap.open(path, on_damage="skip") as ray_map:
        assert [portion.number for portion in ray_map.portions] == [1, 2]
        assert len(ray_map.damage) == 1
        assert ray_map.damage[0].offset == offset
        np.testing.assert_array_equal(ray_map.emitted, written[1].emitted + written[2].emitted)


def test_repair_keeps_every_sound_portion(sound, tmp_path):
    data, written = sound
    offset, header = _portion_chunk(data)
    damaged = bytearray(data)
    damaged[offset + header.size - 3] ^= 255
    path = tmp_path / "a.raymap"
    path.write_bytes(damaged)
    fixed = tmp_path / "fixed.raymap"
    with raymap.open(path, on_damage="skip") as ray_map:
        assert repair(ray_map, fixed) == 2
        with pytest.raises(raymap.MapExists):
            repair(ray_map, fixed)
    assert check_damaged(fixed, written) == {1, 2}
    with raymap.open(fixed) as ray_map:
        assert ray_map.finished
        assert not verify(ray_map).damage
        assert ray_map.runs[0]["seed"] == 1
        expected = sum(_registered_weight(written[k], ray_map.directory, "sensor") for k in (1, 2))
        sums, _ = ray_map.detector_result("sensor")
        assert sums.sum() == pytest.approx(expected)


def _registered_weight(portion, directory, name):
    number = [detector.name for detector in directory.detectors].index(name)
    ray = np.repeat(np.arange(portion.n_rays), portion.records_per_ray)
    ray = np.repeat(ray, portion.descriptor_count)
    d = portion.descriptors
    return float(portion.weight[ray[(d.detector == number) & d.registered]].sum(dtype=float))


def test_files_that_are_no_ray_maps(tmp_path):
    path = tmp_path / "a.raymap"
    for content, words in (
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "not a ray map"),
        (b"\x89RAYMAP\n\x1a\n" + bytes(100), "text mode"),
        (b"hello world, this is text", "not a ray map"),
    ):
        path.write_bytes(content)
        with pytest.raises(raymap.NotARayMap, match=words):
            raymap.open(path)
    with pytest.raises(raymap.NotARayMap, match="does not exist"):
        raymap.open(tmp_path / "none.raymap")


def test_a_newer_major_version_is_refused_by_name(sound, tmp_path):
    data, _ = sound
    path = tmp_path / "a.raymap"
    path.write_bytes(data[:12] + struct.pack("<H", 3) + data[14:])
    with pytest.raises(
        raymap.UnsupportedVersion, match="version 3, this program reads versions 1 to 2"
    ):
        raymap.open(path)
    # A newer minor version is read
    path.write_bytes(data[:14] + struct.pack("<H", 7) + data[16:])
    with raymap.open(path) as ray_map:
        assert ray_map.rays == 36


def test_unknown_chunks_and_streams_are_carried_along(tmp_path):
    from raymap.bytes.layout import pack_chunk_header
    from raymap.bytes.streams import StreamSet

    path = tmp_path / "a.raymap"
    written = write_small(path, n_portions=2, n_rays=12, finish=False)
    streams = StreamSet()
    streams.add_bytes("text", b"from the future")
    chunk = [pack_chunk_header(b"RMAP:NEW", b"?", streams.entries), *streams.buffers]
    path.write_bytes(path.read_bytes() + b"".join(bytes(part) for part in chunk))
    with raymap.RayMapWriter.append_to(path) as writer:
        writer.append(written[1])
    with raymap.open(path) as ray_map:
        assert not ray_map.damage
        assert len(ray_map.portions) == 3
        assert (b"RMAP:NEW") in [tag for _, tag in ray_map.other_chunks]
        assert not verify(ray_map).damage
        fixed = tmp_path / "fixed.raymap"
        repair(ray_map, fixed)
    assert b"RMAP:NEW" in fixed.read_bytes()


def test_the_first_chunk_must_be_a_directory(sound, tmp_path):
    data, _ = sound
    path = tmp_path / "a.raymap"
    second = chunk_offsets(data)[1]
    path.write_bytes(data[:FILE_HEADER_SIZE] + data[second:])
    with pytest.raises(raymap.NotARayMap, match="no sound directory"):
        raymap.open(path)
