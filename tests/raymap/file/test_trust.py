"""Checksums that hold over values that lie: nothing false is served without a word.

The right answers are those of the map before its values were changed.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
import xxhash
import zstandard

import query
import raymap
import raymap.file.reader
from raymap.bytes.layout import (
    DIRECTORY,
    FOOTER,
    MAGIC,
    PATHS,
    PORTION,
    StreamEntry,
    pack_chunk_header,
)
from raymap.bytes.streams import WHOLE, ZSTD
from raymap.encoding.description import run_of
from raymap.encoding.portionmeta import DESCRIPTOR_STREAMS, PortionMeta
from raymap.file import stamps
from raymap.file.verify import verify
from raymap.jit.compilecache import fingerprint
from tests.fuzz.fuzz_values import Seed, Stream, put_together
from tests.raymap.maps import small_directory, write_small

_QUESTIONS = ('hit("*", reflected)', "length > 10", 'detected("sensor")', 'last(hit("*"))')


@pytest.fixture
def sound(tmp_path):
    """A small map with dictionaries, taken apart."""
    write_small(tmp_path / "sound.raymap", n_portions=3, n_rays=20, weighted=True)
    return Seed("sound", tmp_path / "sound.raymap")


def _columns(seed, tag):
    return [{stream.name: stream for stream in p.streams} for p in seed.parts if p.tag == tag]


def _answers(path, **options):
    with raymap.open(path, **options) as ray_map:
        return [
            (found.matched, pytest.approx(found.flux), found.ray_ids.tolist())
            for found in (query.select(ray_map, text, threads=2) for text in _QUESTIONS)
        ]


def _lie(seed, where):
    """Change a value of the merged dictionary so that the index alone cannot tell."""
    [footer] = _columns(seed, PATHS)
    if where == "lengths":
        # A path takes a point from the next one: compiled loops would leave the records
        lengths = footer["path.length"].values
        long = int(np.argmax(lengths))
        other = (long + 1) % len(lengths)
        if lengths[long] == lengths[other]:
            pytest.skip("all paths are of one length")
        lengths[long], lengths[other] = lengths[other], lengths[long]
        order = _swapped_points(lengths, long, other)
        for name in ("object", "face", "event", "medium", "meetings"):
            column = footer[f"path.{name}"]
            column.values = column.values[order]
        _swap_crossings(footer, order)
    elif where == "numbers":
        numbers = footer["local_to_global"].values
        numbers[[0, 1]] = numbers[[1, 0]]
    elif where == "rays":
        rays = footer["path.rays"].values
        rays[0], rays[1] = rays[0] + 1, rays[1] - 1
    elif where == "weights":
        footer["path.sum_w"].values[0] *= 2
        for name, stream in footer.items():
            if name.startswith("path.sum_wc"):
                stream.values[0] *= 2
    elif where == "media":
        media = footer["path.medium"].values
        media[0] = 1 - max(int(media[0]), 0)


def _swapped_points(lengths, a, b):
    """Order of the points when two paths change places; ``lengths`` are those afterwards."""
    before = lengths.astype(np.int64)
    before[[a, b]] = before[[b, a]]
    offsets = np.concatenate(([0], np.cumsum(before)))
    places = list(range(len(lengths)))
    places[a], places[b] = b, a
    return np.concatenate([np.arange(offsets[p], offsets[p + 1]) for p in places])


def _swap_crossings(footer, order):
    before = np.empty(len(order), np.int64)
    before[order] = footer["path.meetings"].values
    offsets = np.concatenate(([0], np.cumsum(before, dtype=np.int64)))
    rows = np.concatenate([np.arange(offsets[p], offsets[p + 1]) for p in order])
    for name in ("detector", "registered"):
        footer[f"path.{name}"].values = footer[f"path.{name}"].values[rows.astype(np.int64)]


_LIES = ("lengths", "numbers", "rays", "weights", "media")


@pytest.mark.parametrize("lie", _LIES)
@pytest.mark.parametrize("large", [False, True], ids=["small", "large"])
def test_a_footer_that_lies_changes_no_answer_about_rays(sound, tmp_path, lie, large, monkeypatch):
    """Maps too large to be compared at once are compared where their rays are read."""
    if large:
        monkeypatch.setattr(raymap.file.reader, "COMPARED_RAYS", 0)
    honest = _answers(tmp_path / "sound.raymap")
    _lie(sound, lie)
    path = tmp_path / "false.raymap"
    path.write_bytes(put_together(sound.parts))
    with raymap.open(path, on_damage="skip") as ray_map:
        found = verify(ray_map)
    assert [damage.portion for damage in found.damage] == [None]
    assert found.good == 3
    if not large:
        assert _answers(path, on_damage="skip") == honest
        with pytest.warns(raymap.DamageWarning, match="nothing is lost"):
            assert _answers(path) == honest
    elif lie in ("lengths", "numbers", "media"):
        # The question that reads rays finds the lie, and all that is asked afterwards is true
        with raymap.open(path, on_damage="skip") as ray_map:
            wanted = query.select(ray_map, "length > 10")
            assert wanted.matched == honest[1][0]
            assert wanted.ray_ids.tolist() == honest[1][2]
            assert ray_map.damage
            assert ray_map.merged is None
            assert query.select(ray_map, 'detected("sensor")').matched == honest[2][0]


def test_counts_of_a_portion_are_counted_and_not_believed(sound, tmp_path):
    honest = _answers(tmp_path / "sound.raymap")
    for portion in _columns(sound, PORTION):
        rays = portion["path.rays"].values
        rays[0], rays[1] = rays[0] + 1, rays[1] - 1
    [footer] = _columns(sound, PATHS)
    rays = footer["path.rays"].values
    rays[0], rays[1] = rays[0] + 3, rays[1] - 3
    path = tmp_path / "false.raymap"
    path.write_bytes(put_together(sound.parts))
    with raymap.open(path, on_damage="skip") as ray_map:
        found = verify(ray_map)
    assert found.good == 0
    assert found.rays_readable == 60
    assert _answers(path, on_damage="skip") == honest
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", raymap.DamageWarning)
        with raymap.open(path) as ray_map, pytest.raises(raymap.DamagedPortion, match="counted"):
            query.select(ray_map, "length > 10")


@pytest.mark.parametrize("name", ["path.sum_w", "path.sum_w2", "path.sum_wc"])
def test_sums_of_a_portion_are_compared_with_its_rays(sound, tmp_path, name):
    _columns(sound, PORTION)[1][name].values.reshape(-1)[0] *= 1.001
    path = tmp_path / "false.raymap"
    path.write_bytes(put_together(sound.parts))
    with raymap.open(path, on_damage="skip") as ray_map:
        found = verify(ray_map)
    assert 1 in [damage.portion for damage in found.damage]
    assert found.rays_readable == 60


def test_a_face_of_another_object_is_damage(tmp_path):
    """Nothing reads columns that were made for it, but never filled."""
    write_small(tmp_path / "sound.raymap", n_portions=2, n_rays=20, n_paths=None)
    seed = Seed("plain", tmp_path / "sound.raymap")
    columns = _columns(seed, PORTION)[0]
    box = np.flatnonzero(columns["path.object"].values == 1)
    assert len(box)
    columns["path.face"].values[box[0]] = 0
    path = tmp_path / "false.raymap"
    path.write_bytes(put_together(seed.parts))
    with raymap.open(path, on_damage="skip") as ray_map:
        found = verify(ray_map)
        assert [damage.portion for damage in found.damage] == [0]
        with pytest.raises(raymap.DamagedPortion, match="face that its object does not have"):
            ray_map.portions[0].column("triangle")


def test_an_untouched_map_is_sound(sound, tmp_path):
    path = tmp_path / "again.raymap"
    path.write_bytes(put_together(sound.parts))
    for each in (path, tmp_path / "sound.raymap"):
        with raymap.open(each) as ray_map:
            assert verify(ray_map).damage == []


def test_a_damaged_footer_closes_no_map(sound, tmp_path):
    honest = _answers(tmp_path / "sound.raymap")
    [footer] = _columns(sound, FOOTER)
    footer["portion.n_records"].values[0] += 1
    path = tmp_path / "false.raymap"
    path.write_bytes(put_together(sound.parts))
    with pytest.warns(raymap.DamageWarning, match="footer"):
        assert _answers(path) == honest
    assert _answers(path, on_damage="skip") == honest


def test_answers_say_whether_the_file_was_verified_here(sound, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    path = tmp_path / "sound.raymap"

    def verified():
        with raymap.open(path) as ray_map:
            told = query.select(ray_map, "length > 10").summary()["verified"]
            assert told is ray_map.describe()["verified"]
            return told

    def check():
        with raymap.open(path, on_damage="skip") as ray_map:
            return verify(ray_map).damage

    assert verified() is False
    assert check() == []
    assert verified() is True
    # Another file in its place is another file, whatever its size and time say
    content, times = path.read_bytes(), path.stat()
    path.write_bytes(content)
    assert verified() is False
    assert check() == []
    other = tmp_path / "other.raymap"
    other.write_bytes(content[:-1] + b"\0")
    os.utime(other, ns=(times.st_atime_ns, times.st_mtime_ns))
    os.replace(other, path)
    with raymap.open(path, on_damage="skip") as ray_map:
        assert ray_map.verified is False
    # What verify finds false loses its stamp
    _lie(sound, "rays")
    path.write_bytes(put_together(sound.parts))
    assert check()
    with raymap.open(path, on_damage="skip") as ray_map:
        assert ray_map.verified is False


def test_a_scene_without_an_equation_is_refused(tmp_path):
    """Squares of the radius that no float64 holds once ended in another program's error."""
    write_small(tmp_path / "sound.raymap", n_portions=1, n_rays=5)
    seed = Seed("sphere", tmp_path / "sound.raymap")
    [text] = [s for s in seed.parts[0].streams if s.name == "json"]
    data = json.loads(text.values.tobytes())
    data["bounding_sphere"]["radius"] = 1e308
    text.values = np.frombuffer(json.dumps(data).encode(), np.uint8)
    path = tmp_path / "false.raymap"
    path.write_bytes(put_together(seed.parts))
    with pytest.raises(raymap.NotARayMap, match="bounding_sphere"):
        raymap.open(path)


def _forged_text(tmp_path, text):
    """A map of version 1 whose directory is another text, well packed."""
    packed = zstandard.compress(text, 9)
    entry = StreamEntry(
        "json", 0, ZSTD, WHOLE, 0, 1, len(text), len(packed), xxhash.xxh3_64_intdigest(packed)
    )
    path = tmp_path / "false.raymap"
    first = MAGIC + struct.pack("<HH", 1, 0)
    path.write_bytes(first + pack_chunk_header(DIRECTORY, b"", [entry]) + packed)
    return path


@pytest.mark.parametrize(
    "text",
    [
        b'{"sources": [{"name": "a", "parameters": {"x": [' + b"[]," * 40_000_000 + b"[]]}}]}",
        b'{"sources": [{"name": "a"}], "objects": [{"name": "o", "faces": ['
        + b"1," * 1_500_000
        + b"1]}]}",
    ],
    ids=["long text", "many complaints"],
)
def test_a_small_file_costs_little(tmp_path, text):
    """120 MB of lists in 15 kB and a million complaints are refused at once."""
    path = _forged_text(tmp_path, text)
    del text
    tracemalloc.start()
    with pytest.raises(raymap.NotARayMap) as refused:
        raymap.open(path)
    assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    tracemalloc.stop()
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 500


@pytest.mark.parametrize("quadrics", [(), (None, None)], ids=["plain", "quadrics"])
def test_primitives_cost_nothing_that_nobody_met(tmp_path, quadrics):
    """A face of 2^31 primitives beside one with a quadric for each of several."""
    faces = (
        raymap.Face(name="f", primitive_count=2, quadrics=quadrics),
        raymap.Face(name="g", first_primitive=2, primitive_count=2**31 - 3),
    )
    directory = small_directory(objects=(raymap.SceneObject(name="o", faces=faces),))
    path = tmp_path / "a.raymap"
    tracemalloc.start()
    raymap.RayMapWriter.create(path, directory).finish()
    with raymap.open(path) as ray_map:
        assert ray_map.directory.faces.primitive_count.tolist() == [2, 2**31 - 3]
        assert len(ray_map.shapes.primitive_quadric) == len(quadrics)
    assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    tracemalloc.stop()


def test_values_that_nobody_foresaw_are_damage_of_the_portion(tmp_path, monkeypatch):
    write_small(tmp_path / "a.raymap", n_portions=2, n_rays=5)
    for error in (IndexError, MemoryError, OverflowError, KeyError, RecursionError):
        with raymap.open(tmp_path / "a.raymap", on_damage="skip") as ray_map:
            portion = ray_map.portions[0]

            def fail(error=error):
                raise error("deep inside")

            monkeypatch.setattr(portion, "_column_position", fail)
            with pytest.raises(raymap.DamagedPortion, match=f"{error.__name__}: .*deep inside"):
                portion.column("position")
            assert [damage.portion for damage in ray_map.damage] == [0]


@pytest.mark.parametrize(("name", "cases"), [("fuzz_values", 40), ("fuzz_laws", 100)])
def test_changed_values_with_sound_checksums_crash_nothing(request, name, cases):
    """The short run of scripts of ``tests/fuzz``, with bounds checks in all compiled loops."""
    folder = request.config.cache.mkdir(f"bounds-{fingerprint()[:12]}")
    root = Path(__file__).resolve().parents[3]
    script = root / "tests" / "fuzz" / f"{name}.py"
    environment = {
        **os.environ,
        "NUMBA_BOUNDSCHECK": "1",
        "NUMBA_CACHE_DIR": str(folder),
        "PYTHONPATH": str(root),
    }
    done = subprocess.run(
        [sys.executable, str(script), "3000", "--cases", str(cases), "--first", "1000"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert f"'cases': {cases}" in done.stdout


def test_stamps_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(stamps, "user_caches", lambda: tmp_path / "cache")
    monkeypatch.setattr(stamps, "_KEPT", 8)
    files = [tmp_path / f"{number}.raymap" for number in range(20)]
    for file in files:
        file.write_bytes(b"a map")
        stamps.stamp(file)
    kept = list((tmp_path / "cache" / "raymap" / "verified").iterdir())
    assert 6 <= len(kept) <= 8
    assert stamps.is_stamped(files[-1])
    assert not stamps.is_stamped(files[0])


def test_a_run_says_numbers_or_is_damage(tmp_path):
    """JSON of a run whose values are of another kind: refused by the writer, damage when read."""
    write_small(tmp_path / "a.raymap", n_portions=1, n_rays=5)
    for wrong in ({"seed": 1.5}, {"parameters": 3}, {"first_portion": -1}, {"statistics": "x"}):
        with pytest.raises(raymap.FormatError, match=next(iter(wrong))):
            run_of({"seed": 1, "parameters": {}, "first_portion": 0, "first_ray": 0, **wrong})
    assert run_of({"seed": "18446744073709551617"}) == {"seed": 2**64 + 1}


def test_a_map_without_channels_is_refused_where_light_is_asked_for(tmp_path):
    raymap.RayMapWriter.create(tmp_path / "a.raymap", small_directory()).finish()
    with (
        raymap.open(tmp_path / "a.raymap") as ray_map,
        pytest.raises(raymap.RayMapError, match="nothing was recorded in it yet"),
    ):
        ray_map.photometry(0)


def test_crossings_in_cells_that_do_not_exist_are_damage(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path, n_portions=1, n_rays=20)
    seed = Seed("a", path)
    [stream] = [s for p in seed.parts for s in p.streams if s.name == DESCRIPTOR_STREAMS[0]]
    assert len(stream.values)
    stream.values = stream.values.copy()
    stream.values[0] = 7
    path.write_bytes(put_together(seed.parts))
    with raymap.open(path) as ray_map:
        portion = ray_map.portions[0]
        for read in (portion.descriptors, lambda: portion.column("cell")):
            with pytest.raises(raymap.DamagedPortion, match="cell that its detector does not have"):
                read()


@pytest.mark.parametrize(("bit", "column"), [(4, "weight"), (8, "emission")])
def test_a_column_that_only_a_flag_states_is_damage(tmp_path, monkeypatch, bit, column):
    """Bits of the portion's flags as the page of the format numbers them."""
    path = tmp_path / "a.raymap"
    own = PortionMeta.flags.fget
    with monkeypatch.context() as patched:
        patched.setattr(PortionMeta, "flags", property(lambda self: own(self) | bit))
        write_small(path, n_portions=1, n_rays=20)
    with raymap.open(path) as ray_map, pytest.raises(raymap.DamagedPortion, match=column):
        ray_map.portions[0].column(column)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_positions_that_are_no_places_are_damage(tmp_path, value):
    path = tmp_path / "a.raymap"
    write_small(path, n_portions=1, n_rays=20)
    seed = Seed("a", path)
    [stream] = [s for p in seed.parts for s in p.streams if s.name == "position.y"]
    stream.values = stream.values.copy()
    stream.values[3] = value
    path.write_bytes(put_together(seed.parts))
    with raymap.open(path) as ray_map, pytest.raises(raymap.DamagedPortion, match="not finite"):
        ray_map.portions[0].column("position")


def test_positions_whose_sum_overflows_are_read(tmp_path):
    path = tmp_path / "a.raymap"
    write_small(path, n_portions=1, n_rays=20)
    seed = Seed("a", path)
    [stream] = [s for p in seed.parts for s in p.streams if s.name == "position.y"]
    stream.values = np.full_like(stream.values, 3e38)
    path.write_bytes(put_together(seed.parts))
    with raymap.open(path) as ray_map:
        assert (ray_map.portions[0].column("position")[:, 1] == np.float32(3e38)).all()


def test_a_table_of_colours_has_the_channels_of_its_map(tmp_path):
    """One channel, and a table of two columns: light in a channel that there is not."""
    one = raymap.ChannelSet(kind="spectral", wavelengths_nm=(550.0,))
    path = tmp_path / "one.raymap"
    write_small(path, n_portions=1, channels=one)
    seed = Seed("one", path)
    [part] = [part for part in seed.parts if part.tag == PORTION]
    part.streams = [stream for stream in part.streams if stream.name != "color.table"]
    part.streams.append(Stream("color.table", 2, 0, 2, np.full((3, 2), 32767, np.uint16)))
    path.write_bytes(put_together(seed.parts))
    with raymap.open(path) as ray_map:
        with pytest.raises(raymap.DamagedPortion, match="colour table has 2 columns"):
            ray_map.portions[0].color_table()
        with pytest.raises(raymap.DamagedPortion, match="colour table has 2 columns"):
            ray_map.portions[0].column("color")
